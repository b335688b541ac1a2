"""`fdjax send`: check a file, show what it will do, stream it, and remember how far it came."""

import contextlib
import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path

from fdjax.app.console import Controls, Progress, clock
from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.formats.profile import Machine
from fdjax.machine import connect, ports, resume
from fdjax.machine.journal import Job, Journal, Log, beside
from fdjax.machine.journal import read as read_journal
from fdjax.machine.port import AbstractPort
from fdjax.machine.program import Program
from fdjax.machine.resume import Point, Standing
from fdjax.machine.stream import Event, Stream
from fdjax.machine.survey import survey
from fdjax.machine.surveyed import Survey


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
    _keep_apart(request)
    program = Program(request.file, machine)
    found = _survey(program, request.quiet)
    _say(summary(program, found), request.quiet)
    found.refuse(program.path)
    if request.dry_run:
        return
    if request.port is None:
        raise InputError(f"--port: name the machine's port; there are {ports.listing()}")
    goes_on = request.resume or request.layer is not None
    digest = program.digest()
    reached = _reached(program, digest, request) if goes_on else None
    port = _open(request, machine)
    try:
        settled = connect.settled(port, machine)
        if settled is not machine:  # the file is read as the firmware reads it
            program = Program(request.file, settled)
            found = _survey(program, request.quiet)
            found.refuse(program.path)
        speaks = connect.protocol_of(settled)
        progress = Progress(found, request.quiet)
        with _Records(program, digest, request, port) as records:

            def on_event(event: Event) -> None:
                records.take(event)
                progress(event)

            stream = Stream(
                program, port, speaks, starts=found.starts, on_event=on_event, log=records.log
            )
            point = None
            if goes_on:
                stream.connect()
                point = _go_on(program, found.starts, reached, request, stream)
            _confirm(request, point)
            records.begin(point)
            try:
                with Controls(stream, request.yes):
                    stream.run()
            finally:
                progress.close()
                _keep_print(request, program, port)
            records.finished()
    finally:
        port.close()


def _keep_apart(request: Request) -> None:
    """The file is read while others are written: none of them may be another."""
    used = [request.file, beside(request.file, "journal")]
    log = request.log or beside(request.file, "log")
    for name, path in (("--log", log), ("--printed", request.printed)):
        if path is None:
            continue
        if path.absolute().resolve() in [other.absolute().resolve() for other in used]:
            raise InputError(f"{name} {path}: is in use; name another file")
        if path.is_dir() or not path.absolute().parent.is_dir():
            raise InputError(f"{name} {path}: cannot be written")
        used.append(path)


def _machine(request: Request) -> Machine:
    machine = profile.load(request.machine)
    settings = machine.stream
    if request.firmware is not None:
        settings = dataclasses.replace(settings, firmware=request.firmware)
    if request.baud is not None:
        if not 300 <= request.baud <= 4_000_000:
            raise InputError(f"--baud: {request.baud}; 300 to 4000000 can be")
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


def summary(program: Program, found: Survey) -> str:
    """What a file will do, for people."""
    lines = [f"{program.path.name} for {program.machine.title}"]
    if found.deposits is not None:
        (a, b, _), (x, y, z) = found.deposits
        lines.append(f"  size      {x - a:.1f} x {y - b:.1f} mm, up to z = {z:.2f} mm")
    lines.append(f"  layers    {len(found.layers)}")
    filament = f", {found.filament / 1000:.2f} m of filament" if found.filament else ""
    lines.append(f"  material  {found.volume / 1000:.2f} cm^3, {found.grams:.1f} g{filament}")
    lines.append(f"  time      {clock(found.seconds)}, heating and homing on top")
    if found.nozzle or found.bed:
        lines.append(f"  heat      nozzle {found.nozzle:g}, bed {found.bed:g} degrees Celsius")
    lines += [f"  {finding}" for finding in found.findings]
    return "\n".join(lines)


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
    """The line that a print had reached, from its journal; None where there is none to be had.

    A named layer does without, but the journal still tells at which height the nozzle stopped.
    """
    try:
        job, line, layer = read_journal(beside(program.path, "journal"))
    except InputError:
        if request.layer is not None:
            return None
        raise
    if job.digest != digest:
        if request.layer is not None:
            return None
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
    points = None if reached is None else resume.Points(program, starts, reached)
    here = None if points is None else points.at(place)
    stands = Standing.HERE if request.kept_power else resume.standing(place, here)
    if request.layer is not None:
        point = resume.at_layer(program, starts, request.layer)
    elif points is None:
        raise AssertionError("a line or a layer is given")
    else:
        point = here or (points.lost if stands is Standing.LOST else points.kept)
    height = points.lowest if points is not None else point.state.on_bed[2]
    text = f"the machine {stands.value}; going on in layer {point.layer}, after line {point.line}"
    if stands is Standing.LOST:
        text += (
            f"\nthe nozzle is taken to stand where it stopped, at z = {height:.3f} mm; X and Y "
            "will be homed, Z will not"
        )
    elif place is not None and place[2] is not None:
        height = place[2]
    _say(text, request.quiet)
    extruder = stream.protocol.firmware != "grbl"
    if stands is Standing.LOST:
        resume.must_be_saved(program, point)
    back = resume.way_back(
        point,
        program.machine,
        stands,
        height=height,
        top=0.0 if points is None else points.top,
        waits=None if points is None else points.waits,
        extruder=extruder,
    )
    stream.go_on(point, back)
    return point


def _confirm(request: Request, point: Point | None) -> None:
    if request.yes or (request.port or "").startswith(ports.VIRTUAL):
        return
    if not sys.stdin.isatty():
        raise InputError("nobody to ask whether to begin; --yes says so beforehand")
    question = "Begin" if point is None else f"Go on in layer {point.layer}"
    print(f"{question}? [y/N] ", end="", flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError("not begun")


def _warn(text: str) -> None:
    with contextlib.suppress(OSError):
        print(f"fdjax: warning: {text}", file=sys.stderr)


class _Records:
    """The journal, which tells where to go on after a crash, and the log, beside the file."""

    def __init__(self, program: Program, digest: str, request: Request, port: AbstractPort) -> None:
        self._path = beside(program.path, "journal")
        self._job = Job(program.path.name, digest, program.machine.name, request.port or "")
        self._port = port
        self._journal: Journal | None = None
        path = request.log or beside(program.path, "log")
        self.log = Log(path, more=request.resume or request.layer is not None, on_failure=_warn)

    def begin(self, point: Point | None) -> None:
        """From now on the journal is this print's."""
        line, layer = (0, 0) if point is None else (point.line, point.layer)
        self._journal = Journal(self._path, self._job, line, layer)

    def take(self, event: Event) -> None:
        if self._journal is not None and event.kind in ("line", "layer"):
            try:
                self._journal.reached(event.line, event.layer, self._port.now())
            except OSError as error:
                _warn(f"the journal cannot be written ({error.strerror}); going on without")
                self._journal = None

    def finished(self) -> None:
        """There is nothing to go on with any more."""
        self._path.unlink(missing_ok=True)

    def __enter__(self) -> "_Records":
        return self

    def __exit__(self, *_: object) -> None:
        self.log.close()
        if self._journal is not None:
            self._journal.close()
