"""A region with one hole, or none, as two closed curves cut open along one line."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LinearRing, Polygon

from fdjax.errors import InputError
from fdjax.part.curve import Curve, Floats, polyline_at

ROUND = 2e-3
"""By what share of its radius a ring may leave a circle and count as one."""


RAYS = 256
"""Directions in which a ring has a point at least."""


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle: `centre`, shape (2,), and `radius`, mm."""

    centre: Floats
    radius: float

    @classmethod
    def of(cls, ring: LinearRing) -> "Circle | None":
        """The circle of the ring's own area and centroid, or None where the ring is none."""
        polygon = Polygon(ring)
        centre = shapely.get_coordinates(polygon.centroid)[0]
        radius = float(np.sqrt(polygon.area / np.pi))
        # The middles of sides too: a polygon of few corners is no circle.
        places = shapely.get_coordinates(ring)
        places = np.concatenate([places, (places[1:] + places[:-1]) / 2])
        off = np.abs(np.hypot(*(places - centre).T) - radius)
        return cls(centre, radius) if off.max() <= ROUND * radius else None


@dataclass(frozen=True, eq=False)
class Annulus:
    """The region between a hole and an outline, both run counter-clockwise from a cut.

    `hole` (xi = 0) and `outline` (xi = 1) are closed polylines over eta in [0, 1]; `cut` runs
    straight from the beginning of the hole to that of the outline.
    """

    hole: Curve
    outline: Curve
    cut: Curve

    @classmethod
    def of(cls, polygon: Polygon, what: str) -> "Annulus":
        """The annulus of a polygon with one hole; `what` asks for it, in words of an error.

        Equal eta lie in the same direction from the middle of the hole where every ray from there
        meets hole and outline once; otherwise at equal shares of their lengths, from the point of
        the outline nearest to the hole on. Raises `InputError` for none or several holes.
        """
        rings = polygon.interiors
        if len(rings) != 1:
            raise InputError(
                f"part: has {len(rings)} holes; {what} needs an outline with exactly one; "
                'use pattern kind "isolines"'
            )
        inner, outer = (_counterclockwise(ring) for ring in (rings[0], polygon.exterior))
        middle = shapely.get_coordinates(Polygon(inner).centroid)[0]
        curves = [_by_angle(ring, middle) for ring in (inner, outer)]
        if any(curve is None for curve in curves):
            begin = shapely.get_coordinates(shapely.shortest_line(outer, inner))
            curves = [_by_length(inner, begin[1]), _by_length(outer, begin[0])]
        hole, outline = curves
        assert hole is not None
        assert outline is not None
        return cls(hole, outline, _straight(hole.start, outline.start))


def between_circles(inner: Circle, outer: Circle) -> Annulus:
    """The annulus between two circles about one centre, as polylines of `RAYS` sides."""
    angle = 2 * np.pi * np.arange(RAYS + 1) / RAYS
    turn = np.stack([np.cos(angle), np.sin(angle)], 1)
    turn[-1] = turn[0]
    hole, outline = (
        polyline_at(angle / (2 * np.pi), outer.centre + each.radius * turn)
        for each in (inner, outer)
    )
    return Annulus(hole, outline, _straight(hole.start, outline.start))


def _counterclockwise(ring: LinearRing) -> LinearRing:
    return ring if ring.is_ccw else ring.reverse()


def _by_angle(ring: LinearRing, middle: Floats) -> Curve | None:
    """The ring from the ray along x on, over the angle; None where a ray meets it twice."""
    xy = np.asarray(ring.coords)[:-1, :2] - middle
    angle = np.arctan2(*xy.T[::-1]) % (2 * np.pi)
    # Just below 0, by rounding, is 0 and not a whole turn.
    angle[angle > 2 * np.pi - 1e-9] = 0.0
    first = int(np.argmin(angle))
    xy, angle = np.roll(xy, -first, 0), np.roll(angle, -first)
    if not (np.diff(angle) > 1e-9).all() or not Polygon(ring).covers(shapely.Point(middle)):
        return None
    # The angle is not even along a side: points between the corners make it nearly so.
    rays = 2 * np.pi * np.arange(RAYS) / RAYS
    rays = rays[np.abs(rays[:, None] - angle).min(1) > 1e-3 / RAYS]
    side = np.searchsorted(angle, rays) - 1
    start, along = xy[side], xy[(side + 1) % len(xy)] - xy[side]
    way = np.stack([np.cos(rays), np.sin(rays)], 1)
    distance = _cross(start, along) / _cross(way, along)
    turned = np.append(angle, rays)
    order = np.argsort(turned)
    points = middle + np.concatenate([xy, distance[:, None] * way])[order]
    share = turned[order] / (2 * np.pi)
    share[0] = 0.0
    return polyline_at(np.append(share, 1.0), np.concatenate([points, points[:1]]))


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _by_length(ring: LinearRing, begin: Floats) -> Curve:
    """The ring from a point on it on, over its length."""
    xy = np.asarray(ring.coords)[:, :2]
    walked = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    at = ring.project(shapely.Point(begin))
    place = (walked[:-1] - at) % walked[-1]
    order = np.argsort(place)
    order = order[(place[order] > 1e-9 * walked[-1]) & (place[order] < (1 - 1e-9) * walked[-1])]
    start = shapely.get_coordinates(ring.interpolate(at))
    share = np.concatenate([[0.0], place[order] / walked[-1], [1.0]])
    return polyline_at(share, np.vstack([start, xy[order], start]))


def _straight(start: Floats, end: Floats) -> Curve:
    return polyline_at(np.array([0.0, 1.0]), np.stack([start, end]))
