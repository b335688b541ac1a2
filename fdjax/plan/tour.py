"""A space-filling curve as one closed road, fitted to any region.

The road runs round a tree of the lattice's squares of four nodes, out on its one side and back on
the other: whatever squares a wall takes away, what is left together stays one road that crosses
itself nowhere. The tree goes on from each square to the nearest along the curve.
"""

from collections.abc import Iterator
from typing import NamedTuple

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
from fdjax.road.stroke import Curve

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]

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
    _check(curve)
    walls = Room.of(room).walls(float(curve.width.max()))
    shortest = shortest_road(curve.width, least_road + tolerance)
    steps = _Steps.of(curve.xy, walls)
    after = _following(curve, steps)
    _fill(after, steps)
    bays = _bays(after, curve.xy, walls)
    roads = [_road(curve, bays, loop) for loop in _loops(after)]
    roads = simplify_roads(roads, tolerance=tolerance / 2)
    return Laid.of(roads, shortest, start=start)


def _check(curve: Curve) -> None:
    n, m = curve.rank.shape
    if curve.xy.shape != (2 * n, 2 * m, 2) or curve.width.shape != (2 * n, 2 * m):
        raise InputError(
            f"curve: {n} x {m} squares need nodes and widths of shape ({2 * n}, {2 * m})"
        )
    if not (np.isfinite(curve.width) & (curve.width > 0)).all():
        raise InputError("curve: its widths must be positive")


def _free(walls: Walls, a: Floats, b: Floats) -> Bools:
    """Whether centre lines from a to b, each (..., 2), mm, keep to the free region."""
    whole = np.isfinite(a).all(-1) & np.isfinite(b).all(-1)
    ends = np.stack([a, b], -2)
    ends[~whole] = [[0.0, 0.0], [1.0, 0.0]]
    return whole & np.asarray(shapely.covers(walls.free, shapely.linestrings(ends)))


class _Steps(NamedTuple):
    """Whether the step from each node to the next along either axis keeps to the free region."""

    along: Bools
    across: Bools

    @classmethod
    def of(cls, xy: Floats, walls: Walls) -> "_Steps":
        return cls(_free(walls, xy[:-1], xy[1:]), _free(walls, xy[:, :-1], xy[:, 1:]))


def _following(curve: Curve, steps: _Steps) -> dict[int, int]:
    """The node that comes after each along the closed roads round the tree, and back; numbered
    row by row.
    """
    along, across = steps
    whole = along[::2, ::2] & along[::2, 1::2] & across[::2, ::2] & across[1::2, ::2]
    right = whole[:-1] & whole[1:] & along[1::2, ::2] & along[1::2, 1::2]
    up = whole[:, :-1] & whole[:, 1:] & across[::2, 1::2] & across[1::2, 1::2]
    columns = curve.xy.shape[1]
    after: dict[int, int] = {}
    for i, j in np.argwhere(whole).tolist():
        a = 2 * i * columns + 2 * j
        # Counter-clockwise round the square.
        ring = (a, a + columns, a + columns + 1, a + 1)
        after.update(zip(ring, (*ring[1:], ring[0]), strict=True))
    for (i, j), axis in _tree(curve.rank, right, up):
        a = 2 * i * columns + 2 * j
        one = (a + columns, a + columns + 1) if axis == 0 else (a + columns + 1, a + 1)
        step = columns if axis == 0 else 1
        # Two rings become one where a side of each gives way to two steps between them.
        after[one[0]], after[one[1] + step] = one[0] + step, one[1]
    return after


def _tree(rank: Ints, right: Bools, up: Bools) -> Iterator[tuple[tuple[int, int], int]]:
    """Neighbours to be joined: a least tree of the steps along the curve (Kruskal 1956)."""
    gaps = [np.abs(np.diff(rank, axis=axis)) for axis in (0, 1)]
    pairs = [(gaps[axis][i, j], axis, i, j)
             for axis, allowed in enumerate((right, up))
             for i, j in np.argwhere(allowed).tolist()]  # fmt: skip
    group = np.arange(rank.size).tolist()

    def root(square: int) -> int:
        while group[square] != square:
            group[square] = group[group[square]]
            square = group[square]
        return square

    columns = rank.shape[1]
    for _, axis, i, j in sorted(pairs):
        a = i * columns + j
        one, other = root(a), root(a + (columns if axis == 0 else 1))
        if one != other:
            group[one] = other
            yield (i, j), axis


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


def _beside(u: int, v: int, shape: tuple[int, int]) -> tuple[int, int] | None:
    """The nodes to the right of a step from u to v, where the lattice has them."""
    columns = shape[1]
    (i, j), (k, n) = divmod(u, columns), divmod(v, columns)
    across, along = n - j, i - k
    if not (0 <= i + across < shape[0] and 0 <= j + along < columns):
        return None
    aside = across * columns + along
    return u + aside, v + aside


def _fill(after: dict[int, int], steps: _Steps) -> None:
    """Let the road take in pairs of nodes beside it that are free, until none is left."""
    shape = steps.along.shape[0] + 1, steps.along.shape[1]

    def free(a: int, b: int) -> bool:
        a, b = min(a, b), max(a, b)
        axis = steps.across if b == a + 1 else steps.along
        return bool(axis[divmod(a, shape[1])])

    waiting = list(after)
    while waiting:
        u = waiting.pop()
        v = after[u]
        pair = _beside(u, v, shape)
        if pair is None or pair[0] in after or pair[1] in after:
            continue
        c, d = pair
        if free(u, c) and free(c, d) and free(d, v):
            after[u], after[c], after[d] = c, d, v
            waiting += [u, c, d]


def _bays(after: dict[int, int], xy: Floats, walls: Walls) -> dict[int, Floats]:
    """The two points of a bulge between a node and the next, as deep as the wall lets it be."""
    shape, flat = xy.shape[:2], xy.reshape(-1, 2)
    taken = set(after)
    steps = []
    for u, v in after.items():
        pair = _beside(u, v, shape)
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


def _road(curve: Curve, bays: dict[int, Floats], loop: list[int]) -> Road:
    """The road through a loop of nodes, and the bays between them."""
    xy, width = curve.xy.reshape(-1, 2), curve.width.ravel()
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
