"""The state that SML changes: where the head is, what flows, and how it got there.

The language is that of `formats.sml_reader`; its facts and its assumptions are the profile's. One
interpreter for the check before sending, the time that is left and the virtual machine.
"""

import math
import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, pairwise

from fdjax.arcs import arc_points
from fdjax.errors import InputError
from fdjax.formats.profile import Sml
from fdjax.moves import Move, Point
from fdjax.units import MICROSTEP

_COMMAND = re.compile(r"([A-Za-z]{2})([-+.,\d\s]*)")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
_PASSED_OVER = frozenset({"CD", "CZ", "SP", "TD"})
_LONGEST = 1000
"""Characters of one command; more have lost their semicolons."""
_SLOWEST = 1e-3
_FARTHEST = 100_000
"""Microsteps from 0 to where an arc may lie; the language holds a third of it."""
HOMING_SPEED = 40.0
"""mm/s, assumed of finding home (FH)."""


@dataclass(slots=True)
class SmlState:
    """A machine between two lines; `x`, `y`, `z` in microsteps, speeds in microsteps/s.

    - `delay`, `delay_code`: seconds of flow before each move (PD), and its code.
    - `outputs`: flow changes during each move (MM): place in microsteps, code.
    - `path`: points of the continuous path since BC, None outside.
    - `material`: index into the profile's `materials`, None before one is chosen.
    """

    sml: Sml
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    rate: float = 10000.0
    acceleration: float = 193.0
    delay: float = 0.0
    delay_code: int = 0
    outputs: tuple[tuple[int, int], ...] = ()
    suspended: bool = False
    path: tuple[tuple[float, float], ...] | None = None
    material: int | None = None
    homed: bool = False
    rest: str = field(default="")

    @property
    def position(self) -> tuple[float, float, float, float]:
        """x, y, z in mm, and 0: no part of SML counts material."""
        x, y, z = self.on_bed
        return x, y, z, 0.0

    @property
    def placed(self) -> bool:
        """Whether it has been homed, so that it can leave and return."""
        return self.homed

    @property
    def on_bed(self) -> Point:
        return self.x * MICROSTEP, self.y * MICROSTEP, self.z * MICROSTEP

    def copy(self) -> "SmlState":
        return replace(self)

    def run(self, text: str) -> tuple[Move, ...]:
        """Take the state past a line; the moves that it makes. A command may span lines.

        Raises `InputError` for what is no command.
        """
        *commands, self.rest = (self.rest + text).split(";")
        if len(self.rest) > _LONGEST:
            start, self.rest = self.rest[:30], ""
            raise InputError(f"{start!r} has no semicolon")
        moves: tuple[Move, ...] = ()
        for command in commands:
            moves += self._command(command.strip().removeprefix(self.sml.mark).strip())
        return moves

    def _command(self, command: str) -> tuple[Move, ...]:
        if not command:
            return ()
        match = _COMMAND.fullmatch(command)
        if match is None or _NUMBER.sub("", match[2]).strip(", \t\r\n"):
            raise InputError(f"{command[:30]!r} is no two letters with numbers")
        name = match[1].upper()
        numbers = [float(number) for number in _NUMBER.findall(match[2])]
        try:
            return self._act(name, numbers, command)
        except (IndexError, ValueError, OverflowError):
            raise InputError(f"{command[:30]!r} lacks a number, or one is too large") from None

    def _act(self, name: str, numbers: list[float], command: str) -> tuple[Move, ...]:
        if name in ("MA", "MR"):
            x, y = numbers
            if name == "MR":
                x, y = self.x + x, self.y + y
            return self._go(((x, y),))
        if name in ("AA", "AR"):
            x, y, degrees = numbers
            if max(abs(x), abs(y), abs(self.x), abs(self.y)) > _FARTHEST or abs(degrees) > 3600:
                raise InputError(f"{command[:30]!r} is no arc that can be meant")
            return self._go(self._arc(name, x, y, degrees))
        if name in (self.sml.layer[:2].upper(), "AZ"):
            return self._rise(numbers[0])
        if name == "MZ":
            return self._rise(self.z + numbers[0])
        if name == "MM":
            self._set_output(numbers)
        elif name == "VM":
            self.suspended = True
        elif name == "PD":
            self.delay, self.delay_code = (numbers[0], int(numbers[1])) if numbers else (0.0, 0)
        elif name == "SR":
            self.rate = numbers[0]
        elif name == "AC":
            self.acceleration = numbers[0]
        elif name == "BC":
            if self.path is not None:
                raise InputError("BC inside a continuous path; EC is missing before it")
            self.path = ((self.x, self.y),)
        elif name == "EC":
            return self._end_path(command)
        elif name == "WA":
            return (Move(self.on_bed, self.on_bed, 0.0, seconds=numbers[0]),)
        elif name == "FH":
            return self._home()
        else:
            self._select(name, command)
        return ()

    def _set_output(self, numbers: list[float]) -> None:
        if not numbers:
            self.outputs, self.suspended = (), False
            return
        count, code = int(numbers[0]), int(numbers[1])
        if not 0 <= code <= 255:
            raise InputError(f"MM{count},{code}: a flow code from 0 to 255 is needed")
        self.outputs += ((count, code),)

    def _select(self, name: str, command: str) -> None:
        """Take a command that the profile may have of its own."""
        sml = self.sml
        materials = [_squeezed(material) for material in sml.materials]
        if _squeezed(command) in materials:
            self.material = materials.index(_squeezed(command))
        elif name not in _PASSED_OVER:
            own = [*sml.materials, *sml.header, *sml.footer, *sml.stop]
            if name not in {part.strip()[:2].upper() for line in own for part in line.split(";")}:
                raise InputError(f"unknown command {name} in {command[:30]!r}")

    def _end_path(self, command: str) -> tuple[Move, ...]:
        if self.path is None:
            raise InputError(f"{command} without BC")
        path, self.path = self.path, None
        return self._lay(path)

    def _go(self, points: tuple[tuple[float, float], ...]) -> tuple[Move, ...]:
        start = (self.x, self.y)
        self.x, self.y = points[-1]
        if self.path is not None:
            self.path += points
            return ()
        return self._lay((start, *points))

    def _rise(self, z: float) -> tuple[Move, ...]:
        start = self.on_bed
        self.z = z
        return (Move(start, self.on_bed, max(self.rate * MICROSTEP, _SLOWEST)),)

    def _home(self) -> tuple[Move, ...]:
        start = self.on_bed
        self.x = self.y = self.z = 0.0
        self.homed = True
        return (Move(start, self.on_bed, HOMING_SPEED),)

    def _arc(self, name: str, x: float, y: float, degrees: float) -> tuple:
        centre = (x, y) if name == "AA" else (self.x + x, self.y + y)
        points = arc_points(
            (self.x * MICROSTEP, self.y * MICROSTEP),
            (centre[0] * MICROSTEP, centre[1] * MICROSTEP),
            math.radians(degrees),
        )
        return tuple((px / MICROSTEP, py / MICROSTEP) for px, py in points)

    def _lay(self, path: tuple[tuple[float, float], ...]) -> tuple[Move, ...]:
        """A move or a continuous path is over: travel, or a road with the flow that MM gives it.

        The first even code holds from the road's start, every other from its place on; odd codes
        start the flow and roll it back, and change no section (as `formats.sml_reader` has it).
        """
        speed, z = max(self.rate * MICROSTEP, _SLOWEST), self.z * MICROSTEP
        moves: list[Move] = []
        if self.delay:
            here = _between(path[0], path[0], 0.0, z)
            moves.append(Move(here, here, 0.0, seconds=self.delay))
        path = (path[0], *(b for a, b in pairwise(path) if a != b))
        lengths = [((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2) ** 0.5 for a, b in pairwise(path)]
        gains = [output for output in self.outputs if output[1] % 2 == 0]
        switches = _switches(lengths, [] if self.suspended else gains)
        for k, ((a, b), length) in enumerate(zip(pairwise(path), lengths, strict=True)):
            for share, until, code in _pieces(k, switches):
                start, end = _between(a, b, share, z), _between(a, b, until, z)
                volume = code * self.sml.area_per_code * (until - share) * length * MICROSTEP
                moves.append(Move(start, end, speed, volume))
        return tuple(moves)


def _squeezed(command: str) -> str:
    return re.sub(r"\s", "", command).rstrip(";").upper()


def _between(a: tuple, b: tuple, share: float, z: float) -> Point:
    x = a[0] + share * (b[0] - a[0])
    y = a[1] + share * (b[1] - a[1])
    return x * MICROSTEP, y * MICROSTEP, z


def _switches(
    lengths: Sequence[float], gains: Sequence[tuple[int, int]]
) -> list[tuple[float, int]]:
    """Where on a path which code sets in: segments done before, and the code.

    Counts are whole microsteps, so a point of the path that is within one of a place is meant.
    """
    if not gains or not lengths:
        return [(0, 0)]
    counts = [int(length + 0.5) for length in accumulate(lengths, initial=0.0)]
    total = counts[-1]
    places = sorted((place + total if place < 0 else place, code) for place, code in gains)
    switches: list[tuple[float, int]] = [(0, places[0][1])]
    for place, code in places[1:]:
        place = max(place, 0)
        k = bisect_left(counts, place)
        if k <= len(lengths) and counts[k] - place <= 1:
            at = k
        elif k > 0 and (place - counts[k - 1] <= 1 or place > total):
            at = k - 1
        else:
            at = k - 1 + (place - counts[k - 1]) / (counts[k] - counts[k - 1])
        switches.append((at, code))
    return switches


def _pieces(segment: int, switches: list[tuple[float, int]]) -> list[tuple[float, float, int]]:
    """Shares of a segment, from and to, with the code in force."""
    if len(switches) == 1:
        return [(0.0, 1.0, switches[0][1])]
    cuts = sorted(at for at, _ in switches if segment < at < segment + 1)
    return [
        (start - segment, end - segment, [code for at, code in switches if at <= start][-1])
        for start, end in pairwise([segment, *cuts, segment + 1])
    ]
