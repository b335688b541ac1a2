"""The order in which space-filling curves go through the squares of a lattice. Loads no JAX."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.intp]


def _hilbert(i: Ints, j: Ints, count: int) -> Ints:
    """Hilbert 1891: quarter by quarter, the first and the last mirrored."""
    i, j, rank = i.copy(), j.copy(), np.zeros_like(i)
    side = 1 << max(count - 1, 1).bit_length()
    while side > 1:
        side //= 2
        right, up = i >= side, j >= side
        rank = 4 * rank + np.where(right, np.where(up, 2, 3), np.where(up, 1, 0))
        i, j = np.where(right, i - side, i), np.where(up, j - side, j)
        last = right & ~up
        first = ~right & ~up
        i, j = (
            np.where(first, j, np.where(last, side - 1 - j, i)),
            np.where(first, i, np.where(last, side - 1 - i, j)),
        )
    return rank


def _moore(i: Ints, j: Ints, count: int) -> Ints:
    """Moore 1900: four of Hilbert's curves, turned so that they close on each other."""
    half = 1 << max((count - 1) // 2, 1).bit_length()
    right, up = i >= half, j >= half
    i, j = np.where(right, i - half, i), np.where(up, j - half, j)
    # Up on the left and down on the right.
    across = np.where(right, i, half - 1 - i)
    along = np.where(right, half - 1 - j, j)
    quarter = np.where(right, np.where(up, 2, 3), np.where(up, 1, 0))
    return quarter * half * half + _hilbert(along, across, half)


def _peano(i: Ints, j: Ints, count: int) -> Ints:
    """Peano 1890: ninth by ninth, mirrored where it has gone an odd way."""
    i, j, rank = i.copy(), j.copy(), np.zeros_like(i)
    side = 1
    while side < count:
        side *= 3
    while side > 1:
        side //= 3
        column, row = i // side, j // side
        i, j = i % side, j % side
        odd = column % 2 == 1
        rank = 9 * rank + 3 * column + np.where(odd, 2 - row, row)
        i, j = np.where(row % 2 == 1, side - 1 - i, i), np.where(odd, side - 1 - j, j)
    return rank


def _meander(i: Ints, j: Ints, count: int) -> Ints:
    """Row after row, there and back."""
    return count * i + np.where(i % 2 == 1, count - 1 - j, j)


def _sierpinski(i: Ints, j: Ints, count: int) -> Ints:
    """Sierpinski 1912: half by half of right triangles (Bartholdi and Platzman 1982)."""
    most = 2 << max(count - 1, 1).bit_length()
    x, y = 2 * i + 1, 2 * j + 1
    lower = x > y
    rank = lower.astype(np.intp)
    x, y = np.where(lower, most - x, x), np.where(lower, most - y, y)
    # Twice a step for each bit of both places, and one for the triangles inside a square.
    for _ in range(most.bit_length() + 1):
        far = x + y > most
        x, y = 2 * np.where(far, most - y, x), 2 * np.where(far, x, y)
        high = y > most
        rank = 4 * rank + 2 * far + high
        x, y = np.where(high, y - most, x), np.where(high, most - x, y)
    return rank


_FORWARD = ("FBBFFFB", (0, -1, -3, -2, 0, 0, 1))
_BACKWARD = ("FBBBFFB", (1, 0, 0, -2, -3, -1, 0))
"""Gosper's seven steps, each a forward or a backward curve, and their sixths of a turn."""

_STEPS = np.array([(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)])
"""The six neighbours on a lattice of triangles, on the squares that it becomes when sheared."""


def _gosper(i: Ints, j: Ints, count: int) -> Ints:
    """Gosper 1973 (Gardner 1976): seven by seven on a lattice of triangles, sheared to squares."""
    curves = {"F": np.zeros(1, np.intp), "B": np.zeros(1, np.intp)}
    while True:
        curves = {
            name: np.concatenate([curves[k] + turn for k, turn in zip(*rule, strict=True)])
            for name, rule in (("F", _FORWARD), ("B", _BACKWARD))
        }
        if len(curves["F"]) < 4 * i.size:
            continue
        places = np.cumsum(_STEPS[curves["F"] % 6], 0)
        low = places.min(0)
        table = np.full(places.max(0) - low + 1, -1)
        table[tuple((places - low).T)] = np.arange(len(places))
        corner = np.round(places.mean(0)).astype(int) - low - np.array(i.shape) // 2
        if (corner < 0).any() or (corner + i.shape > table.shape).any():
            continue
        rank = table[corner[0] + i, corner[1] + j]
        if (rank >= 0).all():
            return rank


_ORDERS: dict[str, Callable[[Ints, Ints, int], Ints]] = {
    "hilbert": _hilbert,
    "moore": _moore,
    "peano": _peano,
    "meander": _meander,
    "sierpinski": _sierpinski,
    "gosper": _gosper,
}

NAMES = tuple(_ORDERS)
"""A new curve is one function here."""


def rank(name: str, shape: tuple[int, int]) -> Ints:
    """The place of each square of a lattice (n, m) along a curve that goes through it and more.

    >>> rank("hilbert", (2, 2)).tolist(), rank("peano", (3, 3)).tolist()
    ([[0, 1], [3, 2]], [[0, 1, 2], [5, 4, 3], [6, 7, 8]])
    """
    i, j = np.meshgrid(*map(np.arange, shape), indexing="ij")
    return np.asarray(_ORDERS[name](i, j, max(shape)), int)
