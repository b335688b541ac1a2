"""A space-filling curve as one closed road, fitted to any region.

The road runs round a tree of the lattice's squares of four nodes, out on its one side and back on
the other: whatever squares a wall takes away, what is left together stays one road that crosses
itself nowhere, see `plan.tour_tree`.
"""

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon

from fdjax.errors import InputError
from fdjax.part.region import Region
from fdjax.plan.laid import Laid, shortest_road
from fdjax.plan.room import Room, Walls
from fdjax.plan.simplify import simplify_roads
from fdjax.plan.toolpath import Road
from fdjax.plan.tour_tree import Nodes, Steps, following
from fdjax.road.stroke import Curve

Floats = NDArray[np.float64]

_HALVES = 10
"""How often the depth of a bay is halved: to a thousandth of a step."""

_SHALLOW = 0.05
"""Bays of less than this share of a step are not worth two corners."""


def lay_curve(
    curve: Curve,
    room: Room | Region | Polygon | MultiPolygon,
    *,
    least_road: float = 0.0,
    tolerance: float = 0.0,
    start: ArrayLike | None = None,
    **_: object,
) -> Laid:
    """Lay a curve as one closed road in each piece of the room that its squares hold together.

    Squares whose centre lines would come nearer to a wall than half the largest road width are
    left out. Along the walls every second step then bulges into what room is left.

    - `least_road`: shorter roads are not laid, mm; nor any of less than `SHORTEST_ROAD` widths.
    - `tolerance`: points within this of a straight road are dropped, mm.
    - `start`: where the head comes from; the roads start near it.

    What else other strokes are laid by has no say. Raises `InputError` for a curve whose arrays do
    not fit, or no room for a road.

    >>> from shapely import box
    >>> x = np.arange(4.0)
    >>> xy = np.stack(np.meshgrid(x, x, indexing="ij"), -1) + 0.5
    >>> rank = np.array([[0, 1], [3, 2]])
    >>> (road,) = lay_curve(Curve(xy, rank, np.full((4, 4), 0.4), "curve"), box(0, 0, 4, 4)).roads
    >>> road.closed, road.length > 15
    (True, True)
    """
    for level in curve.levels:
        _check(level)
    walls = Room.of(room).walls(max(float(level.width.max()) for level in curve.levels))
    shortest = shortest_road(curve.width, least_road + tolerance)
    steps = [Steps.of(level.xy, walls) for level in curve.levels]
    nodes, after = following(curve, steps, walls)
    _fill(after, nodes, steps)
    bays = _bays(after, nodes, walls)
    roads = [_road(curve, nodes, bays, loop) for loop in _loops(after)]
    roads = simplify_roads(roads, tolerance=tolerance / 2)
    return Laid.of(roads, shortest, start=start)


def _check(curve: Curve) -> None:
    n, m = curve.rank.shape
    if curve.xy.shape != (2 * n, 2 * m, 2) or curve.width.shape != (2 * n, 2 * m):
        raise InputError(
            f"curve: {n} x {m} squares need nodes and widths of shape ({2 * n}, {2 * m})"
        )
    if curve.finer is not None and curve.finer.rank.shape != (2 * n, 2 * m):
        raise InputError(f"curve: what is finer than {n} x {m} squares has {2 * n} x {2 * m}")
    if not (np.isfinite(curve.width) & (curve.width > 0)).all():
        raise InputError("curve: its widths must be positive")


def _loops(after: dict[int, int]) -> Iterator[list[int]]:
    """The closed roads, as nodes in order."""
    left = dict.fromkeys(after)
    while left:
        first = next(iter(left))
        loop = [first]
        del left[first]
        while (node := after[loop[-1]]) != first:
            loop.append(node)
            del left[node]
        yield loop


def _fill(after: dict[int, int], nodes: Nodes, steps: list[Steps]) -> None:
    """Let the road take in pairs of nodes beside it that are free, until none is left."""

    def free(a: int, b: int) -> bool:
        a, b = min(a, b), max(a, b)
        level, i, j = nodes.place(a)
        axis = steps[level].across if b == a + 1 else steps[level].along
        return bool(axis[i, j])

    waiting = list(after)
    while waiting:
        u = waiting.pop()
        v = after[u]
        pair = nodes.beside(u, v)
        if pair is None or pair[0] in after or pair[1] in after:
            continue
        c, d = pair
        if free(u, c) and free(c, d) and free(d, v):
            after[u], after[c], after[d] = c, d, v
            waiting += [u, c, d]


def _bays(after: dict[int, int], nodes: Nodes, walls: Walls) -> dict[int, Floats]:
    """The two points of a bulge between a node and the next, as deep as the wall lets it be."""
    flat = nodes.xy
    taken = set(after)
    steps = []
    for u, v in after.items():
        pair = nodes.beside(u, v)
        if pair is None or not taken.isdisjoint(pair) or not np.isfinite(flat[list(pair)]).all():
            continue
        taken.update(pair)
        steps.append((u, v, *pair))
    if not steps:
        return {}
    u, v, c, d = (flat[list(nodes)] for nodes in zip(*steps, strict=True))
    low, high = np.zeros(len(steps)), np.ones(len(steps))
    for _ in range(_HALVES):
        share = (low + high) / 2
        way = np.stack([u, u + share[:, None] * (c - u), v + share[:, None] * (d - v), v], 1)
        inside = np.asarray(shapely.covers(walls.free, shapely.linestrings(way)))
        low, high = np.where(inside, share, low), np.where(inside, high, share)
    ends = np.stack([u + low[:, None] * (c - u), v + low[:, None] * (d - v)], 1)
    deep = low > _SHALLOW
    return {step[0]: end for step, end, keep in zip(steps, ends, deep, strict=True) if keep}


def _road(curve: Curve, nodes: Nodes, bays: dict[int, Floats], loop: list[int]) -> Road:
    """The road through a loop of nodes, and the bays between them."""
    xy, width = nodes.xy, nodes.width
    none = np.zeros((0, 2))
    points = np.concatenate([
        part for node in loop for part in (xy[node : node + 1], bays.get(node, none))
    ])  # fmt: skip
    steps = np.array([3 if node in bays else 1 for node in loop])
    wide = (width[loop] + np.roll(width[loop], -1)) / 2
    return Road(
        points,
        np.repeat(wide, steps),
        material=curve.material,
        family=curve.family,
        closed=True,
    )
