"""Walls: the rings that centre lines may reach but not cross, measured along their length."""

from dataclasses import dataclass

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

Floats = NDArray[np.float64]


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

    @property
    def length(self) -> float:
        return float(self.at[-1])

    def point(self, position: Floats) -> Floats:
        """Points at these positions, shape position.shape + (2,)."""
        s = np.asarray(position) % self.length
        return np.stack([np.interp(s, self.at, self.xy[:, axis]) for axis in (0, 1)], -1)

    def corners(self, a: float, b: float) -> Floats:
        """Positions of the vertices strictly between `a` and `b`, in the order of the walk."""
        low, high = min(a, b), max(a, b)
        turns = np.arange(np.floor(low / self.length), np.floor(high / self.length) + 1)
        at = (self.at[:-1] + self.length * turns[:, None]).ravel()
        at = at[(at > low + 1e-9) & (at < high - 1e-9)]
        return at if b >= a else at[::-1]

    def way(self, a: float, b: float) -> Floats:
        """The polyline along the wall from position `a` to position `b`, shape (points, 2)."""
        return self.point(np.concatenate([[a], self.corners(a, b), [b]]))

    def locate(self, xy: Floats) -> Floats:
        """Positions of the nearest points of the wall to `xy`, shape (n, 2)."""
        return np.asarray(line_locate_point(LineString(self.xy), points(xy)))


def rings(region: Polygon | MultiPolygon) -> list[LinearRing]:
    """Every ring of the region's boundary, holes included."""
    parts = region.geoms if isinstance(region, MultiPolygon) else (region,)
    return [ring for part in parts for ring in (part.exterior, *part.interiors)]


def free_region(outline: Polygon, margin: float) -> Polygon | MultiPolygon:
    """What of the outline is at least `margin` mm away from it and from its holes.

    Offset with mitred joins, so that straight sides keep their corners. Raises `InputError` when
    nothing is left.
    """
    if not isinstance(outline, Polygon) or outline.is_empty or not outline.is_valid:
        raise InputError("outline: not a simple polygon with a positive area")
    region = outline.buffer(-margin, join_style="mitre")
    if region.is_empty or not isinstance(region, Polygon | MultiPolygon):
        raise InputError(f"outline: nowhere wide enough for a road {2 * margin:g} mm wide")
    return region
