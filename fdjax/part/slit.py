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

_SHARPEST = np.radians(45)
"""Half of the part's angle where the cut meets the hole is taken to be at least this."""

_EQUAL = 1e-3
"""Cuts longer by less than this share are equally short."""

_CLEAR = 0.3
"""Tangent of the angle that the line from the tail keeps from a straight wall, at least."""

_FINE, _POINTS = 2048, 48
"""Places around a hole at which eta is worked out, and how many of them become points."""


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
        is nearest; by default it is the shortest there is, in the middle of equal ones. The side
        that it ends on is that of `fdjax.part.corners.four_sides`. On `left` eta goes with the
        length, `tail` a whole number of `steps` to the unit. Near the tail, where the part's angle
        is a, it goes with the length to the power (1 + 2 pi / a) / 2: halfway to a conformal map's,
        since at the power of 1 an elliptic grid folds there, however small the place. On the
        outline eta up to `tail` is as long as the cut, so that lines from there keep their
        distance; less where that share of the outline is shorter, or out of sight of the tail.

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
        around, eta = _around(around, end - tail, min(cut, girth / 4) / girth)
        left = polyline_at(
            np.concatenate([[0.0], share + (1 - 2 * share) * eta, [1.0]]),
            np.vstack([end, around, end]),
        )
        length = LineString(right).length
        one, other = (
            _abreast(polygon, tail, way, min(cut, share * length)) / length
            for way in (right, right[::-1])
        )
        places = np.array([0.0, one, 1 - other, 1.0])
        right = _with_points(right, places[1:-1])
        right = polyline_at(_shares(right, places, [0, share, 1 - share, 1]), right)
        return cls(polyline(bottom), right, polyline(top), left, share)


def _cut(
    outer: LinearRing, hole: LinearRing, place: Sequence[float] | None
) -> tuple[Floats, Floats]:
    """Where the cut ends on the outline and on the hole."""
    size = float(np.ptp(np.asarray(outer.coords), axis=0).max())
    if place is None:
        line = _shortest(outer, hole)
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


def _shortest(outer: LinearRing, hole: LinearRing) -> LineString:
    """The shortest cut; of equally short ones side by side that in their middle."""
    line = shapely.shortest_line(outer, hole)
    reach = Polygon(hole).buffer((1 + _EQUAL) * line.length, quad_segs=64)
    near = shapely.line_merge(shapely.intersection(LineString(outer.coords), reach))
    parts = [part for part in shapely.get_parts(near).tolist() if isinstance(part, LineString)]
    if parts:
        middle = max(parts, key=lambda part: part.length).interpolate(0.5, normalized=True)
        line = shapely.shortest_line(middle, hole)
    return line


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
    bottom, right, top = map(_distinct, (bottom, right, top))
    bottom[0] = top[-1] = end
    right[0], right[-1] = bottom[-1], top[0]
    return bottom, right, top[::-1]


def _around(around: Floats, cut: Floats, reach: float) -> tuple[Floats, Floats]:
    """Points around a hole from where the cut meets it, and their eta, from 0 to 1.

    `reach`: how far from there, as a share of the hole's girth, the angle with the cut matters.
    """
    cosines = [
        wall @ cut / (np.hypot(*wall) * np.hypot(*cut))
        for wall in (around[1] - around[0], around[-2] - around[-1])
    ]
    # Half of the part's angle there: the cut is free to leave halfway between both walls.
    angle = max(np.arccos(np.clip(cosines, -1, 1)).mean(), _SHARPEST)
    fine = np.linspace(0, 1, _FINE + 1)
    middle = (fine[1:] + fine[:-1]) / 2
    near = np.minimum(np.minimum(middle, 1 - middle) / reach, 1.0)
    density = near ** ((np.pi / angle - 1) / 2)
    eta = np.append(0.0, np.cumsum(density)) / density.sum()
    near = fine[(fine > 0) & (np.minimum(fine, 1 - fine) < reach)]
    xy = _with_points(around, near[:: max(1, len(near) // _POINTS)])
    return xy, _shares(xy, fine, eta)


def _abreast(room: Polygon, tail: Floats, way: Floats, most: float) -> float:
    """How far along the outline a line from the tail ends, at most `most` mm, in sight of it."""
    hole = room.interiors[0]
    off = hole.length / 8
    along = most * np.linspace(1.0, 0.1, 10)
    places = shapely.get_coordinates(shapely.line_interpolate_point(LineString(way), along))
    distance = np.hypot(*(places - tail).T)[:, None]
    begins = tail + np.minimum(off / distance, 0.5) * (places - tail)
    sight = shapely.linestrings(np.stack([begins, places], 1))
    # Clear of the hole from an eighth of its girth on: a line along its wall is none.
    clear = shapely.covers(room, sight) & (shapely.distance(hole, sight) > _CLEAR * off)
    return float(along[int(np.argmax(clear))] if clear.any() else along[-1])


def _distinct(xy: Floats) -> Floats:
    """A polyline without points that repeat the one before."""
    moved = np.hypot(*np.diff(xy, axis=0).T) > 1e-9 * np.ptp(xy, axis=0).max()
    return xy[np.append(True, moved)]


def _from(ring: LinearRing, start: float) -> Floats:
    """The ring's points from a place on it on, once around."""
    length = ring.length
    line = LineString(ring.coords)
    parts = [substring(line, start, length), substring(line, 0.0, start)]
    xy = np.concatenate([shapely.get_coordinates(part) for part in parts])
    xy = _distinct(xy)
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
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, at_))
    order = np.argsort(np.concatenate([walked[own], at_]), kind="stable")
    return np.concatenate([xy[own], points])[order]
