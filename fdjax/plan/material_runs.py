"""Where a road is cut between two materials: in pieces none of which is too short to be laid."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
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
    cut = [0, *(np.flatnonzero(np.diff(above)) + 1).tolist(), len(above)]
    runs: list[Run] = [(a, b, bool(above[a])) for a, b in pairwise(cut)]
    reach = np.concatenate([[0.0], np.cumsum(size)])
    step = float(size.max(initial=0.0))

    def length(run: Run) -> float:
        return float(reach[run[1]] - reach[run[0]])

    while len(runs) > 1:
        # Of each material the shortest piece, and what would be owed if it changed or grew.
        ways: list[tuple[float, float, int, bool]] = []
        for over in (False, True):
            own = [k for k, run in enumerate(runs) if run[2] == over]
            k = min(own, key=lambda k: length(runs[k]))
            short, sign = length(runs[k]), 1 if over else -1
            if short > shortest - _SAME:
                continue
            ways.append((abs(owed.length - sign * short), short, k, False))
            wanted = shortest - short
            if sum(_spare(runs, k, reach, shortest + step)) >= wanted:
                ways.append((abs(owed.length + sign * wanted), short, k, True))
        if not ways:
            break
        *_, k, grows = min(ways)
        short, sign = length(runs[k]), 1 if runs[k][2] else -1
        if grows:
            _grow(runs, k, reach, shortest, step)
            owed.length += sign * (length(runs[k]) - short)
        else:
            low, high = max(k - 1, 0), min(k + 1, len(runs) - 1)
            runs[low : high + 1] = [(runs[low][0], runs[high][1], not runs[k][2])]
            owed.length -= sign * short
    return runs


def _spare(runs: list[Run], k: int, reach: Floats, kept: float) -> tuple[float, float]:
    """Length that the pieces before and behind piece k can give and stay as long as `kept`."""
    before, behind = (
        max(0.0, float(reach[runs[j][1]] - reach[runs[j][0]]) - kept) if 0 <= j < len(runs) else 0.0
        for j in (k - 1, k + 1)
    )
    return before, behind


def _grow(runs: list[Run], k: int, reach: Floats, shortest: float, step: float) -> None:
    """Make piece k as long as `shortest`, at the cost of both its neighbours as they can spare."""
    first, last, over = runs[k]
    before, behind = _spare(runs, k, reach, shortest + step)
    wanted = shortest - float(reach[last] - reach[first])
    if before:
        far = reach[first] - wanted * before / (before + behind)
        first = int(np.searchsorted(reach, far + _SAME / 2, side="right")) - 1
        runs[k - 1] = (runs[k - 1][0], first, not over)
    if behind:
        last = int(np.searchsorted(reach, reach[first] + shortest - _SAME / 2))
        runs[k + 1] = (last, runs[k + 1][1], not over)
    runs[k] = (first, last, over)
