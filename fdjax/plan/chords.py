"""Short straight chords of many polylines, to look up what lies near."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from shapely import STRtree, linestrings

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_LONGEST = 4.0
"""Longer segments are split, mm: the box round a long slanting one holds much that is far."""

_SAME = 1e-9
"""Two places nearer than this along a line are one, mm."""


@dataclass(frozen=True, eq=False)
class Chords:
    """Segments of polylines, split where long, one after the other.

    - `start`, `end`: shape (n, 2), mm; `width`, `length`: shape (n,), mm.
    - `owner`: index of the polyline; `at`: position of the start along it, mm.
    """

    start: Floats
    end: Floats
    width: Floats
    length: Floats
    owner: Ints
    at: Floats

    @classmethod
    def of(cls, paths: Sequence[Floats], widths: Sequence[Floats]) -> "Chords":
        a = np.concatenate([path[:-1] for path in paths])
        step = np.concatenate([path[1:] for path in paths]) - a
        owner = np.repeat(np.arange(len(paths)), [len(path) - 1 for path in paths])
        length = np.hypot(*step.T)
        walked = np.cumsum(length) - length
        first = np.searchsorted(owner, np.arange(len(paths)))
        at = walked - walked[first][owner]
        parts = np.maximum(np.ceil(length / _LONGEST), 1).astype(int)
        index = np.repeat(np.arange(len(a)), parts)
        share = (np.arange(len(index)) - (np.cumsum(parts) - parts)[index]) / parts[index]
        next_share = share + 1 / parts[index]
        start = a[index] + share[:, None] * step[index]
        end = a[index] + next_share[:, None] * step[index]
        width = np.concatenate(list(widths))[index]
        each = length[index] / parts[index]
        return cls(start, end, width, each, owner[index], at[index] + share * length[index])

    @cached_property
    def unit(self) -> Floats:
        """Direction of each, shape (n, 2)."""
        return (self.end - self.start) / self.length[:, None]

    @cached_property
    def tree(self) -> STRtree:
        return STRtree(np.asarray(linestrings(np.stack([self.start, self.end], 1))))

    def near_pairs(self, reach: float) -> tuple[Ints, Ints]:
        """Pairs of different owners' chords whose boxes come within `reach` mm, each once."""
        low = np.minimum(self.start, self.end) - reach
        high = np.maximum(self.start, self.end) + reach
        i, j = self.tree.query(linestrings(np.stack([low, high], 1)))
        keep = self.owner[i] < self.owner[j]
        return i[keep], j[keep]

    def distance(self, i: Ints, j: Ints) -> Floats:
        """Between pairs that do not cross, mm."""
        ends = ((i, j, self.start), (i, j, self.end), (j, i, self.start), (j, i, self.end))
        least = np.full(len(i), np.inf)
        for a, b, point in ends:
            offset, unit = point[a] - self.start[b], self.unit[b]
            along = np.clip((offset * unit).sum(1), 0, self.length[b])
            least = np.minimum(least, np.hypot(*(offset - along[:, None] * unit).T))
        return least


def stretch(xy: Floats, width: Floats, a: float, b: float) -> tuple[Floats, Floats]:
    """Points and widths of a polyline between two places along it, mm.

    >>> xy, width = stretch(np.array([(0.0, 0), (4, 0), (4, 4)]), np.array([0.4, 0.5]), 1, 6)
    >>> xy.tolist(), width.tolist()
    ([[1.0, 0.0], [4.0, 0.0], [4.0, 2.0]], [0.4, 0.5])
    """
    at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    if a <= 0 and b >= at[-1]:
        return xy, width
    ends = np.stack([np.interp([a, b], at, axis) for axis in xy.T], 1)
    points = np.concatenate([ends[:1], xy[(at > a + _SAME) & (at < b - _SAME)], ends[1:]])
    first = int(np.searchsorted(at, max(a, 0.0) + _SAME, side="right")) - 1
    return points, width[first : first + len(points) - 1]
