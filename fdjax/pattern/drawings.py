"""Unit cells by name. Loads no JAX."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np

from fdjax.pattern.unit_cell import UnitCell

_ROOT3 = 3**0.5


def _square() -> UnitCell:
    return UnitCell.of([[(0, 0), (1, 0)], [(0, 0), (0, 1)]], (1, 1))


def _triangular() -> UnitCell:
    half = _ROOT3 / 2
    apex = (0.5, half)
    sides = [(0, 0), (1, 0), (0, 2 * half), (1, 2 * half)]
    lines = [[(0, 0), (1, 0)], [apex, (1.5, half)], *([apex, side] for side in sides)]
    return UnitCell.of(lines, (1, 2 * half))


def _hexagonal() -> UnitCell:
    s = _ROOT3 / 2
    zigzags = [[(0, 0.5), (s, 0), (2 * s, 0.5)], [(0, 1.5), (s, 2), (2 * s, 1.5)]]
    return UnitCell.of([*zigzags, [(0, 0.5), (0, 1.5)], [(s, 2), (s, 3)]], (2 * s, 3))


def _kagome() -> UnitCell:
    h = _ROOT3 / 2
    falling = [(1 - k / 2, k * h) for k in range(5)]
    rising = [(1 + k / 2, k * h) for k in range(5)]
    level = [[(k + 0.5, y), (k + 1.5, y)] for y in (h, 3 * h) for k in (0, 1)]
    return UnitCell.of([falling, rising, *level], (2, 4 * h))


def _brick() -> UnitCell:
    courses = [[(0, y), (1, y), (2, y)] for y in (0, 1)]
    return UnitCell.of([*courses, [(0, 0), (0, 1)], [(1, 1), (1, 2)]], (2, 2))


def _reentrant() -> UnitCell:
    """Bow ties: a honeycomb whose sides point inwards, wider when stretched (Lakes 1987)."""
    dent, post = 0.5, 1.5
    low = [(0, 0), (1, dent), (2, 0)]
    high = [(0, post), (1, post - dent), (2, post)]
    return UnitCell.of(
        [low, high, [(0, 0), (0, post)], [(1, post - dent), (1, 2 * post - dent)]],
        (2, 2 * post - 2 * dent),
    )


def _wave() -> UnitCell:
    """A level set of the gyroid as slicers draw it: parallel waves."""
    x = np.linspace(0, 1, 17)
    wave = np.stack([x, 0.5 + 0.2 * np.sin(2 * np.pi * x)], 1)
    return UnitCell.of(list(pairwise(wave.tolist())), (1, 1))


def _truchet() -> UnitCell:
    """Two quarters of circles about opposite corners (Smith 1987, after Truchet 1704)."""
    turn = np.linspace(0, np.pi / 2, 9)
    arc = 0.5 * np.stack([np.cos(turn), np.sin(turn)], 1)
    return UnitCell.of([arc.tolist(), (1 - arc).tolist()], (1, 1))


_DRAWINGS: dict[str, Callable[[], UnitCell]] = {
    "square": _square,
    "triangular": _triangular,
    "hexagonal": _hexagonal,
    "kagome": _kagome,
    "brick": _brick,
    "re-entrant": _reentrant,
    "wave": _wave,
    "truchet": _truchet,
}

NAMES = tuple(_DRAWINGS)
"""A new unit cell is one function here."""


@cache
def drawing(name: str) -> UnitCell:
    """The unit cell of this name.

    >>> round(drawing("hexagonal").density, 3), round(drawing("hexagonal").pore, 3)
    (1.155, 1.556)
    """
    return _DRAWINGS[name]()
