"""Where a road is cut between two materials: in pieces none of which is too short to be laid."""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]
Run = tuple[int, int, bool]
"""First step of a piece, the one beyond its last, and whether it is above."""

_SAME = 1e-6
"""Lengths that differ by less are alike, mm."""


@dataclass
class Owed:
    """Length, mm, by which the pieces above are longer so far than was asked."""

    length: float = 0.0


def runs_of(above: Bools, size: Floats, shortest: float, owed: Owed) -> list[Run]:
    """The pieces of a road that changes with `above`, (n,), in steps of lengths `size`, mm.

    A piece shorter than `shortest`, mm, becomes as its neighbours are, or grows at their cost where
    they stay long enough: whichever leaves less owed, so that short pieces keep their share.

    >>> runs_of(np.array([0, 0, 0, 0, 1, 0, 0, 0, 0, 0], bool), np.ones(10), 2.0, Owed())
    [(0, 10, False)]
    >>> runs_of(np.array([0, 0, 0, 0, 1, 0, 0, 0, 0, 0], bool), np.ones(10), 2.0, Owed(-1.0))
    [(0, 3, False), (3, 5, True), (5, 10, False)]
    """
    pieces = _Pieces(above, size)
    while pieces.many > 1:
        # Of each material the shortest piece, and what would be owed if it changed or grew.
        ways: list[tuple[float, float, int, bool, int]] = []
        for over in (False, True):
            short, first, k = pieces.shortest(over)
            sign = 1 if over else -1
            if short > shortest - _SAME:
                continue
            ways.append((abs(owed.length - sign * short), short, first, False, k))
            wanted = shortest - short
            if sum(pieces.spare(k, shortest)) >= wanted:
                ways.append((abs(owed.length + sign * wanted), short, first, True, k))
        if not ways:
            break
        _, short, _, grows, k = min(ways)
        sign = 1 if pieces.over[k] else -1
        if grows:
            pieces.grow(k, shortest)
            owed.length += sign * (pieces.length(k) - short)
        else:
            pieces.change(k)
            owed.length -= sign * short
    return pieces.runs


def at_nodes(
    runs: list[Run], corners: Ints, size: Floats, shortest: float, width: float, owed: Owed
) -> list[Run]:
    """The pieces of a road of a graph, cut at corners that are nearer than the road's `width`, mm.

    Else one would begin beside a node, on the beads that meet there. A cut stays where it is if a
    piece would be shorter than `shortest`, mm.

    - `corners`: steps before which the road has a corner, as its nodes are, rising.
    """
    reach = np.concatenate([[0.0], np.cumsum(size)])
    made = [runs[0]]
    for first, last, over in runs[1:]:
        begin = made[-1][0]
        gaps = np.abs(reach[corners] - reach[first])
        gaps[reach[corners] - reach[begin] < shortest - _SAME] = np.inf
        gaps[reach[last] - reach[corners] < shortest - _SAME] = np.inf
        at = first
        if gaps.min(initial=np.inf) < width:
            at = int(corners[np.argmin(gaps)])
            owed.length += (-1 if over else 1) * float(reach[at] - reach[first])
        made[-1] = (begin, at, not over)
        made.append((at, last, over))
    return made


class Cuts:
    """The cuts of many roads, each of which can be moved by a step."""

    def __init__(self) -> None:
        self._all: list[tuple[list[Run], int, float, float]] = []

    def add(self, runs: list[Run], size: Floats, volumes: Floats, shortest: float) -> None:
        """The cuts between the pieces of a road, in steps of these lengths, mm, and volumes, mm^3.

        One can be moved only as far as both pieces stay as long as `shortest`, mm, whichever of
        their cuts move.
        """
        reach = np.concatenate([[0.0], np.cumsum(size)])
        spare = [
            float(reach[last] - reach[first] - size[first] - size[last - 1]) >= shortest - _SAME
            for first, last, _ in runs
        ]
        for k in range(1, len(runs)):
            at, over = runs[k][0], runs[k][2]
            before = float(volumes[at - 1]) if spare[k - 1] else 0.0
            behind = float(volumes[at]) if spare[k] else 0.0
            self._all.append((runs, k, *((before, behind) if over else (behind, before))))

    def move(self, volume: float) -> None:
        """Give `volume`, mm^3, more to the pieces above, or take it, evenly over the cuts; what
        that cannot give stays owed.
        """
        more = volume > 0
        gains = np.array([gain if more else loss for _, _, gain, loss in self._all])
        able = np.flatnonzero(gains)
        if not len(able):
            return
        # Where the sum of what all could give passes another share of what is asked.
        reach = np.cumsum(gains[able]) * min(1.0, abs(volume) / gains.sum())
        step = float(gains[able].mean())
        chosen = able[np.diff(np.floor(reach / step + 0.5), prepend=0.0) > 0]
        for runs, k, *_ in (self._all[each] for each in chosen):
            (first, at, below), (_, last, over) = runs[k - 1], runs[k]
            at += -1 if over == more else 1
            runs[k - 1], runs[k] = (first, at, below), (at, last, over)


class _Pieces:
    """Pieces of a road side by side, by numbers: `first` and `last` step, as of a `Run`, and
    whether they are `over`; `many`: how many are left. Numbers do not tell their order.
    """

    def __init__(self, above: Bools, size: Floats) -> None:
        cut = [0, *(np.flatnonzero(np.diff(above)) + 1).tolist(), len(above)]
        self.first, self.last = cut[:-1], cut[1:]
        self.over: list[bool] = above[self.first].tolist()
        self.many = len(self.over)
        self._before = list(range(-1, self.many - 1))
        self._behind = [*range(1, self.many), -1]
        self._reach: list[float] = np.concatenate([[0.0], np.cumsum(size)]).tolist()
        self._step = float(size.max(initial=0.0))
        # Of both materials lengths, first steps and numbers; what is no longer so stays in it.
        self._heaps: tuple[list[tuple[float, int, int]], ...] = ([], [])
        for k in range(self.many):
            self._push(k)

    def length(self, k: int) -> float:
        return self._reach[self.last[k]] - self._reach[self.first[k]]

    def _push(self, k: int) -> None:
        heappush(self._heaps[self.over[k]], (self.length(k), self.first[k], k))

    def shortest(self, over: bool) -> tuple[float, int, int]:
        """Length, first step and number of a material's shortest piece, the first of equals."""
        heap = self._heaps[over]
        while heap[0][:2] != (self.length(heap[0][2]), self.first[heap[0][2]]):
            heappop(heap)
        return heap[0]

    def change(self, k: int) -> None:
        """Make one piece of piece k and its neighbours, of their material."""
        low, high = self._before[k], self._behind[k]
        kept = low if low >= 0 else high
        first = self.first[low if low >= 0 else k]
        last = self.last[high if high >= 0 else k]
        before = self._before[low] if low >= 0 else -1
        behind = self._behind[high] if high >= 0 else -1
        for gone in {low, k, high} - {kept, -1}:
            self.first[gone] = self.last[gone]  # of no length
            self.many -= 1
        self.first[kept], self.last[kept] = first, last
        self._before[kept], self._behind[kept] = before, behind
        if before >= 0:
            self._behind[before] = kept
        if behind >= 0:
            self._before[behind] = kept
        self._push(kept)

    def spare(self, k: int, shortest: float) -> tuple[float, float]:
        """Length that the pieces before and behind piece k can give and stay long enough."""
        kept = shortest + self._step
        before, behind = (
            max(0.0, self.length(j) - kept) if j >= 0 else 0.0
            for j in (self._before[k], self._behind[k])
        )
        return before, behind

    def grow(self, k: int, shortest: float) -> None:
        """Make piece k as long as `shortest`, at the cost of both neighbours as they can spare."""
        reach = self._reach
        before, behind = self.spare(k, shortest)
        wanted = shortest - self.length(k)
        if before:
            far = reach[self.first[k]] - wanted * before / (before + behind)
            self.first[k] = bisect_right(reach, far + _SAME / 2) - 1
            self.last[self._before[k]] = self.first[k]
            self._push(self._before[k])
        if behind:
            self.last[k] = bisect_left(reach, reach[self.first[k]] + shortest - _SAME / 2)
            self.first[self._behind[k]] = self.last[k]
            self._push(self._behind[k])
        self._push(k)

    @property
    def runs(self) -> list[Run]:
        """All pieces in their order."""
        found = zip(self.first, self.last, self.over, strict=True)
        return sorted(run for run in found if run[0] < run[1])
