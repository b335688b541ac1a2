"""Runs of a G-code file's pieces: of one road each, and of one stretch between comments."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdjax.formats.gcode_scan import Floats, Ints, Mask
from fdjax.formats.gcode_track import Track
from fdjax.formats.slicers import Comments, Stretch

NEAR = 1e-4
"""mm; deposits nearer in Z than this lie in one layer."""


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of pieces of a track: of one road, and of one stretch between comments.

    - `first`: index of each run's first piece, and the number of pieces, shape (runs + 1,).
    - `stretch`: index in `stretches` of each run's, shape (runs,).
    """

    track: Track
    first: Ints
    stretch: Ints
    stretches: Sequence[Stretch]

    @classmethod
    def of(cls, track: Track, comments: Comments) -> "Runs":
        lines = np.array([each.line for each in comments.stretches])
        begins = np.ones(len(track.line), bool)
        np.not_equal(track.road[1:], track.road[:-1], out=begins[1:])
        at = np.searchsorted(track.line, lines)
        begins[at[at < len(begins)]] = True
        # Where Z moves each piece may be of another layer.
        begins |= (np.abs(track.start[:, 2] - track.end[:, 2]) > NEAR).any()
        first = np.flatnonzero(begins)
        stretch = np.searchsorted(lines, track.line[first], side="right") - 1
        return cls(track, np.append(first, len(begins)), stretch, comments.stretches)

    def told(self, name: str) -> NDArray:
        """What comments say of each run: a number of `Stretch`, shape (runs,)."""
        return np.array([getattr(each, name) for each in self.stretches])[self.stretch]

    def those(self, test: Callable[[Stretch], bool]) -> Mask:
        """The runs whose stretch passes a test, shape (runs,)."""
        return np.array([test(each) for each in self.stretches])[self.stretch]

    def roles(self) -> tuple[Ints, tuple[str, ...]]:
        """Index of each run's role, and the roles; the first is none."""
        names = ("", *sorted({each.role for each in self.stretches} - {""}))
        index = {name: number for number, name in enumerate(names)}
        return np.array([index[each.role] for each in self.stretches])[self.stretch], names

    @property
    def volume(self) -> Floats:
        """Of each run, mm^3."""
        return np.add.reduceat(self.track.volume, self.first[:-1])

    @property
    def section(self) -> Floats:
        """Mean section of each run, mm^2."""
        return self.volume / np.add.reduceat(self.track.length(slice(None)), self.first[:-1])

    @property
    def z(self) -> tuple[Floats, Floats]:
        """Where each run begins and ends, mm above what the file calls 0."""
        track = self.track
        start, end = track.start[self.first[:-1], 2], track.end[self.first[1:] - 1, 2]
        return start - track.base, end - track.base

    def pieces(self, runs: Ints) -> slice | Ints:
        """Indices of the pieces of some runs, in order."""
        if len(runs) == runs[-1] - runs[0] + 1:
            return slice(int(self.first[runs[0]]), int(self.first[runs[-1] + 1]))
        first = self.first[runs]
        count = self.first[runs + 1] - first
        return np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)

    def of_those(self, runs: Ints, values: NDArray) -> NDArray:
        """Values of runs, repeated for each of their pieces."""
        return np.repeat(values[runs], self.first[runs + 1] - self.first[runs])
