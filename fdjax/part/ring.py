"""One closed ring of an outline: mended, and refused with the place where it is none."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import LinearRing, Polygon

from fdjax.errors import InputError
from fdjax.part.curve import Floats, as_points

Hole = Polygon | LinearRing | ArrayLike
Mask = NDArray[np.bool_]

MERGED = 1e-6
"""Points of a ring nearer than this to the one before are one, mm."""
JOINED = 0.05
"""The same where roads are to be laid, as a share of their width."""
STRAIGHT = 1e-9
"""How far a point that is left out as collinear may lie off the ring, as a share of its size."""


@dataclass(frozen=True, eq=False)
class Mended:
    """A simple closed ring, and how many of the points it was given are left out.

    - `joined`: the first of those that were not the very point before them, None without any.
    """

    ring: LinearRing
    repeated: int = 0
    collinear: int = 0
    joined: tuple[float, float] | None = None

    def note(self, name: str) -> str:
        """What was left out, in words; empty where nothing was."""
        counts = ((self.repeated, "repeated"), (self.collinear, "collinear"))
        found = " and ".join(f"{count} {kind}" for count, kind in counts if count)
        points = "point" if self.repeated + self.collinear == 1 else "points"
        where = f", the first at {at(self.joined)} close to another" if self.joined else ""
        return f"{name}: {found} {points} left out{where}" if found else ""


def mended_ring(
    points: Hole, name: str, *, merged: float = MERGED, straight: float = 0.0
) -> Mended:
    """A polygon's exterior, a ring or points as one simple closed ring; `name` is for errors.

    - `merged`: a point nearer than this to the one kept before it is left out.
    - `straight`: so are points from which the ring without them is no further than this share of
      the ring's size; 0 keeps all.

    Raises `InputError` with the place for a ring that crosses or touches itself, has fewer than
    three distinct points, a point that is not finite or no area.
    """
    if isinstance(points, Polygon):
        if points.interiors:
            raise InputError(f"{name}: has holes itself; give a plain ring")
        points = points.exterior
    if isinstance(points, LinearRing):
        points = shapely.get_coordinates(points)
    given = as_points(points, name)
    given = given[:-1] if (given[0] == given[-1]).all() else given
    apart = _apart(given, merged)
    xy = given[apart]
    if len(xy) < 3:
        least = f" further apart than {merged:g}" if merged > MERGED else ""
        raise InputError(f"{name}: has {len(xy)} distinct points{least}; at least 3 are needed")
    last = given[np.maximum.accumulate(np.where(apart, np.arange(len(given)), 0))]
    off = np.minimum(np.abs(given - last).max(1), np.abs(given - given[0]).max(1))
    near = given[~apart & (off > MERGED)]
    joined = (float(near[0, 0]), float(near[0, 1])) if len(near) else None
    size = np.ptp(xy, axis=0).max()
    kept = xy[_bends(xy, straight * size)] if straight else xy
    ring = LinearRing(kept if len(kept) > 2 else xy)
    if ring.convex_hull.area < 1e-12 * size**2:
        raise InputError(f"{name}: has no area, all points lie on one line by {at(xy[0])}")
    fault = re.fullmatch(r"(.*)\[(\S+) (\S+).*\]", shapely.is_valid_reason(Polygon(ring)))
    if fault:
        how = "touches" if fault[1].startswith("Ring") else "crosses"
        place = at((float(fault[2]), float(fault[3])))
        raise InputError(f"{name}: {how} itself at {place}; a simple ring is needed")
    return Mended(ring, len(given) - len(xy), len(xy) - len(kept), joined)


def _apart(xy: Floats, least: float) -> Mask:
    """Which points of a ring lie further than `least` from the one kept before them."""
    kept = np.ones(len(xy), bool)
    if (np.abs(np.diff(xy, axis=0)).max(1, initial=0) <= least).any():
        x, y = xy[0]
        for k, (u, v) in enumerate(xy[1:].tolist(), 1):
            if max(abs(u - x), abs(v - y)) <= least:
                kept[k] = False
            else:
                x, y = u, v
    for k in np.flatnonzero(kept)[:0:-1]:
        if np.abs(xy[k] - xy[0]).max() > least:
            break
        kept[k] = False
    return kept


def _bends(xy: Floats, tolerance: float) -> Mask:
    """Which points a ring needs lest any of the others lie further than `tolerance` off it.

    Points off the chord of their neighbours stay. Between these, runs are cut at their farthest
    point until none is too far (Douglas and Peucker), so that gentle curves keep their shape.
    """
    needed = _off(xy, np.roll(xy, 1, 0), np.roll(xy, -1, 0)) > tolerance
    rightwards = np.lexsort((xy[:, 1], xy[:, 0]))
    needed[rightwards[[0, -1]]] = True
    free = np.flatnonzero(~needed)
    while len(free):
        ends = np.flatnonzero(needed)
        run = np.searchsorted(ends, free) - 1  # -1 is the run across the ring's beginning
        off = _off(xy[free], xy[ends[run]], xy[ends[(run + 1) % len(ends)]])
        order = np.lexsort((off, run))
        farthest = order[np.append(np.diff(run[order]) > 0, True)]
        cut = farthest[off[farthest] > tolerance]
        needed[free[cut]] = True
        free = np.setdiff1d(free[np.isin(run, run[cut])], free[cut], assume_unique=True)
    return needed


def _off(xy: Floats, start: Floats, end: Floats) -> Floats:
    """Distances of points from segments, one by one."""
    along, place = end - start, xy - start
    square = (along**2).sum(1)
    share = np.clip((along * place).sum(1) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    return np.hypot(*(place - share[:, None] * along).T)


def at(point: Any) -> str:
    """A place in words of an error."""
    return f"({point[0]:g}, {point[1]:g})"


def inside(place: shapely.Geometry) -> str:
    """A point of a geometry in words of an error."""
    point = shapely.point_on_surface(place)
    return at((point.x, point.y))
