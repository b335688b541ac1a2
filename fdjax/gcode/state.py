"""The state that G-code changes: what a printer would be like after a line, and how it got there.

One interpreter for all that must know: the measure of a file, the check before sending, the time
that is left, the position that a printer should report, the lines that rebuild its state, and the
virtual machines.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from fdjax import arcs
from fdjax.errors import InputError
from fdjax.gcode.commands import SETTERS, UNFOLLOWED, select
from fdjax.gcode.record import Record
from fdjax.gcode.words import PLAIN, command_of, words_of
from fdjax.moves import Move, Point

HOMING_SPEED = 40.0
"""mm/s, assumed of homing."""

_MOTION = frozenset({"G0", "G1", "G2", "G3", "G5"})
_STRICT = _MOTION | {"G92"}
"""A letter alone is what a cut-off line ends in, so their words must have numbers."""
_BLOCK = re.compile(r"([GM])\s*(\d+(?:\.\d+)?)", re.IGNORECASE)
_OTHER_AXES = frozenset("ABCUVW")
_LARGEST_RADIUS = 1e6
_new = tuple.__new__


@dataclass(slots=True)
class GcodeState(Record):
    """A record that lines of G-code are run on.

    >>> state = GcodeState()
    >>> [move.end for move in (*state.run("G1 X10 Y5 E1"), *state.run("G91"), *state.run("X5"))]
    [(10.0, 5.0, 0.0), (15.0, 5.0, 0.0)]
    """

    def plain(self, line: str) -> Move | None:
        """What `run` does with a motion in absolute mm as programs write it, in a hurry.

        None, and nothing done, for any other line.
        """
        match = PLAIN(line)
        if match is None or not self.direct:
            return None
        self.motion, x, y, z, e, feed = match.groups()
        start = to_x, to_y, to_z = self.on_bed
        a, b, c = self.shift
        if x is not None:
            to_x = float(x) + a
        if y is not None:
            to_y = float(y) + b
        if z is not None:
            to_z = float(z) + c
        self.on_bed = end = (to_x, to_y, to_z)
        if feed is not None:
            self.run_at(float(feed) / 60)
        if self.unsure:
            given = zip("XYZE", (x, y, z, None if self.relative_e else e), strict=True)
            self.know({axis for axis, word in given if word is not None})
        if e is None:
            volume = 0.0
        elif self.relative_e:
            pushed = float(e)
            self.e += pushed
            volume = pushed * self.gain
        else:
            before, self.e = self.e, float(e)
            volume = (self.e - before) * self.gain
        if self.area_per_power or (volume and start == end):
            return self._straight(start, end, volume)
        return _new(Move, (start, end, self.pace, volume, 0.0))

    def run(self, code: str) -> tuple[Move, ...]:
        """Take the state past a line without comments; the moves that the line makes.

        Commands that change nothing that is kept here are passed over. Raises `NoCommand` for what
        is no command, and `InputError` for a damaged word, an arc that is none, and what cannot be
        followed.
        """
        move = self.plain(code)
        if move is not None:
            return (move,)
        name, at = command_of(code)
        if not name:
            name = self.motion
            if not name:
                raise InputError(f"{code[:30]!r} goes on with no motion: no G0 to G3 was before it")
        if name in _MOTION or name in SETTERS or name in ("G4", "G28"):
            words = words_of(code, at, bare=name not in _STRICT)
            if "G" in words or "M" in words:
                return self._several(code)
            if name in _MOTION:
                return self.move(name, words)
            if name in SETTERS:
                SETTERS[name](self, words)
                return ()
            return self._home(words) if name == "G28" else self._wait(words)
        if name == "$H":
            return self._home({})
        if name in UNFOLLOWED or name[0] == "O":
            raise InputError(f"{name} {UNFOLLOWED.get(name, 'is a program of another control')}")
        if self.firmware.runs_all and _BLOCK.search(code, at):
            return self._several(code)
        if name[0] == "T" and name[1:].isdigit():
            select(self, int(name[1:]))
        elif not (name[0] in "GM" and name[1].isdigit()):
            self.forget()
        return ()

    def _several(self, code: str) -> tuple[Move, ...]:
        """Several commands in one line, as grbl takes them: motion comes last."""
        names = [letter.upper() + number for letter, number in _BLOCK.findall(code)]
        if _BLOCK.match(code.lstrip()) is None:
            names.insert(0, self.motion)
        if not self.firmware.runs_all:
            first, second = names[:2]
            raise InputError(
                f"{second} stands behind {first}: {self.firmware.name} would run the first only"
            )
        words = _BLOCK.sub("", code)
        moves: tuple[Move, ...] = ()
        for name in sorted(names, key=lambda name: command_of(name)[0] in _MOTION):
            moves += self.run(f"{name} {words}")
        return moves

    def move(self, name: str, words: Mapping[str, float]) -> tuple[Move, ...]:
        """Make the motion of G0 to G3 or G5."""
        if name == "G5" and not self.firmware.splines:
            raise InputError(f"G5 is a spline, which {self.firmware.name} does not lay")
        other = words.keys() & _OTHER_AXES
        if other:
            axis = min(other)
            raise InputError(
                f"{axis}{words[axis]:g} moves an axis that is not known; E is filament"
            )
        self.motion = name
        k = self.scale
        if "F" in words:
            self.run_at(words["F"] * k / 60)
        start = self.on_bed
        x, y, z = start
        a, b, c = self.shift if self.absolute else start
        x = words["X"] * k + a if "X" in words else x
        y = words["Y"] * k + b if "Y" in words else y
        z = words["Z"] * k + c if "Z" in words else z
        self.on_bed = end = (x, y, z)
        volume = 0.0
        if "E" in words:
            e = words["E"] * self.e_scale
            before = self.e
            self.e = before + e if self.e_is_relative else e
            volume = (e if self.e_is_relative else e - before) * self.gain
        if self.unknown and self.absolute:
            self.know(words.keys() - {"E"} if self.relative_e else words.keys())
        if name in ("G2", "G3"):
            return self._arc(name, words, start, volume)
        if name == "G5":
            return self._spline(words, start, volume)
        return (self._straight(start, end, volume),)

    def _straight(self, start: Point, end: Point, volume: float) -> Move:
        pace = self.pace
        if start == end and volume:
            return Move(start, end, pace, volume, abs(volume / self.gain) / pace)
        if self.area_per_power and self.motion == "G1":
            volume = self.power * self.area_per_power * math.dist(start, end)
        return Move(start, end, pace, volume)

    def _arc(
        self, name: str, words: Mapping[str, float], start: Point, volume: float
    ) -> tuple[Move, ...]:
        if self.plane != "G17":
            raise InputError(f"an arc out of the XY plane (after {self.plane}) cannot be followed")
        k, turn, end = self.scale, -1 if name == "G2" else 1, self.on_bed
        if "R" in words:
            centre = arcs.centre(start[:2], end[:2], words["R"] * k, turn)
        elif "I" in words or "J" in words:
            centre = (start[0] + words.get("I", 0.0) * k, start[1] + words.get("J", 0.0) * k)
        else:
            raise InputError("an arc needs I and J, or R")
        if not math.dist(start[:2], centre) < _LARGEST_RADIUS:
            raise InputError(f"an arc of more than {_LARGEST_RADIUS:g} mm radius cannot be meant")
        return self._along(arcs.between(start[:2], end[:2], centre, turn), start, volume)

    def _spline(self, words: Mapping[str, float], start: Point, volume: float) -> tuple[Move, ...]:
        """Marlin's G5 (G5.cpp): I, J lead away from the start, P, Q from the end."""
        k, end = self.scale, self.on_bed
        leaving = (start[0] + words.get("I", 0.0) * k, start[1] + words.get("J", 0.0) * k)
        coming = (end[0] + words.get("P", 0.0) * k, end[1] + words.get("Q", 0.0) * k)
        points = arcs.cubic_points(start[:2], leaving, coming, end[:2])
        return self._along(points, start, volume)

    def _along(
        self, points: list[tuple[float, float]], start: Point, volume: float
    ) -> tuple[Move, ...]:
        """Straight moves to points, the last of them the end, that share a volume by length."""
        end = self.on_bed
        steps = [math.dist(a, b) for a, b in zip([start[:2], *points], points, strict=False)]
        whole = math.fsum(steps) or 1.0
        count = len(points)
        moves, before = [], start
        for number, (x, y) in enumerate(points, 1):
            after = (x, y, start[2] + (end[2] - start[2]) * number / count)
            share = volume * steps[number - 1] / whole
            if self.area_per_power:
                share = self.power * self.area_per_power * math.dist(before, after)
            moves.append(Move(before, after, self.pace, share))
            before = after
        return tuple(moves)

    def _wait(self, words: Mapping[str, float]) -> tuple[Move]:
        seconds = words.get("S", 0.0) or words.get("P", 0.0) / 1000
        return (Move(self.on_bed, self.on_bed, 0.0, seconds=seconds),)

    def _home(self, words: Mapping[str, float]) -> tuple[Move]:
        start, shift = list(self.on_bed), list(self.shift)
        axes = [axis for axis in "XYZ" if axis in words] or list("XYZ")
        for axis in axes:
            start["XYZ".index(axis)] = shift["XYZ".index(axis)] = 0.0
        before, self.on_bed = self.on_bed, (start[0], start[1], start[2])
        self.shift = (shift[0], shift[1], shift[2])
        self.homed |= frozenset(axes)
        self.forget("".join(axes))
        return (Move(before, self.on_bed, HOMING_SPEED),)
