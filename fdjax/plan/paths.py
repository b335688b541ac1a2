"""Paths that a pattern has joined itself, as roads: in order, and none too short."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fdjax.plan.laid import Laid, shortest_road
from fdjax.plan.simplify import simplify_roads
from fdjax.plan.toolpath import Road
from fdjax.road.stroke import Paths


def lay_paths(
    paths: Paths,
    room: Any,
    *,
    least_road: float = 0.0,
    tolerance: float = 0.0,
    start: ArrayLike | None = None,
    **_: object,
) -> Laid:
    """Lay paths as they are, which is why the room has no say: closed ones first.

    - `least_road`: shorter roads are not laid, mm; nor any of less than `SHORTEST_ROAD` widths.
    - `tolerance`: points within this of a straight road are dropped, mm.
    - `start`: where the head comes from; the roads start near it.
    """
    roads: list[Road] = []
    out: list[Road] = []
    for closed, some in ((True, paths.closed), (False, paths.open)):
        made = [
            Road(
                xy,
                np.full(len(xy) - (not closed), paths.width),
                material=paths.material,
                closed=closed,
                family=paths.family,
            )
            for xy in some
        ]
        made = simplify_roads(made, tolerance=tolerance / 2)
        shortest = [shortest_road(road.width, least_road + tolerance) for road in made]
        laid = Laid.of(made, shortest, start=roads[-1].path[-1] if roads else start)
        roads += laid.roads
        out += laid.left_out
    return Laid(tuple(roads), tuple(out))
