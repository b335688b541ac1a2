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
