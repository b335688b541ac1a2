"""What the virtual G-code machines share: heaters, motion, answers to common commands."""

from collections import deque

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.gcode.commands import knows
from fdjax.gcode.settings import said
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import command_of
from fdjax.machine.program import switched_on
from fdjax.machine.virtual.base import AbstractVirtualMachine

AMBIENT = 21.0
_NOZZLE, _BED = 2.0, 0.5
"""Degrees a second, of each nozzle and of the bed."""
_WAITS = frozenset({"M109", "M190", "G28", "G4", "M400"})
_MOVES = ("G0", "G1", "G2", "G3")
_ALL = frozenset("XYZ")


class Heater:
    """A heater that warms and cools at a steady rate."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._from, self.target, self._since = AMBIENT, 0.0, 0.0

    def set(self, target: float, now: float) -> None:
        self._from, self.target, self._since = self.at(now), target, now

    def at(self, now: float) -> float:
        """Its temperature."""
        goal = max(self.target, AMBIENT)
        change = self._rate * (now - self._since)
        if goal > self._from:
            return min(goal, self._from + change)
        return max(goal, self._from - change)

    def wait(self, now: float) -> float:
        """Seconds until it is warm enough."""
        return max(0.0, self.target - self.at(now)) / self._rate


def _nozzles(state: GcodeState) -> dict[str, float]:
    return {f"T{tool}": heat for tool, heat in state.nozzles.items()}


class AbstractGcodeMachine(AbstractVirtualMachine):
    """A machine that runs one G-code line after the other.

    Its bed, with soft end stops at its edges, and its filament are those of a profile.
    """

    firmware: str
    dialect: str
    """Name of the firmware whose reading of G-code it has."""
    queue_length = 4

    def __init__(self, machine: Machine, **options) -> None:
        super().__init__(machine, **options)
        self.room = machine.room
        self.tools, self._nozzles = 1, 1
        if machine.gcode is not None:
            self.tools, self._nozzles = machine.gcode.tools, machine.gcode.heaters
        self.coldest = machine.stream.coldest
        self.state = self._fresh()
        self.heaters = self._heaters()
        self._queue: deque[str] = deque()  # lines accepted, frames included
        self._current: str | None = None
        self._until = 0.0  # when the current line is done

    def _heaters(self) -> dict[str, Heater]:
        """By the names of reports: B, and T0, T1, ... of the nozzles."""
        faster = 1 / self.pace if self.pace else 1e6
        nozzles = {f"T{tool}": Heater(_NOZZLE * faster) for tool in range(self._nozzles)}
        return {"B": Heater(_BED * faster), **nozzles}

    def _fresh(self) -> GcodeState:
        return switched_on(self.machine, self.dialect)

    def _forget(self) -> None:
        self.state = self._fresh()
        self.heaters = self._heaters()
        self._queue.clear()
        self._current = None

    def _due(self) -> float:
        return self._until if self._current is not None else float("inf")

    def _work(self) -> None:
        while True:
            if self._current is not None:
                if self.now < self._until:
                    return
                line, self._current = self._current, None
                self._acknowledge(line)
            self._accept()
            if not self._queue:
                return
            self._current = self._queue.popleft()
            self._until = self._begin(self._current)

    def _accept(self) -> None:
        """Take lines from the receive buffer while the queue has room."""

    def _acknowledge(self, line: str) -> None:
        if not self._has_answered(line):
            self.say("ok")

    def _has_answered(self, line: str) -> bool:
        """Whether the answer to a line was its acknowledgement too: `ok T:...`."""
        return "M105" in line and self._text(line).startswith("M105")

    def _text(self, line: str) -> str:
        """A queued line without its frame."""
        return line

    def _begin(self, line: str) -> float:
        """Run a line; when it is done."""
        text = self._text(line)
        if text[:3] in ("G1 ", "G0 ") and self.state.homed == _ALL:  # in a hurry
            return self._try("G1", {}, text)
        try:
            name, at = command_of(text)
        except InputError:
            self._refuse(text)
            return self.now
        words = said(text, at)
        if self._answers_to(name):
            return self.now
        if not self._knows(name):
            self._refuse(text)
            return self.now
        if name in _MOVES and not self.state.homed.issuperset(words.keys() & set("XYZ")):
            refusal = self._refuse_unhomed()
            if refusal:
                self.say(refusal)
                return self.now
        return self._try(name, words, text)

    def _try(self, name: str, words: dict[str, str], text: str) -> float:
        """Run a command, or say why not; when it is done."""
        try:
            until = self._run(name, words, text)
        except InputError as error:
            self._complain(str(error))
            return self.now
        self.ran(text)
        return until

    def _knows(self, name: str) -> bool:
        if name[:1] == "T" and name[1:].isdigit():
            return int(name[1:]) < self.tools
        return knows(self.state.firmware, name)

    def _refuse_unhomed(self) -> str:
        """What is said to a move of axes that have not been homed; nothing where it is made."""
        return ""

    def _complain(self, why: str) -> None:
        """Answer a line that is of the language and cannot be run."""
        self.say(f"Error:{why}")

    def _refuse(self, text: str) -> None:
        self.say(f'echo:Unknown command: "{text}"')

    def _run(self, name: str, words: dict[str, str], text: str) -> float:
        state = self.state
        place, e = state.on_bed, state.e
        try:
            moves = self._limited(state.run(text))
        except InputError:
            state.on_bed, state.e = place, e  # what is refused is not made
            raise
        until = self._make(moves)
        if name in _MOVES:
            return until
        for heater, target in {**_nozzles(state), "B": state.bed}.items():
            if heater in self.heaters and self.heaters[heater].target != target:
                self.heaters[heater].set(target, self.now)
        if name in _WAITS:
            until = self.rest_at
        if name in ("M109", "M190"):
            nozzle = f"T{state.heater if state.one_nozzle else words.get('T', state.tool)}"
            heater = self.heaters.get("B" if name == "M190" else nozzle)
            until += heater.wait(self.now) if heater is not None else 0.0
        return until

    def _limited(self, moves: tuple) -> tuple:
        """Cold nozzles push nothing, and soft end stops clamp."""
        if not moves:
            return moves
        pushes = moves[-1].volume > 0 and not self.state.power  # all of a line, or none
        if pushes and self._is_cold():
            self.say("echo: cold extrusion prevented")
            moves = tuple(move._replace(volume=0.0) for move in moves)
        self._clamp()
        return moves

    def _clamp(self) -> None:
        """Soft end stops, which look at the place on the bed."""
        (x, y, z), ((a, b, c), (d, e, f)) = self.state.on_bed, self.room
        if not (a <= x <= d and b <= y <= e and c <= z <= f):
            self.state.on_bed = (min(max(x, a), d), min(max(y, b), e), min(max(z, c), f))

    def _is_cold(self) -> bool:
        least = self.coldest if self.state.coldest is None else self.state.coldest
        heater = self.heaters.get(f"T{self.state.heater}")
        return heater is not None and heater.at(self.now) < least

    def _answers_to(self, name: str) -> bool:
        """Whether a command is a question, which is answered."""
        if name == "M105":
            self.say(self._temperatures())
        elif name == "M114":
            x, y, z, e = (getattr(self.state, axis) for axis in "xyze")
            self.say(self._place(x, y, z, e))
        elif name == "M115":
            self.say(self._identity())
        else:
            return False
        return True

    def _place(self, x: float, y: float, z: float, e: float) -> str:
        return f"X:{x:.3f} Y:{y:.3f} Z:{z:.3f} E:{e:.3f}"

    def _temperatures(self) -> str:
        """Of the nozzle in use first, as Marlin says it; of each where there are several."""
        bed, *nozzles = (
            (name, f"{heater.at(self.now):.1f} /{heater.target:.1f}")
            for name, heater in self.heaters.items()
        )
        used = f"T:{nozzles[self.state.tool % len(nozzles)][1]}"
        more = [f"{name}:{text}" for name, text in nozzles] if len(nozzles) > 1 else []
        return " ".join([used, f"B:{bed[1]}", *more])

    def _identity(self) -> str:
        return f"FIRMWARE_NAME:{self.firmware}"
