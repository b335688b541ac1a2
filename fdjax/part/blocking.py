"""Blocks of a region, found by themselves: right-angled outlines, rings, discs and their like."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely import LinearRing, LineString, Point, Polygon, affinity

from fdjax.errors import InputError
from fdjax.part.blocks import MEET, MOST, Blocks
from fdjax.part.corners import four_sides
from fdjax.part.curve import Curve, Floats, polyline
from fdjax.part.ring import at

DEEP = 0.55
"""Depth of the blocks round the patch in the middle of an outline without corners, as a share of
the radius of the largest circle in it; less, by halves, where the outline has a neck."""

BULGE = 0.5, 0.25, 0.75, 1.0
"""How far the sides of that patch go from the straight line to the outline's inner parallel: at
half the way the three angles at its corners in a disc are about alike."""

THIN = 4.0
"""So many road widths a block is wide at least."""

ELSE = 'name them with pattern.blocks, or use pattern kind "isolines"'


def blocks_of(region: Polygon, road_width: float) -> Blocks:
    """Blocks that cover a region.

    - An outline whose sides are at right angles (L, T, cross, plate), with any holes: cells of the
      lines on which its sides lie, and of cuts between the holes; around a hole four blocks.
    - An outline with one hole: four blocks around it.
    - A triangle, or a convex polygon of five or six sides: one block at each corner.
    - Any other outline without holes: a patch in the middle and four blocks around it.

    Raises `InputError` where that gives no blocks.
    """
    squared = _squared(region)
    if squared is None and not region.interiors:
        return _inside(region)
    if squared is not None:
        quads = _cells(region, *squared, THIN * road_width)
    elif len(region.interiors) == 1:
        quads = _around(region, _corners(region))
    else:
        raise InputError(
            f"part: {len(region.interiors)} holes in an outline that has no right angles only: "
            f"no blocks are found by themselves; {ELSE}"
        )
    return _made(region, quads)


def _made(region: Polygon, quads: Any, curves: Sequence[Curve] = ()) -> Blocks:
    try:
        return Blocks.of(region, quads, curves)
    except InputError as fault:
        raise InputError(
            f"part: the blocks found by themselves do not fit: {fault}; {ELSE}"
        ) from None


def _corners(region: Polygon) -> Floats:
    """Four corners of its outline, counter-clockwise, (4, 2)."""
    ring = region.exterior if region.exterior.is_ccw else region.exterior.reverse()
    return np.stack([side[0] for side in four_sides(ring)])


def _squared(region: Polygon) -> tuple[float, Floats] | None:
    """The angle of an outline with right angles, degrees, and its points turned upright."""
    xy = np.asarray(region.exterior.coords)
    step = np.diff(xy, axis=0)
    if len(step) > 4 * MOST:
        return None
    longest = step[np.hypot(*step.T).argmax()]
    angle = float(np.degrees(np.arctan2(longest[1], longest[0])) % 90)
    turned = shapely.get_coordinates(affinity.rotate(region.exterior, -angle, origin=(0, 0)))
    off = np.abs(np.diff(turned, axis=0)).min(1)
    return (angle, turned) if off.max() <= MEET * np.ptp(turned, axis=0).max() else None


def _distinct(values: Floats, near: float) -> Floats:
    values = np.sort(values)
    return values[np.diff(values, prepend=-np.inf) > near]


def _cells(region: Polygon, angle: float, outline: Floats, thin: float) -> Floats:
    """Blocks of an outline with right angles, `outline` its points turned upright."""
    upright: Any = affinity.rotate(region, -angle, origin=(0, 0))
    near = MEET * float(np.ptp(outline, axis=0).max())
    lines = [_distinct(outline[:, k], near) for k in (0, 1)]
    holes = [Polygon(ring) for ring in upright.interiors]
    boxes = np.array([hole.bounds for hole in holes]).reshape(-1, 4)
    for k, own in enumerate(lines):
        crossed = (boxes[:, None, k] < own - near) & (boxes[:, None, k + 2] > own + near)
        lines[k] = np.sort(np.concatenate([own, _cuts(boxes[:, [k, k + 2]], own)]))
        if crossed.any():
            _refuse_crossing(upright, holes, own, k, angle)
    lines = _needed(lines, boxes, outline, near)
    for own in lines:
        if len(own) > 1 and np.diff(own).min() < thin:
            raise InputError(
                f"part: a block would be {np.diff(own).min():.2g} mm wide; no blocks are found by "
                f"themselves; {ELSE}"
            )
    x, y = lines
    filled = Polygon(upright.exterior)
    quads = []
    for i, j in np.ndindex(len(x) - 1, len(y) - 1):
        cell: Any = shapely.box(x[i], y[j], x[i + 1], y[j + 1])
        if not filled.contains(cell.centroid):
            continue
        inner = [hole for hole in holes if hole.intersects(cell) and hole.intersection(cell).area]
        if len(inner) > 1 or any(not cell.contains(hole) for hole in inner):
            where = affinity.rotate(inner[0].centroid, angle, origin=(0, 0))
            raise InputError(
                f"part: the hole at {at(shapely.get_coordinates(where)[0])} cannot be parted from "
                f"the others by straight cuts; no blocks are found by themselves; {ELSE}"
            )
        corners = np.array([(x[i], y[j]), (x[i + 1], y[j]), (x[i + 1], y[j + 1]), (x[i], y[j + 1])])
        if inner:
            quads += _around(Polygon(cell.exterior, [inner[0].exterior]), corners).tolist()
        else:
            quads.append(corners.tolist())
    turned = shapely.transform(
        shapely.points(np.array(quads).reshape(-1, 2)),
        lambda xy: xy @ _turn(angle).T,
    )
    return shapely.get_coordinates(turned).reshape(-1, 4, 2)


def _turn(angle: float) -> Floats:
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([[c, -s], [s, c]])


def _refuse_crossing(
    upright: Polygon, holes: list[Polygon], own: Floats, axis: int, angle: float
) -> None:
    """Raise `InputError` where a line on which sides of the outline lie meets a hole."""
    x0, y0, x1, y1 = upright.bounds
    for value in own[1:-1]:
        ends = [(value, y0), (value, y1)] if axis == 0 else [(x0, value), (x1, value)]
        for hole in holes:
            if LineString(ends).intersection(hole).length > 0:
                where = affinity.rotate(hole.centroid, angle, origin=(0, 0))
                raise InputError(
                    f"part: the hole at {at(shapely.get_coordinates(where)[0])} lies across a "
                    f"cut between blocks; no blocks are found by themselves; {ELSE}"
                )


def _cuts(spans: Floats, own: Floats) -> Floats:
    """Places in the gaps between spans, (n, 2), away from the lines that are there already."""
    cuts = []
    for end in spans[:, 1]:
        beyond = spans[spans[:, 0] >= end, 0]
        if len(beyond) and not ((spans[:, 0] < end) & (spans[:, 1] > end)).any():
            begin = float(beyond.min())
            inside = (own > end) & (own < begin)
            if not inside.any():
                cuts.append((float(end) + begin) / 2)
    return np.array(sorted(set(np.round(cuts, 9).tolist())), float)


def _needed(lines: list[Floats], boxes: Floats, outline: Floats, near: float) -> list[Floats]:
    """The lines without those cuts that part no two holes which others do not part."""

    def parted(x: Floats, y: Floats) -> bool:
        middle = (boxes[:, :2] + boxes[:, 2:]) / 2
        cell = np.stack([np.searchsorted(x, middle[:, 0]), np.searchsorted(y, middle[:, 1])], 1)
        return len(np.unique(cell, axis=0)) == len(cell)

    found = list(lines)
    if not len(boxes) or not parted(*found):
        return found
    for k in (0, 1):
        for value in lines[k]:
            if np.abs(outline[:, k] - value).min() <= near:
                continue
            fewer = list(found)
            fewer[k] = fewer[k][fewer[k] != value]
            if parted(*fewer):
                found = fewer
    return found


def _around(region: Polygon, corners: Floats) -> Floats:
    """Four blocks around a region's only hole, to these corners of its outline."""
    hole = Polygon(region.interiors[0])
    middle = shapely.get_coordinates(hole.centroid)[0]
    inner = np.stack([_hit(hole, middle, corner) for corner in corners])
    after = [1, 2, 3, 0]
    return np.stack([corners, corners[after], inner[after], inner], 1)


def _hit(hole: Polygon, middle: Floats, towards: Floats) -> Floats:
    """Where the way from the middle of a hole to a point leaves the hole."""
    crossing = LineString([middle, towards]).intersection(hole.exterior)
    points = shapely.get_coordinates(crossing)
    if not len(points):
        raise InputError(
            f"part: the hole at {at(middle)} is bent around its middle; no blocks are found by "
            f"themselves; {ELSE}"
        )
    hit = points[np.hypot(*(points - middle).T).argmax()]
    # At a corner of the hole nearby, where there is one.
    vertices = np.asarray(hole.exterior.coords)[:-1]
    if len(vertices) <= 8:
        return vertices[np.hypot(*(vertices - hit).T).argmin()]
    return hit


def _inside(region: Polygon) -> Blocks:
    """Blocks of an outline without holes."""
    ring = region.exterior if region.exterior.is_ccw else region.exterior.reverse()
    vertices = np.asarray(ring.coords)[:-1]
    convex = region.convex_hull.area < region.area * (1 + MEET)
    if convex and len(vertices) in (3, 5, 6):
        middle = shapely.get_coordinates(region.centroid)[0]
        sides = (vertices + np.roll(vertices, -1, axis=0)) / 2
        before = np.roll(sides, 1, axis=0)
        around = np.broadcast_to(middle, sides.shape)
        return _made(region, np.stack([vertices, sides, around, before], 1))
    corners = _corners(region)
    if len(vertices) == 4 and convex:
        return _made(region, corners[None])
    parallel = _parallel(region)
    at = [parallel.project(Point(corner)) for corner in corners]
    inner = shapely.get_coordinates(shapely.line_interpolate_point(parallel, at))
    after = [1, 2, 3, 0]
    around = np.stack([corners, corners[after], inner[after], inner], 1)
    quads = np.concatenate([inner[None], around])
    sides = [_between(parallel, begin, end) for begin, end in zip(at, np.roll(at, -1), strict=True)]
    fault = None
    for bulge in BULGE:
        # Where the outline bends much the straight line between two corners leaves it.
        share = np.linspace(0, 1, len(sides[0]))[:, None]
        curves = [
            polyline(bulge * side + (1 - bulge) * (side[0] + share * (side[-1] - side[0])))
            for side in sides
        ]
        try:
            return _made(region, quads, curves)
        except InputError as other:
            fault = fault or other
    assert fault is not None
    raise fault


def _parallel(region: Polygon) -> LinearRing:
    """An inner parallel of an outline, counter-clockwise."""
    depth = DEEP * shapely.maximum_inscribed_circle(region).length
    while True:
        inner: Any = region.buffer(-depth)
        if isinstance(inner, Polygon):
            return inner.exterior if inner.exterior.is_ccw else inner.exterior.reverse()
        depth /= 2


def _between(ring: LinearRing, begin: float, end: float) -> Floats:
    """Points of a ring, evenly, from one way along it onwards to another."""
    way = np.linspace(begin, end if end > begin else end + ring.length, _POINTS) % ring.length
    return shapely.get_coordinates(shapely.line_interpolate_point(ring, way))


_POINTS = 33
