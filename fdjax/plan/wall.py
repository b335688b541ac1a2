"""Walls: the rings that centre lines may reach but not cross, measured along their length."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from shapely import (
    LinearRing,
    LineString,
    MultiPolygon,
    Polygon,
    line_locate_point,
    points,
)

from fdjax.errors import InputError
from fdjax.part.neck import inset

Floats = NDArray[np.float64]

_MITRE = 5.0
"""Corners of walls reach no further than this many margins: notches of 23 degrees keep theirs."""


@dataclass(frozen=True, eq=False)
class Wall:
    """One closed ring; a position on it is the length walked from its first vertex, mm.

    - `xy`: vertices, shape (n + 1, 2), the first repeated at the end.
    - `at`: position of each vertex, shape (n + 1,).

    Positions are taken modulo `length`, so a way round the ring is a pair of positions of which
    the second may lie below zero or above `length`.
    """

    xy: Floats
    at: Floats

    @classmethod
    def of(cls, ring: LinearRing) -> "Wall":
        xy = np.asarray(ring.coords, float)[:, :2]
        steps = np.hypot(*np.diff(xy, axis=0).T)
        keep = np.concatenate([[True], steps > 0])
        return cls(xy[keep], np.concatenate([[0.0], np.cumsum(steps[steps > 0])]))

    @cached_property
    def length(self) -> float:
        return float(self.at[-1])

    def point(self, position: Floats) -> Floats:
        """Points at these positions, shape position.shape + (2,)."""
        s = np.asarray(position, float) % self.length
        return np.stack([np.interp(s, self.at, self.xy[:, axis]) for axis in (0, 1)], -1)

    def corners(self, a: float, b: float) -> Floats:
        """Vertices strictly between positions `a` and `b`, in the order of the walk."""
        return self.xy[self._between(a, b)[0]]

    def corner_positions(self, a: float, b: float) -> Floats:
        """Positions of the same, in the walk's own turns."""
        index, turn = self._between(a, b)
        return self.at[index] + turn * self.length

    def _between(self, a: float, b: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Index of each vertex between and the turn of the ring on which it is met."""
        low, high = min(a, b) + 1e-9, max(a, b) - 1e-9
        count = len(self.at) - 1
        first, last = (
            int(self.at[:-1].searchsorted(place % self.length)) + int(place // self.length) * count
            for place in (low, high)
        )
        steps = np.arange(first, last)
        if b < a:
            steps = steps[::-1]
        return steps % count, steps // count

    def locate(self, xy: Floats) -> Floats:
        """Positions of the nearest points of the wall to `xy`, shape (n, 2)."""
        return np.asarray(line_locate_point(self.course, points(xy)))

    @cached_property
    def course(self) -> LineString:
        """The ring as a line."""
        return LineString(self.xy)


def rings(region: Polygon | MultiPolygon) -> list[LinearRing]:
    """Every ring of the region's boundary, holes included."""
    parts = region.geoms if isinstance(region, MultiPolygon) else (region,)
    return [ring for part in parts for ring in (part.exterior, *part.interiors)]


def free_region(outline: Polygon | MultiPolygon, margin: float) -> Polygon | MultiPolygon:
    """What of the outline is at least `margin` mm away from it and from its holes.

    Offset with mitred joins, so that straight sides keep their corners. Raises `InputError` when
    nothing is left.
    """
    if not isinstance(outline, Polygon | MultiPolygon) or outline.is_empty or not outline.is_valid:
        raise InputError("outline: not made of simple polygons with a positive area")
    parts = inset(outline, margin, mitre=_MITRE)
    if not parts:
        raise InputError(f"outline: nowhere wide enough for a road {2 * margin:g} mm wide")
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)
