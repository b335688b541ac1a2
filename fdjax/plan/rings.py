"""Closed roads along the walls of a layer."""

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely import MultiPolygon, Polygon

from fdjax.part.region import Region
from fdjax.plan.laid import Laid, shortest_road
from fdjax.plan.room import Room
from fdjax.plan.toolpath import Road
from fdjax.plan.wall import rings
from fdjax.road.stroke import Rings

_APART = 2e-3
"""A road keeps so much more than its width from its own other side, mm, for what rounding takes."""

_SPIKE = 5.0
"""Corners reach no further than so many half widths."""


def lay_rings(
    stroke: Rings,
    room: Room | Region | Polygon | MultiPolygon,
    *,
    least_road: float = 0.0,
    tolerance: float = 0.0,
    start: ArrayLike | None = None,
    **_: object,
) -> Laid:
    """Lay a closed road along each wall of a room, half its width inside.

    Where a neck is too narrow for two of them none goes through it.

    - `least_road`: shorter roads are not laid, mm; nor any of less than `SHORTEST_ROAD` widths.
    - `tolerance`: points within this of a straight road are dropped, mm.
    - `start`: where the head comes from; the roads start near it.

    >>> (road,) = lay_rings(Rings(0.4, "wall"), shapely.box(0, 0, 4, 3)).roads
    >>> road.closed, round(road.length, 6)
    (True, 12.4)
    """
    width = stroke.width
    free = Room.of(room).walls(width).free
    deep = shapely.buffer(free, -(width + _APART) / 2, join_style="mitre", mitre_limit=_SPIKE)
    opened = shapely.buffer(deep, (width + _APART) / 2, join_style="mitre", mitre_limit=_SPIKE)
    inner = shapely.intersection(opened, free)
    parts = [part for part in shapely.get_parts(inner).tolist() if isinstance(part, Polygon)]
    if not parts:
        return Laid()
    roads = []
    for ring in rings(MultiPolygon(parts)):
        xy = shapely.get_coordinates(shapely.simplify(ring, tolerance / 2))[:-1]
        if len(xy) > 2:
            roads.append(Road(xy, np.full(len(xy), width), stroke.material, True, stroke.family))
    shortest = [shortest_road(road.width, least_road + tolerance) for road in roads]
    return Laid.of(roads, shortest, start=start)
