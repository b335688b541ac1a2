"""A stream: a program going to a machine, line by line, under control, with events."""

import contextlib
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fdjax.errors import InputError, StreamError
from fdjax.formats import profile
from fdjax.formats.profile import Machine
from fdjax.gcode.state import MOTION, GcodeState
from fdjax.gcode.words import command_of
from fdjax.machine import connect
from fdjax.machine.control import Commands, commands_of
from fdjax.machine.entry import Entry, entry_of
from fdjax.machine.port import AbstractPort, PortLost
from fdjax.machine.ports import open_port
from fdjax.machine.program import Command, Program, State
from fdjax.machine.protocols import AbstractProtocol
from fdjax.machine.protocols.base import position
from fdjax.machine.resume import Point
from fdjax.machine.survey import survey
from fdjax.moves import Position

TICK = 0.1
"""Seconds after which controls are looked at, at the latest."""
RETURN = 60.0
"""Seconds that a lost port is waited for."""
POLL = 5.0
"""Seconds after which the temperatures are asked for again."""


@dataclass(frozen=True)
class Event:
    """What happened: `kind` is line, layer, temperature, fault, message, state or done.

    - `line`: of the file, the last that was acknowledged; `layer`: that it lies in, from 1.
    - `text`: for people; `values`: temperatures, actual and wanted, by heater.
    """

    kind: str
    line: int
    layer: int
    text: str = ""
    values: dict[str, tuple[float, float]] = field(default_factory=dict)


Listener = Callable[[Event], None]


class Stream:
    """Sends a program through a port, each line once and in order, as its protocol guarantees.

    - `starts`: file lines at which layers begin (of a `Survey`).
    - `on_event`: called in the stream's thread. `log`: called with time, way (> or <) and bytes.

    `run` returns when all has run, or raises `StreamError`. `pause`, `resume`, `abort` and
    `emergency_stop` may be called from any thread.
    """

    def __init__(
        self,
        program: Program,
        port: AbstractPort,
        speaks: AbstractProtocol,
        *,
        starts: Sequence[int] = (),
        on_event: Listener = lambda event: None,
        log: Callable[[float, str, bytes], None] = lambda time, way, data: None,
    ) -> None:
        self.program = program
        self.port = port
        self.protocol = speaks
        self.state = program.state(speaks.firmware)
        self._after = 0  # the last line of the file that is not sent
        self._aside: State = program.state(
            speaks.firmware
        )  # while lines are sent that are not the file's
        self._starts = list(starts)
        self._extra: deque[str] = deque()
        self._interrupted = False  # other motions than the file's have been sent since its last
        self._on_event = on_event
        self._log = log
        self._commands: Iterator[Command] = program.commands()
        self._next: Command | None = None
        self._read = False  # the file, to its end
        self._orders: deque[str] = deque()
        self._paused = False
        self._aborting = False
        self._sent = self._told = 0
        self._told_layer = 0
        self._polled = 0.0
        self._control: Commands = commands_of(speaks.firmware)

    @classmethod
    def open(
        cls,
        path: str | Path,
        machine: Machine | str | Path,
        port: str,
        *,
        on_event: Listener = lambda event: None,
    ) -> "Stream":
        """A stream of a file through the port of a name, as `/dev/ttyUSB0` or `virtual:marlin`.

        `machine` is a profile, its name or its path. The whole file is checked first. Raises
        `InputError` for a file that must not be sent, and for a port that cannot be used.
        """
        if not isinstance(machine, Machine):
            machine = profile.load(machine)
        program = Program(Path(path), machine)
        found = survey(program)
        found.refuse(program.path)
        line = open_port(port, machine)
        settled = connect.settled(line, machine)
        if settled is not machine:
            program = Program(program.path, settled)
            found = survey(program)
            found.refuse(program.path)
        speaks = connect.protocol_of(settled)
        return cls(program, line, speaks, starts=found.starts, on_event=on_event)

    # What other threads may call.

    def pause(self) -> None:
        """Stop sending; once the machine stands still, park it."""
        self._order("pause")

    def resume(self) -> None:
        """Go back to where the pause began, and on."""
        self._order("resume")

    def abort(self) -> None:
        """End the print: motion stops, heaters and flow go off."""
        self._order("abort")

    def emergency_stop(self) -> None:
        """Stop everything at once, whatever the machine is doing; it wants a reset then."""
        self._order("stop")

    def _order(self, what: str) -> None:
        self._orders.append(what)

    @property
    def paused(self) -> bool:
        """Whether a pause was asked for and not ended."""
        return self._paused

    @property
    def line(self) -> int:
        """The last file line that was acknowledged."""
        return self.protocol.line or self._after

    def layer_of(self, line: int) -> int:
        """The layer that a file line lies in, from 1; 0 before the first."""
        return bisect_right(self._starts, line)

    # The loop.

    def connect(self) -> None:
        """Open the conversation. Raises `InputError` where nobody answers, or not as expected."""
        heard = bytearray()
        self.protocol.open(self.port.now())
        try:
            while not self.protocol.ready or self.protocol.pending:
                heard += self._exchange()
        except StreamError:
            raise InputError(
                connect.unanswered(
                    bytes(heard), self.protocol.firmware, self.program.machine.stream.baud
                )
            ) from None
        connect.check(self.protocol.firmware, self.protocol.facts, self.program.machine)
        self._polled = self.port.now()

    def go_on(self, point: Point, way_back: Sequence[str]) -> None:
        """Begin after a point of the file, with the lines that bring the machine back there."""
        self.state = point.state.copy()
        self._after = self._sent = self._told = point.line
        self._commands = self.program.commands(point.line)
        self._next, self._read = None, False  # the file's first line may have been looked at
        self._extra.extend(way_back)

    def ask_position(self) -> Position | None:
        """Where the machine says that it is, before the file is begun; None if it does not say."""
        if not self._control.asks_heat:
            return None
        self._push("M114", 0, self.port.now())
        places: list[str] = []
        while self.protocol.pending:
            self._exchange(places.append)
        return position(places[-1]) if places else None

    def run(self) -> None:
        """Send everything. Raises `StreamError`, which names the lines, where that fails."""
        if not self.protocol.ready:
            self.connect()
        try:
            while not self._is_over():
                self._obey()
                self._fill()
                self._exchange()
        except StreamError as error:
            self._fail(error)
        except PortLost as lost:
            self._fail(StreamError(str(lost)))
        except BaseException:
            self._turn_off()
            raise
        if self._aborting:
            self._fail(StreamError("aborted: motion has stopped, heaters and flow are off"))
        self._say(self.protocol.farewell())
        self._tell("done", "the file has been run")

    def _is_over(self) -> bool:
        if not self._read or self._extra or self._paused:
            return False
        self.protocol.finish(self.port.now())
        return self.protocol.finished

    def _fill(self) -> None:
        """Send as many lines as there is room for."""
        now = self.port.now()
        asks = self._control.asks_heat and now - self._polled >= POLL and not self._extra
        if asks and self.protocol.room("M105"):
            self._polled = now
            here = (self._aside if self._paused else self.state).position
            self.protocol.push(Entry("M105", before=here, after=here, repeatable=True), now)
        while True:
            text, line = self._peek()
            if text is None or not self.protocol.room(text):
                return
            if line:
                self._next, self._sent = None, line
                self._interrupted = self._interrupted and command_of(text)[0] not in MOTION
            else:
                self._extra.popleft()
                self._interrupted = isinstance(self.state, GcodeState)
            self._push(text, line, now)

    def _peek(self) -> tuple[str | None, int]:
        """What would be sent next, and its line in the file or 0."""
        if self._extra:
            return self._extra[0], 0
        if self._paused or self._aborting:
            return None, 0
        if self._next is None and not self._read:
            try:
                self._next = next(self._commands, None)
            except InputError as error:  # the file has changed
                raise StreamError(str(error)) from None
            self._read = self._next is None
        if self._next is None:
            return None, 0
        text = self._next.text
        if text[0] not in "GMTgmt":
            return self._named(text), self._next.line
        return self._next

    def _named(self, text: str) -> str:
        """A command of the file; words that go on with a motion have its name, where it may not be
        the one that the machine made last, or the firmware does not go on with any.
        """
        state = self.state
        if not isinstance(state, GcodeState) or command_of(text)[0]:
            return text
        sure = state.firmware.modal and not self._interrupted
        return text if sure else f"{state.motion} {text}"

    def _push(self, text: str, line: int, now: float) -> None:
        state = self.state if line else self._aside
        try:
            entry = entry_of(text, line, state)
        except InputError as error:
            changed = self.program.has_changed  # and the line was cut off
            why = "the file has changed" if changed else f"line {line}: {error}"
            raise StreamError(why) from None
        self.protocol.push(entry, now)

    def _exchange(self, on_position: Callable[[str], object] = lambda text: None) -> bytes:
        """Write what there is, read what comes, and do what is due; what came."""
        speaks, port = self.protocol, self.port
        try:
            now = port.now()
            speaks.tick(now)
            self._flush()
            wait = min(max(speaks.deadline - now, 0.0), TICK)
            # With room for more lines there is no reason to wait.
            data = port.read(0.0 if self._could_send() else wait)
        except PortLost as lost:
            self._come_back(lost)
            return b""
        now = port.now()
        if data:
            self._log(now, "<", data)
            speaks.feed(data, now)
        self._report(on_position)
        return data

    def _could_send(self) -> bool:
        text, _ = self._peek()
        return text is not None and self.protocol.room(text)

    def _flush(self) -> None:
        out = self.protocol.out
        if out:
            data = bytes(out)
            out.clear()
            self.port.write(data)
            self._log(self.port.now(), ">", data)

    def _come_back(self, lost: PortLost) -> None:
        """Wait for the port; only numbered lines tell afterwards what has arrived."""
        if self.protocol.firmware != "marlin" or not self.protocol.pushed:
            raise self.protocol.stopped(str(lost))
        self._tell("fault", f"{lost}; waiting for it to come back")
        until = self.port.now() + RETURN
        self.protocol.out.clear()
        while not self.port.reopen():
            if {"stop", "abort"} & set(self._orders):
                raise self.protocol.stopped(f"{lost}; nothing more can be said to the machine")
            if self.port.now() >= until:
                raise self.protocol.stopped(f"{lost}, and has not come back")
            self.port.wait(0.5)
        self.protocol.doubt(self.port.now())
        self._tell("state", "the port is back")

    def _report(self, on_position: Callable[[str], object]) -> None:
        while self.protocol.notes:
            note = self.protocol.notes.popleft()
            if note.kind == "position":
                on_position(note.text)
            kind = note.kind if note.kind in ("temperature", "fault") else "message"
            self._tell(kind, note.text, note.values)
        line = self.line
        if line != self._told:
            self._told = line
            self._tell("line")
            layer = self.layer_of(line)
            if layer != self._told_layer:
                self._told_layer = layer
                self._tell("layer", f"layer {layer}")

    def _tell(self, kind: str, text: str = "", values: dict | None = None) -> None:
        line = self.line
        self._on_event(Event(kind, line, self.layer_of(line), text, values or {}))

    # Controls.

    def _obey(self) -> None:
        while self._orders:
            order = self._orders.popleft()
            if order == "stop":
                self._say_bare(self._control.stop)
                raise self.protocol.stopped("emergency stop: reset the machine before all else")
            if order == "abort" and not self._aborting:
                self._begin_abort()
            elif order == "pause" and not self._paused and not self._aborting:
                self._paused = True
                self._aside = self.state.copy()
                self._extra.extend(self._control.park(self.state, self.program.machine))
                self._tell("state", "paused")
            elif order == "resume" and self._paused:
                self._paused = False
                self._extra.extend(self._control.unpark(self.state, self.program.machine))
                self._tell("state", "resumed")

    def _begin_abort(self) -> None:
        self._aborting, self._paused, self._read = True, False, True
        self._next = None
        self._aside = self.state.copy()
        self._extra.clear()
        self._tell("state", "aborting")
        interruption = self._control.interrupt(self.protocol.facts)
        if interruption:
            self._say(interruption)
        else:
            self._tell("state", "it cannot be interrupted: waiting for what it is doing to end")
        if self._control.ends_at_once:
            raise self.protocol.stopped("aborted: motion has stopped, heaters and flow are off")
        self._extra.extend(self._control.end(self.state, self.program.machine))

    def _say_bare(self, lines: Sequence[str]) -> None:
        # What was begun before ends first.
        self._say(b"\n" + b"".join(self.protocol.bare(line) for line in lines))

    def _say(self, data: bytes) -> None:
        """Write at once, before and beside all lines."""
        self._flush()
        self.port.write(data)
        self._log(self.port.now(), ">", data)

    # Ends.

    def _fail(self, error: StreamError) -> None:
        """Turn off what can be turned off, and say where the stream ended."""
        line = error.line or (self.protocol.proven_line or self._after) + 1
        sent = self._sent
        acknowledged = self.line
        self._turn_off()
        raise StreamError(
            f"{self.program.path.name}, line {line}: {error}; lines before it were run, "
            f"{acknowledged} was the last acknowledged and {sent} the last sent",
            line=line,
            sent=sent,
        ) from None

    def _turn_off(self) -> None:
        """No heater or flow stays on for want of a sender."""
        with contextlib.suppress(PortLost):
            self._say_bare(self._control.off(self.state, self.program.machine))
