"""Where a closed outline is cut into the four sides of a patch."""

import numpy as np
from numpy.typing import ArrayLike
from shapely import LinearRing, MultiPoint, box, get_coordinates

from fdjax.errors import InputError
from fdjax.part.curve import Floats, as_points

TOLERANCE = 1e-4
"""How far a named corner may lie from the outline, as a share of the outline's size."""

_TIE = 1e-9
"""Differences of distance below this share of the outline's size are rounding."""


def four_sides(outline: LinearRing, corners: ArrayLike | None = None) -> list[Floats]:
    """The outline's points from each corner to the next: bottom, right, top, left as they run.

    `outline` runs counter-clockwise and repeats no point; so run the sides: top with falling xi,
    left with falling eta. `corners` are four points on the outline, shape (4, 2), mm,
    counter-clockwise from (xi, eta) = (0, 0). A corner in the middle of an edge becomes a point of
    both its sides; one within `TOLERANCE` of a point of the outline is that point.

    Without `corners` they are chosen: the outline's points nearest to the four corners of the
    smallest rectangle around it, which is the bounding box, or the minimum rotated rectangle
    where that is over 10 % smaller; of equally near points the first counter-clockwise. If these
    are not four different points in order (a triangle), places in the middle of edges count too.
    The corner nearest to the lower left of the bounding box is (0, 0); of equally near ones the
    lower.

    Raises `InputError` for named corners that are not on the outline, not four different ones or
    not in order, and if the rule finds no four: they must then be named.

    >>> bottom, right, top, left = four_sides(box(0, 0, 3, 2).exterior)
    >>> bottom.tolist(), top.tolist()
    ([[0.0, 0.0], [3.0, 0.0]], [[3.0, 2.0], [0.0, 2.0]])
    """
    xy = np.asarray(outline.coords)[:-1, :2]
    at = _chosen(xy) if corners is None else _named(xy, as_points(corners, "corners"))
    points = _points(xy, at)
    pieces = []
    for k, here in enumerate(at):
        there = at[(k + 1) % 4]
        there += len(xy) * (there <= here)
        between = np.arange(np.floor(here) + 1, np.ceil(there)).astype(int) % len(xy)
        pieces.append(np.vstack([points[k], xy[between], points[(k + 1) % 4]]))
    return pieces


# Below, a place on the outline is a number: 2.25 lies a quarter of the way from point 2 to 3.


def _points(xy: Floats, at: Floats) -> Floats:
    """The points at these places."""
    k = np.floor(at).astype(int)
    start, end = xy[k % len(xy)], xy[(k + 1) % len(xy)]
    return start + (at - k)[:, None] * (end - start)


def _named(xy: Floats, corners: Floats) -> Floats:
    """The places of four named corners."""
    if len(corners) != 4:
        raise InputError(f"corners: {len(corners)} points are named; four are needed")
    at, distance = _nearest_places(xy, corners)
    worst = int(np.argmax(distance))
    if distance[worst] > TOLERANCE * _size(xy):
        (x, y), (near_x, near_y) = corners[worst], _points(xy, at)[worst]
        raise InputError(
            f"corners: corner {worst + 1} at ({x:g}, {y:g}) is {distance[worst]:.3g} mm off the "
            f"outline, which is nearest at ({near_x:.7g}, {near_y:.7g})"
        )
    if len(np.unique(at)) < 4:
        raise InputError("corners: two of the four are the same place on the outline")
    if not _in_order(at):
        around = np.argsort(at)
        order = 1 + np.roll(around, -int(np.argmin(around)))
        raise InputError(
            "corners: are not named counter-clockwise around the outline; that order would be "
            f"corners {', '.join(map(str, order))}"
        )
    return at


def _chosen(xy: Floats) -> Floats:
    """The places of four corners by the rule of `four_sides`."""
    rectangle = smallest_rectangle(xy)
    at = _nearest_vertices(xy, rectangle)
    if not _in_order(at):
        at, _ = _nearest_places(xy, rectangle)
    if not _in_order(at):
        raise InputError("outline: the rule finds no four different corners; name them")
    points = _points(xy, at)
    distance = np.hypot(*(points - xy.min(0)).T)
    tied = distance <= distance.min() + _TIE * _size(xy)
    return np.roll(at, -int(np.argmin(np.where(tied, points[:, 1], np.inf))))


def _in_order(at: Floats) -> bool:
    """Whether four places are different and follow each other once around."""
    turned = np.roll(at, -int(np.argmin(at)))
    return bool((np.diff(turned) > 0).all())


def _size(xy: Floats) -> float:
    return float(np.ptp(xy, axis=0).max())


def smallest_rectangle(xy: Floats) -> Floats:
    """Corners of the smallest rectangle around the points, counter-clockwise, shape (4, 2).

    One side of the smallest rectangle lies along an edge of the convex hull, so every edge is
    tried. GEOS 3.14's own search takes rectangles of no area where hull points are collinear up to
    rounding.
    """
    upright = box(*xy.min(0), *xy.max(0), ccw=True)
    hull = get_coordinates(MultiPoint(xy).convex_hull.simplify(TOLERANCE * _size(xy)))
    along = np.diff(hull, axis=0)
    along = (along / np.hypot(*along.T)[:, None]).T
    frames = np.stack([along, (-along[1], along[0])])  # (axis, component, edge)
    places = np.tensordot(frames, xy - xy.mean(0), axes=(1, 1))  # (axis, edge, point)
    low, high = places.min(2), places.max(2)
    areas = (high - low).prod(0)
    best = int(areas.argmin())
    if areas[best] >= 0.9 * upright.area:
        return np.asarray(upright.exterior.coords)[:-1]
    sides = np.stack([low[:, best], high[:, best]])
    return sides[[[0, 0], [1, 0], [1, 1], [0, 1]], [0, 1]] @ frames[..., best] + xy.mean(0)


def _nearest_vertices(xy: Floats, rectangle: Floats) -> Floats:
    """For each corner of the rectangle the nearest vertex; of tied ones the most clockwise."""
    distance = np.hypot(*(xy[:, None] - rectangle).transpose(2, 0, 1))
    tied = distance <= distance.min(0) + _TIE * _size(xy)
    (x, y), (corner_x, corner_y) = (xy - rectangle.mean(0)).T, (rectangle - rectangle.mean(0)).T
    turn = np.outer(y, corner_x) - np.outer(x, corner_y)
    return np.where(tied, turn, np.inf).argmin(0).astype(float)


def _nearest_places(xy: Floats, points: Floats) -> tuple[Floats, Floats]:
    """For each point the nearest place, at a vertex where one is close, and its distance."""
    step = np.roll(xy, -1, axis=0) - xy
    edge_length = np.hypot(*step.T)[:, None]
    offset = points - xy[:, None]
    share = np.clip((offset * step[:, None]).sum(2) / edge_length**2, 0, 1)
    gap = np.hypot(*(offset - share[..., None] * step[:, None]).transpose(2, 0, 1))
    to_vertex = np.minimum(share, 1 - share) * edge_length
    share = np.where(to_vertex <= TOLERANCE * _size(xy), np.round(share), share)
    edge, each = gap.argmin(0), np.arange(len(points))
    return (edge + share[edge, each]) % len(xy), gap[edge, each]
