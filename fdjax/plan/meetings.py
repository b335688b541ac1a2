"""Where beads of a graph meet, and what they hold twice there."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.plan.segments import Segments

Floats = NDArray[np.float64]

_TOUCH = 1e-6
"""Two points closer than this are one, mm."""

_NARROW = 0.1
"""Beads that meet at a smaller angle, radians, are taken to meet at this one."""


class Meetings(NamedTuple):
    """Nodes, shape (n, 2), mm, and the area that their beads cover more than once, (n,), mm^2."""

    xy: Floats
    area: Floats

    @classmethod
    def of(cls, segments: Segments) -> "Meetings":
        """The points of a graph's roads from which three beads or more go out.

        Beads are strips with flat sides, as wide as their road. Two neighbours at an angle t below
        180 degrees, with half widths a and b, share the kite between them:
        `(2 a b + (a^2 + b^2) cos t) / (2 sin t)`, a^2 / tan(t / 2) for equal ones. The sum over all
        neighbours is the sum of the beads less their union, as long as each is longer than its
        kites; for two beads that cross it is `w1 w2 / sin t`.

        >>> from fdjax.plan.toolpath import Road
        >>> star = [Road([(0, 0), (np.cos(t), np.sin(t))], 0.4, family="mesh")
        ...         for t in np.arange(3) * 2 * np.pi / 3]
        >>> Meetings.of(Segments.of(star)).area.round(6)
        array([0.069282])
        """
        own = segments.of_graph[segments.road]
        start, end, unit = segments.start[own], segments.end[own], segments.unit[own]
        place = np.concatenate([start, end])
        away = np.concatenate([unit, -unit])
        half = np.tile(segments.width[own] / 2, 2)
        _, first, node = np.unique(
            np.round(place / _TOUCH) @ [1, 1j], return_index=True, return_inverse=True
        )
        crowd = np.bincount(node, minlength=len(first))
        kept = crowd[node] > 2
        node, half = node[kept], half[kept]
        angle = np.arctan2(away[kept, 1], away[kept, 0])
        order = np.lexsort((angle, node))
        node, half, angle = node[order], half[order], angle[order]
        begins = np.concatenate([[True], node[1:] != node[:-1]])[: len(node)]
        following = np.arange(1, len(node) + 1)
        last = np.roll(begins, -1)
        following[last] = np.flatnonzero(begins)
        turn = np.maximum((angle[following] - angle) % (2 * np.pi), _NARROW)
        a, b = half, half[following]
        with np.errstate(divide="ignore", invalid="ignore"):
            kite = (2 * a * b + (a**2 + b**2) * np.cos(turn)) / (2 * np.sin(turn))
        kite = np.where(turn < np.pi, np.maximum(kite, 0.0), 0.0)
        area = np.bincount(node, kite, len(first)).astype(float)
        met = crowd > 2
        return cls(place[first[met]], area[met])
