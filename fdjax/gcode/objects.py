"""Objects of a plate, and what firmwares make of the moves of those that are left out.

Sources: Klipper's extras/exclude_object.py; RepRapFirmware 3.5's ObjectTracker.cpp and GCodes.cpp;
Marlin 2.1's M486.cpp, cancel_object.cpp and gcode.cpp, where it is built with CANCEL_OBJECTS.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from fdjax.errors import InputError
from fdjax.gcode.firmware import Firmware
from fdjax.gcode.settings import said
from fdjax.gcode.words import Refused
from fdjax.moves import Move, Point

COMMANDS = frozenset(
    ("M486", "EXCLUDE_OBJECT", *(f"EXCLUDE_OBJECT_{what}" for what in ("DEFINE", "START", "END")))
)
_STILL_MADE = 5
"""Moves with E that Klipper makes after the first object is left out, whatever they are of."""


def words_of(code: str, at: int) -> dict[str, str]:
    """Words of a command of `COMMANDS`. What follows the A of M486 is a name.

    >>> words_of('M486 S1 A"Part C"', 4)
    {'S': '1'}
    """
    numbered = code[:1] in "Mm"
    return said(code[at:].upper().partition("A")[0], 0) if numbered else said(code, at)


@dataclass(frozen=True)
class _Fed:
    """Filament of a kind of moves, mm^3: the most that was out, what is out, and where that was."""

    most: float
    now: float
    at: Point

    def to(self, now: float, at: Point) -> "_Fed":
        return _Fed(max(self.most, now), now, at)

    @property
    def pulled_back(self) -> float:
        return self.most - self.now


@dataclass(frozen=True)
class _Transform:
    """Klipper's between the moves of the file and those of the head, once it has one.

    - `head`: where that is; `offset`: the file's place less the head's; `adjust`: filament that the
      next move takes less, for objects may end with it pulled back or not.
    - `still_made`: moves with E that are left before anything is left out.
    """

    head: Point
    made: _Fed
    skipped: _Fed
    offset: Point = (0.0, 0.0, 0.0)
    adjust: float = 0.0
    inside: bool = False
    still_made: int = _STILL_MADE

    @staticmethod
    def at(place: Point) -> "_Transform":
        fed = _Fed(-math.inf, 0.0, place)
        return _Transform(place, fed, fed)

    def skip(self, move: Move) -> "_Transform":
        now = self._fed + move.volume
        x, y, z = (a - b for a, b in zip(move.end, self.made.at, strict=True))
        return replace(self, inside=True, offset=(x, y, z), skipped=self.skipped.to(now, move.end))

    @property
    def _fed(self) -> float:
        return self.skipped.now if self.inside else self.made.now

    def make(self, move: Move) -> tuple["_Transform", Move]:
        """The first moves behind an object make good what the head lags behind, axis by axis."""
        adjust = self.adjust
        if self.inside:
            adjust = self.skipped.pulled_back - self.made.pulled_back
        now = self._fed + move.volume
        (a, b, c), (x, y, z), less = self.offset, move.end, 0.0
        if (a or b) and (x, y) != self.skipped.at[:2]:
            a, b, c, less, adjust = 0.0, 0.0, 0.0, adjust, 0.0
        if c and z != self.skipped.at[2]:
            c = 0.0
        if adjust and now != self.skipped.now:
            less, adjust = adjust, 0.0
        head = (x - a, y - b, z - c)
        after = replace(
            self,
            head=head,
            made=self.made.to(now, move.end),
            offset=(a, b, c),
            adjust=adjust,
            inside=False,
            still_made=max(self.still_made - bool(move.volume), 0),
        )
        return after, move._replace(start=self.head, end=head, volume=move.volume - less)


@dataclass(frozen=True)
class Objects:
    """Where a file is among the objects of a plate.

    - `current`: the object whose moves come now, by its name or number; "" of none.
    - `left_out`: those that are not to be printed.
    - `waits`: where the head stands on the bed meanwhile, where the file is elsewhere.
    """

    current: str = ""
    left_out: frozenset[str] = frozenset()
    waits: Point | None = None
    transform: _Transform | None = None

    @property
    def skips(self) -> bool:
        """Whether the moves that come now are not made."""
        late = self.transform is not None and self.transform.still_made > 0
        return self.current in self.left_out and not late

    @property
    def pushes_counted(self) -> int:
        """Of those that Klipper counts before it leaves anything out."""
        return _STILL_MADE - self.transform.still_made if self.transform is not None else 0

    @property
    def followed(self) -> bool:
        """Whether moves may be others than the file says."""
        return bool(self.left_out or self.waits or self.transform)

    def said(
        self, firmware: Firmware, name: str, words: Mapping[str, str], place: Point
    ) -> "Objects":
        """After a command of `COMMANDS`, said while the file is at a place on the bed.

        Raises `Refused` for one that leaves out the current object where there is none.
        """
        if name == "M486":
            return self._numbered(firmware, words)
        who = words.get("NAME", "").upper()
        if name == "EXCLUDE_OBJECT_START":
            return replace(self, current=who)
        if name == "EXCLUDE_OBJECT_END":
            return replace(self, current="")
        if name == "EXCLUDE_OBJECT_DEFINE":
            return Objects() if words.get("RESET") else self
        if words.get("RESET"):
            return replace(self, left_out=self.left_out - {who} if who else frozenset())
        who = who or (self._named() if words.get("CURRENT") else "")
        if not who:
            return self  # a question
        transform = self.transform or _Transform.at(place)
        return replace(self, left_out=self.left_out | {who}, transform=transform)

    def _named(self) -> str:
        if not self.current:
            raise Refused("EXCLUDE_OBJECT: there is no current object to leave out")
        return self.current

    def _numbered(self, firmware: Firmware, words: Mapping[str, str]) -> "Objects":
        try:
            numbers = {letter: f"{float(words[letter]):.0f}" for letter in "SPU" if letter in words}
        except ValueError:
            raise InputError("M486: S, P and U name objects by their numbers") from None
        left_out = self.left_out
        if "T" in words and firmware.skipping == "stays":
            left_out = frozenset()  # it counts anew
        current = numbers.get("S", self.current)
        current = "" if current.startswith("-") else current
        left_out = left_out | {numbers[letter] for letter in "P" if letter in numbers}
        left_out -= {numbers[letter] for letter in "U" if letter in numbers}
        if "C" in words and current:
            left_out |= {current}
        return replace(self, current=current, left_out=left_out)

    def stand(self, place: Point) -> "Objects":
        """The head has come to a place otherwise than by moves of the file."""
        if not self.followed:
            return self
        transform = self.transform
        if transform is not None:
            transform = replace(transform, head=place, offset=(0.0, 0.0, 0.0))
        return replace(self, transform=transform, waits=None)

    def follow(self, firmware: Firmware, moves: tuple[Move, ...]) -> tuple["Objects", list[Move]]:
        """What becomes of moves of the file: those that the head makes."""
        objects, made = self, []
        for move in moves:
            if objects.transform is not None:
                transform = objects.transform
                if objects.skips:
                    transform = transform.skip(move)
                else:
                    transform, move = transform.make(move)
                    made.append(move)
                waits = transform.head if transform.offset != (0.0, 0.0, 0.0) else None
                objects = replace(objects, transform=transform, waits=waits)
            elif objects.skips:
                if firmware.skipping == "goes on":
                    objects = replace(objects, waits=objects.waits or move.start)
            elif objects.waits is None:
                made.append(move)
            elif move.start == move.end:
                made.append(move._replace(start=objects.waits, end=objects.waits))
            else:
                if move.volume > 0:  # a road does not begin where the head happens to be
                    made.append(Move(objects.waits, move.start, move.speed))
                    objects = replace(objects, waits=move.start)
                made.append(move._replace(start=objects.waits))
                objects = replace(objects, waits=None)
        return objects, made
