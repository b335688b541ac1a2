"""Where a region is thinner than a road, and how wide it is there."""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon, STRtree

MITRE = 1.5
"""Corners of an inset reach no further than this many margins: up to 84 degrees they stay sharp."""

_GROWTH = 1.5
"""Of the steps of an inset: quickest of 1.5 and 2 on outlines of 100,000 noisy points."""

_ROUND = 16
"""Segments of a quarter circle; a disc of them is smaller by 0.12 %."""
_SLACK = 0.01
"""Share of a radius that makes up for that, and below which a width is none."""

_TOUCHING = 1e-9
"""Rounding of places, mm."""


class Neck(NamedTuple):
    """A place, mm, where the region is too thin, its width there, and how deep it is, mm: how far
    an arm goes on from there; infinite for a passage, and for a polygon that is all too thin.
    """

    x: float
    y: float
    width: float
    depth: float = np.inf


def inset(region: Polygon | MultiPolygon, margin: float, *, mitre: float = MITRE) -> list[Polygon]:
    """The polygons of what is at least `margin` mm inside; none where nothing is.

    Where edges are much shorter than the margin, its offsets cross each other many times; going
    in by steps that grow, from a part of an edge's length, ends at the same place much sooner.

    - `mitre`: corners reach no further than this many margins.
    """
    room, left = region, margin
    step = region.length / shapely.get_num_coordinates(region) / 4
    while left > 0 and not room.is_empty:
        now = left if left < _GROWTH * step else step
        room = shapely.buffer(room, -now, join_style="mitre", mitre_limit=mitre)
        left, step = left - now, _GROWTH * step
    return [part for part in shapely.get_parts(room) if part.area > 0]


def widest(region: Polygon | MultiPolygon) -> Neck:
    """The middle of the largest disc inside, and that disc's diameter, to 1e-3 of it or better."""
    x0, y0, x1, y1 = region.bounds
    # The mean width of a strip of this area and boundary is a fair size of the disc.
    scale = min(2 * region.area / region.length, x1 - x0, y1 - y0)
    radius = shapely.maximum_inscribed_circle(region, tolerance=5e-4 * scale)
    x, y = shapely.get_coordinates(radius)[0].tolist()
    return Neck(x, y, 2 * radius.length)


def necks(polygon: Polygon, width: float) -> Iterator[Neck]:
    """Where one polygon is too thin for roads of this width, see `fdjax.part.region.Region.necks`.

    What roads cannot reach is the polygon less the discs of a road's width that fit in. Its
    pieces lie between two walls (a passage), or along one (a corner, or an arm where it is deep).
    """
    reach = width / 2
    parts = inset(polygon, reach)
    if not parts:
        yield widest(polygon)
        return
    reached = [part.buffer(reach * (1 + _SLACK), quad_segs=_ROUND) for part in parts]
    yield from _pinches(polygon, reached, reach)
    opened = shapely.union_all(reached)
    lost = shapely.get_parts(shapely.difference(polygon, opened))
    lost = lost[shapely.length(lost) > 4 * _SLACK * reach]
    walls = shapely.get_parts(shapely.line_merge(shapely.difference(polygon.boundary, opened)))
    middles = shapely.line_interpolate_point(walls, 0.5, normalized=True)
    wall, own = STRtree(lost).query(middles, predicate="dwithin", distance=_TOUCHING)
    between = np.bincount(own, minlength=len(lost)) > 1
    places, piece = shapely.get_coordinates(lost, return_index=True)
    points = np.asarray(shapely.points(places))
    shapely.prepare(opened)
    deep = ~shapely.dwithin(opened, points, width)
    for number in np.unique([*np.flatnonzero(between), *piece[deep]]):
        if between[number]:
            yield _narrowest(walls[wall[own == number]])
        else:
            depth = shapely.distance(opened, points[deep & (piece == number)]).max()
            yield widest(lost.item(number))._replace(depth=float(depth))


def _pinches(polygon: Polygon, reached: list[Polygon], reach: float) -> Iterator[Neck]:
    """Passages so short that what is reached from both sides meets in them."""
    pairs = STRtree(reached).query(reached, predicate="intersects").T if len(reached) > 1 else ()
    for a, b in pairs:
        if a < b:
            meeting = reached[a].intersection(reached[b]).intersection(polygon)
            for place in shapely.get_parts(meeting):
                middle = place.centroid
                clear = polygon.boundary.distance(middle)
                if clear > _SLACK * reach and polygon.contains(middle):
                    yield Neck(middle.x, middle.y, 2 * clear)


def _narrowest(sides: np.ndarray) -> Neck:
    """The middle of the shortest way between two of these lines."""
    ways = [shapely.shortest_line(a, b) for a, b in combinations(sides, 2)]
    way = min(ways, key=shapely.length)
    x, y = shapely.get_coordinates(way).mean(0).tolist()
    return Neck(x, y, way.length)
