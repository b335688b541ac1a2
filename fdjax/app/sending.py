"""`fdjax send`: check a file, show what it will do, stream it, and remember how far it came."""

import dataclasses
import signal
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.formats.profile import Machine
from fdjax.machine import connect, ports, resume
from fdjax.machine.journal import Job, Journal, Log
from fdjax.machine.journal import path_of as journal_of
from fdjax.machine.journal import read as read_journal
from fdjax.machine.ports import AbstractPort
from fdjax.machine.program import Program
from fdjax.machine.protocols import protocol
from fdjax.machine.resume import Point
from fdjax.machine.stream import Event, Stream
from fdjax.machine.survey import Survey, survey


@dataclass(frozen=True)
class Request:
    """What the command line asks for; see `fdjax send --help`."""

    file: Path
    machine: str
    port: str | None
    firmware: str | None = None
    baud: int | None = None
    dry_run: bool = False
    yes: bool = False
    resume: bool = False
    layer: int | None = None
    kept_power: bool = False
    log: Path | None = None
    printed: Path | None = None
    quiet: bool = False


def send(request: Request) -> None:
    """Carry out a request.

    Raises `InputError` before anything was sent, `StreamError` after.
    """
    machine = _machine(request)
    program = Program(request.file, machine)
    found = _survey(program, request.quiet)
    _say(summary(program, found), request.quiet)
    _refuse(program, found)
    if request.dry_run:
        return
    if request.port is None:
        raise InputError(f"--port: name the machine's port; there are {ports.listing()}")
    starts = [layer.line for layer in found.layers]
    goes_on = request.resume or request.layer is not None
    digest = program.digest()
    reached = _reached(program, digest, request) if goes_on else None
    port = _open(request, machine)
    try:
        firmware = machine.stream.firmware
        if firmware == "auto":
            firmware = connect.recognise(port)
        progress = _Progress(found, request.quiet)
        with _Records(program, digest, request, port) as records:

            def on_event(event: Event) -> None:
                records.take(event)
                progress(event)

            speaks = protocol(firmware, machine.stream)
            stream = Stream(
                program, port, speaks, starts=starts, on_event=on_event, log=records.log
            )
            point = None
            if goes_on:
                stream.connect()
                point = _go_on(program, starts, reached, request, stream)
            _confirm(request, point)
            records.begin(point)
            try:
                with _Controls(stream, request.yes):
                    stream.run()
            finally:
                progress.close()
                _keep_print(request, program, port)
            records.finished()
    finally:
        port.close()


def _machine(request: Request) -> Machine:
    machine = profile.load(request.machine)
    settings = machine.stream
    if request.firmware is not None:
        settings = dataclasses.replace(settings, firmware=request.firmware)
    if request.baud is not None:
        settings = dataclasses.replace(settings, baud=request.baud)
    return dataclasses.replace(machine, stream=settings)


def _survey(program: Program, quiet: bool) -> Survey:
    shows = not quiet and sys.stderr.isatty()

    def progress(share: float) -> None:
        print(f"\rchecking {100 * share:3.0f} %", end="", file=sys.stderr, flush=True)

    found = survey(program, progress=progress if shows else None)
    if shows:
        print("\r\x1b[K", end="", file=sys.stderr)
    return found


def _refuse(program: Program, found: Survey) -> None:
    if found.errors:
        more = len(found.errors) - 1
        others = f" (and {more} more, listed above)" if more else ""
        first = str(found.errors[0]).removeprefix("error: ")
        raise InputError(f"{program.path}: {first}{others}")


def summary(program: Program, found: Survey) -> str:
    """What a file will do, for people."""
    lines = [f"{program.path.name} for {program.machine.title}"]
    if found.deposits is not None:
        (a, b, _), (x, y, z) = found.deposits
        lines.append(f"  size      {x - a:.1f} x {y - b:.1f} mm, up to z = {z:.2f} mm")
    lines.append(f"  layers    {len(found.layers)}")
    filament = f", {found.filament / 1000:.2f} m of filament" if found.filament else ""
    lines.append(f"  material  {found.volume / 1000:.2f} cm^3, {found.grams:.1f} g{filament}")
    lines.append(f"  time      {_clock(found.seconds)}, heating and homing on top")
    if found.nozzle or found.bed:
        lines.append(f"  heat      nozzle {found.nozzle:g}, bed {found.bed:g} degrees Celsius")
    lines += [f"  {finding}" for finding in found.findings]
    return "\n".join(lines)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


def _say(text: str, quiet: bool) -> None:
    if not quiet:
        print(text)


def _open(request: Request, machine: Machine) -> AbstractPort:
    name = request.port or ""
    if request.printed is not None:
        if not name.startswith(ports.VIRTUAL):
            raise InputError("--printed: only a virtual machine can save what it printed")
        name += ("&" if "?" in name else "?") + "record=1"
    return ports.open_port(name, machine)


def _keep_print(request: Request, program: Program, port: AbstractPort) -> None:
    from fdjax.machine.virtual.port import VirtualPort

    if request.printed is not None and isinstance(port, VirtualPort):
        assert port.machine.print is not None
        port.machine.print.write(request.printed, program)


def _reached(program: Program, digest: str, request: Request) -> int | None:
    """The line that a print had reached, from its journal; None where a layer is named instead."""
    if request.layer is not None:
        return None
    job, line, layer = read_journal(journal_of(program))
    if job.digest != digest:
        raise InputError(
            f"{program.path}: has changed since the print broke off; "
            "send the file of then, or name the layer with --layer"
        )
    _say(f"the machine had acknowledged line {line}, in layer {layer}", request.quiet)
    return line


def _go_on(
    program: Program, starts: list[int], reached: int | None, request: Request, stream: Stream
) -> Point:
    """Point the stream to where to go on, by where the machine says that it is."""
    place = stream.ask_position()
    if reached is None:
        point, kept = resume.at_layer(program, starts, request.layer or 0), request.kept_power
    else:
        points = resume.Points(program, starts, reached)
        here = points.at(place)
        kept = request.kept_power or here is not None
        point = here or (points.kept if kept else points.lost)
    how = "kept" if kept else "lost"
    text = f"the machine has {how} its position; going on in layer {point.layer}, "
    text += f"after line {point.line}"
    if not kept:
        text += (
            f"\nthe nozzle is taken to stand where it stopped, at z = {point.state.on_bed[2]:.3f} "
            "mm; X and Y will be homed, Z will not"
        )
    _say(text, request.quiet)
    stream.go_on(point, resume.way_back(point, program.machine, kept=kept))
    return point


def _confirm(request: Request, point: Point | None) -> None:
    if request.yes or (request.port or "").startswith(ports.VIRTUAL):
        return
    if not sys.stdin.isatty():
        raise InputError("nobody to ask whether to begin; --yes says so beforehand")
    question = "Begin" if point is None else f"Go on in layer {point.layer}"
    if input(f"{question}? [y/N] ").strip().lower() not in ("y", "yes"):
        raise InputError("not begun")


class _Records:
    """The journal, which tells where to go on after a crash, and the log, beside the file."""

    def __init__(self, program: Program, digest: str, request: Request, port: AbstractPort) -> None:
        self._path = journal_of(program)
        self._job = Job(program.path.name, digest, program.machine.name, request.port or "")
        self._port = port
        self._journal: Journal | None = None
        self.log = Log(request.log or program.path.with_name(f"{program.path.name}.log"))

    def begin(self, point: Point | None) -> None:
        """From now on the journal is this print's."""
        self._journal = Journal(self._path, self._job)
        if point is not None:
            self._journal.reached(point.line, point.layer, self._port.now())

    def take(self, event: Event) -> None:
        if self._journal is not None and event.kind in ("line", "layer"):
            self._journal.reached(event.line, event.layer, self._port.now())

    def finished(self) -> None:
        """There is nothing to go on with any more."""
        self._path.unlink(missing_ok=True)

    def __enter__(self) -> "_Records":
        return self

    def __exit__(self, *_: object) -> None:
        self.log.close()
        if self._journal is not None:
            self._journal.close()


class _Controls:
    """Ctrl-C aborts safely, a second one stops at once; lines typed at a terminal do more."""

    def __init__(self, stream: Stream, unattended: bool) -> None:
        self._stream = stream
        self._interrupts = 0
        self._typed = not unattended and sys.stdin.isatty()

    def __enter__(self) -> None:
        self._before = signal.signal(signal.SIGINT, self._interrupt)
        self._term = signal.signal(signal.SIGTERM, self._interrupt)
        if self._typed:
            print("p: pause, r: resume, a: abort, !: emergency stop (each with Enter)")
            threading.Thread(target=self._listen, daemon=True).start()

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._before)
        signal.signal(signal.SIGTERM, self._term)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        self._interrupts += 1
        if self._interrupts == 1:
            self._stream.abort()
        else:
            self._stream.emergency_stop()

    def _listen(self) -> None:
        orders = {
            "p": self._stream.pause,
            "r": self._stream.resume,
            "a": self._stream.abort,
            "!": self._stream.emergency_stop,
        }
        for line in sys.stdin:
            order = orders.get(line.strip().lower())
            if order is not None:
                order()


class _Progress:
    """One line: layer, share, time left, temperatures; faults and messages above it."""

    _BAR = 24

    def __init__(self, found: Survey, quiet: bool) -> None:
        self._survey = found
        self._quiet = quiet
        self._in_place = sys.stderr.isatty()
        self._heat: dict[str, tuple[float, float]] = {}
        self._shown = ""

    def __call__(self, event: Event) -> None:
        self._heat.update(event.values)
        if self._quiet:
            return
        if event.kind in ("fault", "state") or (event.kind == "message" and self._matters(event)):
            self._print(event.text, end="\n")
        elif self._in_place or event.kind in ("layer", "done"):
            line = self._line(event)
            if line != self._shown:
                self._shown = line
                self._print(line, end="" if self._in_place else "\n")

    @staticmethod
    def _matters(event: Event) -> bool:
        return event.text.startswith(("waiting", "it cannot", "the port"))

    def _print(self, text: str, end: str) -> None:
        start = "\r\x1b[K" if self._in_place else ""
        print(start + text, end=end, file=sys.stderr, flush=True)

    def _line(self, event: Event) -> str:
        left = 0.0 if event.kind == "done" else self._left(event.line, event.layer)
        share = 1 - left / self._survey.seconds if self._survey.seconds else 0.0
        bar = "#" * round(self._BAR * share)
        heat = "".join(f"  {k} {a:.0f}/{w:.0f}" for k, (a, w) in self._heat.items())
        layers = f"layer {event.layer}/{len(self._survey.layers)}"
        return f"{layers}  [{bar:.<{self._BAR}}] {100 * share:3.0f} %  {_clock(left)} left{heat}"

    def _left(self, line: int, layer: int) -> float:
        """Seconds of motion after a line, evenly over the lines of its layer."""
        layers, total = self._survey.layers, self._survey.seconds
        first, began = (layers[layer - 1].line, layers[layer - 1].seconds) if layer else (1, 0.0)
        last, ends = (
            (layers[layer].line, layers[layer].seconds)
            if layer < len(layers)
            else (self._survey.lines + 1, total)
        )
        done = (line - first + 1) / max(last - first, 1)
        return max(total - began - min(done, 1.0) * (ends - began), 0.0)

    def close(self) -> None:
        if self._in_place and not self._quiet:
            print(file=sys.stderr)
