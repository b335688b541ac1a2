"""A region with one hole, cut open from its outline to the hole: the four sides of a C."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LinearRing, LineString, Polygon
from shapely.ops import substring

from fdjax.errors import InputError
from fdjax.part.corners import TOLERANCE, four_sides
from fdjax.part.curve import Curve, Floats, polyline, polyline_at
from fdjax.part.ring import at

_NARROW = 0.01
"""Nearer to the cut than this share of the outline's length a corner ends no side."""


@dataclass(frozen=True, eq=False)
class Slit:
    """The region between a hole and an outline as four sides, with a cut between the two.

    - `left` (xi = 0): from the outline along the cut to the hole, once around it counter-clockwise,
      and back along the cut; `right` (xi = 1): the outline but for the side that the cut ends on.
    - `bottom` and `top` (eta = 0 and 1): that side, from the cut to its ends.
    - `tail`: the eta at which `left` comes to the hole; it leaves the hole at 1 - `tail`.
    """

    bottom: Curve
    right: Curve
    top: Curve
    left: Curve
    tail: float

    @classmethod
    def of(
        cls, polygon: Polygon, what: str, place: Sequence[float] | None = None, *, steps: int = 64
    ) -> "Slit":
        """The C of a polygon with one hole; `what` asks for it, in words of an error.

        The cut is straight, from `place` on the outline (x, y), mm, to the point of the hole that
        is nearest; by default it is the shortest there is. The side that it ends on is that of
        `fdjax.part.corners.four_sides`. On `left` eta goes with the length, `tail` a whole number
        of `steps` to the unit. On the outline eta up to `tail` is as long as the cut, so that lines
        from there keep their distance, or as long as that share of it where that is less.

        Raises `InputError` for none or several holes, a place off the outline and a cut that
        leaves the part.
        """
        if len(polygon.interiors) != 1:
            raise InputError(
                f"part: has {len(polygon.interiors)} holes; {what} needs an outline with exactly "
                'one; use pattern kind "isolines"'
            )
        outer, hole = (
            ring if ring.is_ccw else ring.reverse()
            for ring in (LinearRing(polygon.exterior), LinearRing(polygon.interiors[0]))
        )
        end, tail = _cut(outer, hole, place)
        bottom, right, top = _sides(outer, end)
        around = _from(hole, hole.project(shapely.Point(tail)))
        around[[0, -1]] = tail
        cut, girth = float(np.hypot(*(tail - end))), LineString(around).length
        steps_of_cut = round(cut / (2 * cut + girth) * steps)
        share = int(np.clip(steps_of_cut, 4, steps // 2 - 4)) / steps
        left = polyline_at(
            np.concatenate([[0.0], _shares(around, [0, 1], [share, 1 - share]), [1.0]]),
            np.vstack([end, around, end]),
        )
        length = LineString(right).length
        abreast = min(cut / length, share)
        places = np.array([0.0, abreast, 1 - abreast, 1.0])
        right = _with_points(right, places[1:-1])
        right = polyline_at(_shares(right, places, [0, share, 1 - share, 1]), right)
        return cls(polyline(bottom), right, polyline(top), left, share)


def _cut(
    outer: LinearRing, hole: LinearRing, place: Sequence[float] | None
) -> tuple[Floats, Floats]:
    """Where the cut ends on the outline and on the hole."""
    size = float(np.ptp(np.asarray(outer.coords), axis=0).max())
    if place is None:
        line = shapely.shortest_line(outer, hole)
    else:
        point = shapely.Point(place)
        near = shapely.shortest_line(point, outer)
        if near.length > TOLERANCE * size:
            raise InputError(
                f"cut: {at(place)} is {near.length:.3g} mm off the outline, which is nearest at "
                f"{at(near.coords[-1])}; name a place on it"
            )
        line = shapely.shortest_line(shapely.Point(near.coords[-1]), hole)
    inner = substring(line, 0.01, 0.99, normalized=True)
    room = Polygon(outer, [hole])
    if not room.contains(inner) or outer.distance(inner) < 1e-3 * line.length:
        off = shapely.shortest_line(outer, inner).coords[0]
        raise InputError(
            f"cut: from {at(line.coords[0])} straight to the hole at {at(line.coords[-1])} it "
            f"leaves the part or touches its outline near {at(off)}; name a place in sight of the "
            "hole"
        )
    end, tail = shapely.get_coordinates(line)
    return end, tail


def _sides(outer: LinearRing, end: Floats) -> tuple[Floats, Floats, Floats]:
    """The outline from the cut's end to the next corner, from there to the last, and back."""
    length = outer.length
    start = outer.project(shapely.Point(end))
    corners = np.array([outer.project(shapely.Point(side[0])) for side in four_sides(outer)])
    after = np.sort((corners - start) % length)
    after = after[np.minimum(after, length - after) > _NARROW * length]
    run = LineString(_from(outer, start))
    bottom, right, top = (
        shapely.get_coordinates(substring(run, a, b))
        for a, b in ((0.0, after[0]), (after[0], after[-1]), (after[-1], length))
    )
    bottom[0] = top[-1] = end
    right[0], right[-1] = bottom[-1], top[0]
    return bottom, right, top[::-1]


def _from(ring: LinearRing, start: float) -> Floats:
    """The ring's points from a place on it on, once around."""
    length = ring.length
    line = LineString(ring.coords)
    parts = [substring(line, start, length), substring(line, 0.0, start)]
    xy = np.concatenate([shapely.get_coordinates(part) for part in parts])
    moved = np.hypot(*np.diff(xy, axis=0).T) > 1e-9 * length
    xy = xy[np.append(True, moved)]
    xy[-1] = xy[0]
    return xy


def _shares(xy: Floats, known: Sequence[float] | Floats, shares: Sequence[float]) -> Floats:
    """The parameter at the points of a polyline, which is known at some shares of its length."""
    walked = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
    return np.interp(walked / walked[-1], known, shares)


def _with_points(xy: Floats, places: Floats) -> Floats:
    """A polyline with points of its own at these shares of its length."""
    line = LineString(xy)
    walked = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
    at_ = places * walked[-1]
    own = np.abs(walked[:, None] - at_).min(1) > 1e-9 * walked[-1]
    own[[0, -1]] = True
    points = shapely.get_coordinates(line.interpolate(at_))
    order = np.argsort(np.concatenate([walked[own], at_]), kind="stable")
    return np.concatenate([xy[own], points])[order]
