"""A look through a large G-code file: plain lines many at a time, all others one by one."""

import numpy as np

from fdjax.formats.gcode_bulk import Motions, advance, paid, takes_many
from fdjax.formats.gcode_scan import Block, Floats, Ints, block_of
from fdjax.formats.motion_many import ManyMotions
from fdjax.gcode.record import SLOWEST
from fdjax.gcode.state import GcodeState
from fdjax.machine.program import Program
from fdjax.machine.pushes import limits
from fdjax.machine.surveyed import Survey
from fdjax.machine.surveyor import Box, Surveyor
from fdjax.moves import Move

_FEW = 8
"""Lines up to which one after the other is faster than all at once."""


class ManySurveyor(Surveyor):
    """Takes the lines of a program chunk by chunk; what it finds is what a `Surveyor` does."""

    def __init__(self, program: Program, longest: int | None) -> None:
        super().__init__(program, longest)
        stream = program.machine.stream
        self._motion: ManyMotions = ManyMotions(stream.acceleration, stream.corner_speed)
        self._lines = 0

    def take_chunk(self, chunk: bytes) -> int:
        """Take whole lines; the number of the last."""
        block = block_of(chunk, self._lines + 1)
        many = (block.plain | block.resets) & (block.end - block.start < self._short)
        alone = ~many & (block.start < block.end)
        for index in np.flatnonzero(alone & block.comments).tolist():
            alone[index] = self._tells(block.text(index))
        motions, done = np.flatnonzero(many), 0
        for index in np.flatnonzero(alone).tolist():
            reached = int(np.searchsorted(motions, index))
            self._take_many(block, motions[done:reached])
            done = reached
            self.take(block.first + index, block.text(index) + "\n")
        self._take_many(block, motions[done:])
        self._lines += len(block.start)
        return self._lines

    def result(self, lines: int) -> Survey:
        """What there is to say, after the last line."""
        self._motion.finish()
        return super().result(lines)

    def _take_many(self, block: Block, chosen: Ints) -> None:
        """Take these plain lines and resets of a block."""
        state = self._state
        assert isinstance(state, GcodeState)
        if len(chosen) <= _FEW or self._unhomed or not takes_many(state):
            for index in chosen.tolist():
                self.take(block.first + index, block.text(index) + "\n")
            return
        motions = advance(state, block, chosen)
        numbers = block.first + chosen
        self._commands += len(chosen)
        moved = motions.moved | (motions.start[2] != motions.end[2])
        self._check_room(motions.end, moved, numbers)
        pace = np.maximum(motions.speed * state.speed_factor, SLOWEST)
        if self._weighs:
            self._check_pushes(motions, pace, numbers)
        if self._cold:
            for number in numbers[motions.volume > 0].tolist():
                self._line = number
                self._chill()
        laid, self._owed = paid(motions.volume, self._owed)
        self._volume = float(np.add.accumulate(np.append(self._volume, laid))[-1])
        # Filament alone takes as long as F says.
        waits = np.where(moved | (motions.volume == 0), 0.0, np.abs(motions.pushed) / pace)
        begun = 0
        if not self._primes:
            own = np.flatnonzero((laid > 0) & moved)
            if len(own):
                _widen(self._deposits, motions.start[:, own])
                _widen(self._deposits, motions.end[:, own])
            tops = motions.end[2, own]
            before = np.append(np.nan if self._z is None else self._z, tops[:-1])
            for index in own[tops != before].tolist():
                top = float(motions.end[2, index])
                if self._begins_layer(top):
                    self._motion.add_many(motions, pace, waits, slice(begun, index))
                    begun = index
                self._line = int(numbers[index])
                self._reach(top)
        self._motion.add_many(motions, pace, waits, slice(begun, None))
        self._line = int(numbers[-1])

    def _check_room(self, end: Floats, moved: np.ndarray, numbers: Ints) -> None:
        places = end if moved.all() else end[:, moved]
        if not places.size:
            return
        _widen(self._moves, places)
        low, high = np.array(self._low)[:, None], np.array(self._high)[:, None]
        if (places.min(1) < low[:, 0]).any() or (places.max(1) > high[:, 0]).any():
            outside = moved & ~((low <= end) & (end <= high)).all(0)
            for index in np.flatnonzero(outside).tolist():
                self._line = int(numbers[index])
                x, y, z = end[:, index].tolist()
                self._outside((x, y, z))

    def _check_pushes(self, motions: Motions, pace: Floats, numbers: Ints) -> None:
        """Weigh the moves that may push too much."""
        state = self._state
        assert isinstance(state, GcodeState)
        longest, largest = limits(self._machine)
        pushed = np.abs(motions.pushed * state.flow_factor)
        length = np.sqrt(((motions.end - motions.start) ** 2).sum(0))
        most = np.where(motions.moved, largest / state.filament_area * length, longest)
        for index in np.flatnonzero(pushed > 0.999 * np.minimum(most, longest)).tolist():
            self._line = int(numbers[index])
            (a, b, c), (x, y, z) = motions.start[:, index].tolist(), motions.end[:, index].tolist()
            move = Move((a, b, c), (x, y, z), float(pace[index]), float(motions.volume[index]))
            self._weigh(move)


def _widen(box: Box, places: Floats) -> None:
    """Have a box hold places, shape (3, n)."""
    low, high = places.min(1).tolist(), places.max(1).tolist()
    box.add((low[0], low[1], low[2]))
    box.add((high[0], high[1], high[2]))
