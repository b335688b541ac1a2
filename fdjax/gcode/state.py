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
from fdjax.gcode import objects, settings
from fdjax.gcode.commands import EXTENDED, SETTERS, UNFOLLOWED, passes_over, select
from fdjax.gcode.record import Record
from fdjax.gcode.words import PLAIN, Refused, command_of, end_of_name, words_of
from fdjax.moves import Move, Point

HOMING_SPEED = 40.0
"""mm/s, assumed of homing."""

MOTION = frozenset({"G0", "G1", "G2", "G3", "G5"})
"""Commands that words alone go on with."""
_STRICT = MOTION | {"G92"}
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
        name, x, y, z, e, feed = match.groups()
        if e is not None and not self.firmware.extrudes:
            return None
        if feed is not None:
            speed = float(feed) / 60
            if speed <= 0:
                return None
            self.run_at(speed)
        self.motion = name
        start = to_x, to_y, to_z = self.on_bed
        a, b, c = self.shift
        if x is not None:
            to_x = float(x) + a
        if y is not None:
            to_y = float(y) + b
        if z is not None:
            to_z = float(z) + c
        self.on_bed = end = (to_x, to_y, to_z)
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
        if self.power or (volume and start == end):
            return self._straight(start, end, volume)
        if volume > 0 and to_z > self.top:
            self.top = to_z
        return _new(Move, (start, end, self.pace, volume, 0.0))

    def run(self, code: str) -> tuple[Move, ...]:
        """Take the state past a line without comments; the moves that the line makes.

        Commands that change nothing that is kept here are passed over. Raises `NoCommand` for what
        is no command, `Refused` for what the firmware does not run, and `InputError` for a damaged
        word, an arc that is none, and what cannot be followed.
        """
        move = self.plain(code)
        if move is not None:
            return (move,)
        name, at = command_of(code)
        if not name:
            name = self.motion
            if not name:
                raise InputError(f"{code[:30]!r} goes on with no motion: no G0 to G3 was before it")
        firmware = self.firmware
        if name in firmware.refused:
            raise Refused(f"{name} is refused: {firmware.refused[name]}")
        if (name in UNFOLLOWED or name[0] == "O") and name != firmware.restore:
            raise InputError(f"{name} {UNFOLLOWED.get(name, 'is a program of another control')}")
        if name == "G5" and not firmware.splines:
            raise InputError(f"G5 is a spline, which {firmware.name} does not lay")
        moves: tuple[Move, ...] = ()
        if passes_over(firmware, name):
            if firmware.refuses_unknown:
                raise Refused(f"{name} is unknown to {firmware.name}")
            return ()
        if name in MOTION or name in SETTERS or name in ("G4", "G28"):
            words = words_of(code, at, bare=name not in _STRICT)
            if "G" in words or "M" in words:
                return self._several(code)
            if name in MOTION:
                return self.move(name, words)
            if name in SETTERS:
                SETTERS[name](self, words)
            else:
                moves = self._home(words) if name == "G28" else self._wait(words)
        elif name == "$H":
            return self._home({})
        elif firmware.runs_all and _BLOCK.search(code, at):
            return self._several(code)
        elif name[0] == "T" and name[1:].isdigit():
            select(self, int(name[1:]))
        elif not (name[0] in "GM" and name[1].isdigit()):
            moves = self._extended(name, settings.said(code, end_of_name(code)))
        at = end_of_name(code)
        if name == firmware.save or name == firmware.restore:
            moves = self._save_or_restore(name, code, at)
        kept = firmware.kept.get(name)
        if kept is not None:
            words = settings.said(code, at)
            if name in objects.COMMANDS:
                words = objects.words_of(code, at)
                self.objects = self.objects.said(firmware, name, words, self.on_bed)
                self.measure_by()
            settings.keep(self.settings, name, kept, words, scale=self.scale, tool=self.tool)
        return moves

    def _extended(self, name: str, words: Mapping[str, str]) -> tuple[Move, ...]:
        """A command of a firmware's own: a macro may do anything."""
        try:
            if name in EXTENDED:
                EXTENDED[name](self, words)
            elif name == "SET_GCODE_OFFSET":
                return self._offset(words)
            elif name not in self.firmware.kept and name not in self.firmware.harmless:
                self.forget()
        except ValueError:
            raise InputError(f"{name}: its values must be numbers") from None
        return ()

    def _offset(self, words: Mapping[str, str]) -> tuple[Move, ...]:
        """Klipper's SET_GCODE_OFFSET (gcode_move.py)."""
        by = []
        for axis, before in zip("XYZ", self.offset, strict=True):
            more = float(words.get(f"{axis}_ADJUST", "0"))
            by.append(float(words[axis]) - before if axis in words else more)
        (a, b, c), (d, e, f), (x, y, z) = self.shift, self.offset, by
        self.shift, self.offset = (a + x, b + y, c + z), (d + x, e + y, f + z)
        if words.get("MOVE", "0") == "0":
            return ()
        (a, b, c), start = self.on_bed, self.on_bed
        self.on_bed = (a + x, b + y, c + z)
        return (Move(start, self.on_bed, self.pace),)

    def _save_or_restore(self, name: str, code: str, at: int) -> tuple[Move, ...]:
        firmware, words = self.firmware, settings.said(code, at)
        if firmware.stacks:
            key = str(len(self.saved) - (name == firmware.restore))
        else:
            key = settings.state_name(code, at)
        if name == firmware.save:
            self.save(key)
            return ()
        if key not in self.saved:
            raise Refused(f"{name} {key}: no state of that name was saved before")
        saved = self.saved.pop(key) if firmware.stacks else self.saved[key]
        start = self.on_bed
        if firmware.saves_place:
            axes = [axis for axis in "XYZ" if axis in words] or "XYZ"
            x, y, z = (
                old + self.scale * float(words.get(axis) or 0) if axis in axes else now
                for axis, now, old in zip("XYZ", start, saved.on_bed, strict=True)
            )
            self.on_bed = (x, y, z)
            self.e = saved.e if "E" in words else self.e
            return (Move(start, self.on_bed, self.pace),)
        if not firmware.stacks:
            self.shift, self.offset, self.e = saved.shift, saved.offset, saved.e
            self.race(saved.speed_factor)
            self.pour(saved.flows.get(0, 1.0), 0)
        self.measure_by(absolute=saved.absolute, relative_e=saved.relative_e, scale=saved.scale)
        self.run_at(saved.speed)
        if words.get("MOVE", "0") == "0":
            return ()
        self.on_bed = saved.on_bed
        return (Move(start, saved.on_bed, self.pace),)

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
        for name in sorted(names, key=lambda name: command_of(name)[0] in MOTION):
            moves += self.run(f"{name} {words}")
        return moves

    def move(self, name: str, words: Mapping[str, float]) -> tuple[Move, ...]:
        """Make the motion of G0 to G3 or G5, but for what is of an object that is left out."""
        if not self.objects.followed:
            return self._motion(name, words)
        start, top = self.on_bed, self.top
        whole = self._motion(name, words)
        if self.objects.skips and self.firmware.skipping == "stays":
            self.on_bed = start
        self.objects, made = self.objects.follow(self.firmware, whole)
        roads = [move for move in made if move.volume > 0 and move.start != move.end]
        self.top = max([top, *(move.end[2] for move in roads)])
        return tuple(made)

    def _motion(self, name: str, words: Mapping[str, float]) -> tuple[Move, ...]:
        other = words.keys() & _OTHER_AXES
        if other:
            axis = min(other)
            raise InputError(
                f"{axis}{words[axis]:g} moves an axis that is not known; E is filament"
            )
        if "E" in words and not self.firmware.extrudes:
            raise Refused(f"{self.firmware.name} has no E")
        k = self.scale
        if "F" in words:
            self.run_at(words["F"] * k / 60)
            self.measure_by()  # the first F may let moves be made as they stand
        if name != "G0" and not (self.speed or self.firmware.first_speed):
            raise Refused(f"{self.firmware.name} makes no {name} before an F: no speed was said")
        self.motion = name
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
        if self.pours and self.area_per_power:
            volume = self.power * self.area_per_power * math.dist(start, end)
        if volume > 0 or self.pours:
            self.top = max(self.top, end[2])
        return Move(start, end, pace, volume)

    def _arc(
        self, name: str, words: Mapping[str, float], start: Point, volume: float
    ) -> tuple[Move, ...]:
        if self.plane != "G17":
            raise InputError(f"an arc out of the XY plane (after {self.plane}) cannot be followed")
        firmware = self.firmware
        if ("R" in words and not firmware.radius_arcs) or not (
            self.absolute or firmware.relative_arcs
        ):
            how = "R" if "R" in words else "G91"
            raise Refused(f"{firmware.name} makes no arcs with {how}; I and J in G90 are right")
        k, turn, end = self.scale, -1 if name == "G2" else 1, self.on_bed
        if "R" in words:
            centre = arcs.centre(start[:2], end[:2], words["R"] * k, turn)
        elif "I" in words or "J" in words:
            centre = (start[0] + words.get("I", 0.0) * k, start[1] + words.get("J", 0.0) * k)
        else:
            raise InputError("an arc needs I and J, or R")
        if not math.dist(start[:2], centre) < _LARGEST_RADIUS:
            raise InputError(f"an arc of more than {_LARGEST_RADIUS:g} mm radius cannot be meant")
        points = arcs.between(start[:2], end[:2], centre, turn, chord=firmware.chord)
        return self._along(points, start, volume)

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
        whole = math.fsum(steps)
        count = len(points)
        moves, before = [], start
        for number, (x, y) in enumerate(points, 1):
            after = (x, y, start[2] + (end[2] - start[2]) * number / count)
            share = volume * steps[number - 1] / whole if whole else volume / count
            moves.append(self._straight(before, after, share))
            before = after
        return tuple(moves)

    def _wait(self, words: Mapping[str, float]) -> tuple[Move]:
        dwell = self.firmware.dwell
        given = [letter for letter in dwell if letter in words]
        if self.firmware.needs_dwell and words.keys() != set(dwell):
            raise Refused(f"{self.firmware.name} waits by G4 {' '.join(dwell)} alone")
        seconds = words[given[0]] * dwell[given[0]] if given else 0.0
        return (Move(self.on_bed, self.on_bed, 0.0, seconds=seconds),)

    def _home(self, words: Mapping[str, float]) -> tuple[Move]:
        start, shift = list(self.on_bed), list(self.shift)
        axes = [axis for axis in "XYZ" if axis in words] or list("XYZ")
        for axis in axes:
            k = "XYZ".index(axis)
            start[k], shift[k] = 0.0, self.offset[k]
        before, self.on_bed = self.on_bed, (start[0], start[1], start[2])
        self.shift = (shift[0], shift[1], shift[2])
        self.objects = self.objects.stand(self.on_bed)
        self.homed |= frozenset(axes)
        settings.forget(self.settings, self.firmware.home_ends)
        self.forget("".join(axes))
        return (Move(before, self.on_bed, HOMING_SPEED),)
