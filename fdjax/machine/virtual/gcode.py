"""What the virtual G-code machines share: heaters, motion, answers to common commands."""

from collections import deque

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import parse
from fdjax.machine.program import switched_on
from fdjax.machine.virtual.base import AbstractVirtualMachine

AMBIENT = 21.0
_HEATING = {"T": 2.0, "B": 0.5}
"""Degrees a second."""
COLDEST = 170.0
"""Below it the nozzle pushes nothing."""
_WAITS = frozenset({"M109", "M190", "G28", "G4", "M400"})
_MOVES = ("G0", "G1", "G2", "G3")
_KNOWN = frozenset(
    f"{letter}{number}"
    for letter, numbers in (
        ("G", (0, 1, 2, 3, 4, 17, 18, 19, 20, 21, 28, 90, 91, 92)),
        ("M", (0, 18, *range(82, 85), *range(104, 108), 109, 110, 112, 114, 115, 117, 118, 140)),
        ("M", (155, 190, 201, 203, 204, 205, 220, 221, 400, 575)),
        ("T", (0, 1)),
    )
    for number in numbers
)


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
        self.bed = machine.bed
        self.state = self._fresh()
        self.heaters = self._heaters()
        self._queue: deque[str] = deque()  # lines accepted, frames included
        self._current: str | None = None
        self._until = 0.0  # when the current line is done

    def _heaters(self) -> dict[str, Heater]:
        faster = 1 / self.pace if self.pace else 1e6
        return {name: Heater(rate * faster) for name, rate in _HEATING.items()}

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
        self.say("ok")

    def _text(self, line: str) -> str:
        """A queued line without its frame."""
        return line

    def _begin(self, line: str) -> float:
        """Run a line; when it is done."""
        text = self._text(line)
        try:
            name, words = parse(text)
        except InputError:
            self._refuse(text)
            return self.now
        if self._answers_to(name, words):
            return self.now
        if name not in _KNOWN:
            self._refuse(text)
            return self.now
        if name in _MOVES and not self.state.homed.issuperset(words.keys() & set("XYZ")):
            refusal = self._refuse_unhomed()
            if refusal:
                self.say(refusal)
                return self.now
        self.ran(text)
        return self._run(name, words, text)

    def _refuse_unhomed(self) -> str:
        """What is said to a move of axes that have not been homed; nothing where it is made."""
        return ""

    def _refuse(self, text: str) -> None:
        self.say(f'echo:Unknown command: "{text}"')

    def _run(self, name: str, words: dict[str, float], text: str) -> float:
        state = self.state
        until = self._make(self._limited(state.run(text)))
        if name in ("M104", "M109"):
            self.heaters["T"].set(state.nozzle, self.now)
        elif name in ("M140", "M190"):
            self.heaters["B"].set(state.bed, self.now)
        if name in _WAITS:
            until = self.rest_at
        if name in ("M109", "M190"):
            until += self.heaters["T" if name == "M109" else "B"].wait(self.now)
        return until

    def _limited(self, moves: tuple) -> tuple:
        """Cold nozzles push nothing, and soft end stops clamp."""
        if not moves:
            return moves
        pushes = any(move.volume > 0 for move in moves) and not self.state.power
        if pushes and self.heaters["T"].at(self.now) < COLDEST:
            self.say("echo: cold extrusion prevented")
            moves = tuple(move._replace(volume=0.0) for move in moves)
        x, y, z = (
            min(max(place, 0.0), size)
            for place, size in zip(self.state.on_bed, self.bed, strict=True)
        )
        self.state.on_bed = (x, y, z)
        return moves

    def _answers_to(self, name: str, words: dict[str, float]) -> bool:
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
        parts = [
            f"{name}:{heater.at(self.now):.1f} /{heater.target:.1f}"
            for name, heater in self.heaters.items()
        ]
        return " ".join(parts)

    def _identity(self) -> str:
        return f"FIRMWARE_NAME:{self.firmware}"
