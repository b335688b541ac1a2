"""The tree of a space-filling curve's squares, and the closed road round it.

The tree goes on from each square to the nearest along the curve. Where four small squares lie
beside a large one, one of the two at its side may be joined to it, by half of that side.
"""

from bisect import bisect
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.plan.room import Walls
from fdjax.road.stroke import Curve

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_CORNERS = (0, 0), (1, 0), (1, 1), (0, 1)
"""Of a square, counter-clockwise; side k goes from corner k to the next."""

_BEYOND = (0, -1), (1, 0), (0, 1), (-1, 0)
"""Where the square beyond each side is."""


class Steps(NamedTuple):
    """Whether the step from each node to the next along either axis keeps to the free region."""

    along: Bools
    across: Bools

    @classmethod
    def of(cls, xy: Floats, walls: Walls) -> "Steps":
        return cls(_free(walls, xy[:-1], xy[1:]), _free(walls, xy[:, :-1], xy[:, 1:]))

    @property
    def whole(self) -> Bools:
        """Squares all of whose sides are free."""
        along, across = self
        return along[::2, ::2] & along[::2, 1::2] & across[::2, ::2] & across[1::2, ::2]


def _free(walls: Walls, a: Floats, b: Floats) -> Bools:
    """Whether centre lines from a to b, each (..., 2), mm, keep to the free region."""
    whole = np.isfinite(a).all(-1) & np.isfinite(b).all(-1)
    ends = np.stack([a, b], -2)
    ends[~whole] = [[0.0, 0.0], [1.0, 0.0]]
    return whole & np.asarray(shapely.covers(walls.free, shapely.linestrings(ends)))


class Nodes(NamedTuple):
    """Nodes of all depths, numbered row by row and depth by depth; behind them others.

    - `xy` (nodes, 2), mm, and `width` (nodes,), mm; `first`: number of each depth's first node, and
      of the first of the others; `shapes`: of their lattices.
    """

    xy: Floats
    width: Floats
    first: list[int]
    shapes: list[tuple[int, int]]

    @classmethod
    def of(cls, curve: Curve) -> "Nodes":
        levels = curve.levels
        shapes = [(level.xy.shape[0], level.xy.shape[1]) for level in levels]
        return cls(
            np.concatenate([level.xy.reshape(-1, 2) for level in levels]),
            np.concatenate([level.width.ravel() for level in levels]),
            [0, *np.cumsum([n * m for n, m in shapes]).tolist()],
            shapes,
        )

    def number(self, level: int, i: int, j: int) -> int:
        return self.first[level] + i * self.shapes[level][1] + j

    def place(self, node: int) -> tuple[int, int, int]:
        """Depth, row and column of a node; the depth of the others is the number of depths."""
        level = bisect(self.first, node) - 1
        columns = self.shapes[level][1] if level < len(self.shapes) else 1
        return level, *divmod(node - self.first[level], columns)

    def beside(self, u: int, v: int) -> tuple[int, int] | None:
        """The nodes to the right of a step from u to v, where there are any in their lattice."""
        (level, i, j), (other, k, n) = self.place(u), self.place(v)
        across, along = n - j, i - k
        if level != other or level == len(self.shapes) or abs(across) + abs(along) != 1:
            return None
        rows, columns = self.shapes[level]
        if not (0 <= i + across < rows and 0 <= j + along < columns):
            return None
        aside = across * columns + along
        return u + aside, v + aside

    def more(self, ends: list[tuple[int, int]]) -> "Nodes":
        """With others behind them, half way between pairs of nodes."""
        pairs = np.array(ends, int).reshape(-1, 2)
        return self._replace(
            xy=np.concatenate([self.xy, self.xy[pairs].mean(1)]),
            width=np.concatenate([self.width, self.width[pairs].mean(1)]),
        )


class Join(NamedTuple):
    """Two squares that may be joined, (depth, row, column): over a `side` of the first, whose
    `half` is None for a second as large, and 0 or 1 for one that lies at its first or second half.
    """

    gap: float
    one: tuple[int, int, int]
    other: tuple[int, int, int]
    side: int
    half: int | None


def following(curve: Curve, steps: list[Steps], walls: Walls) -> tuple[Nodes, dict[int, int]]:
    """The nodes, and which comes after each along the closed roads round the tree and back."""
    nodes = Nodes.of(curve)
    whole = [each.whole for each in steps]
    after: dict[int, int] = {}
    for level, squares in enumerate(whole):
        for i, j in np.argwhere(squares).tolist():
            ring = _ring(nodes, (level, i, j))
            after.update(zip(ring, (*ring[1:], ring[0]), strict=True))
    joins = []
    for level, some in enumerate(curve.levels):
        joins += _alike(level, some.rank, steps[level])
        if some.finer is not None:
            joins += _unlike(level, some, whole[level], whole[level + 1], nodes, walls)
    ends: list[tuple[int, int]] = []
    for join in _tree(joins):
        one, other = _ring(nodes, join.one), _ring(nodes, join.other)
        u, v = one[join.side], one[(join.side + 1) % 4]
        p, q = other[(join.side + 2) % 4], other[(join.side + 3) % 4]
        # Two rings become one where a side of each gives way to two steps between them.
        if join.half is None:
            after[u], after[p] = q, v
            continue
        middle = nodes.first[-1] + len(ends)
        ends.append((u, v))
        if join.half == 0:
            after[u], after[p], after[middle] = q, middle, v
        else:
            after[u], after[middle], after[p] = middle, q, v
    return nodes.more(ends), after


def _ring(nodes: Nodes, square: tuple[int, int, int]) -> list[int]:
    """The nodes of a square, counter-clockwise."""
    level, i, j = square
    return [nodes.number(level, 2 * i + di, 2 * j + dj) for di, dj in _CORNERS]


def _alike(level: int, rank: NDArray[np.intp], steps: Steps) -> Iterator[Join]:
    """Neighbours of one depth that may be joined."""
    whole, along, across = steps.whole, *steps
    right = whole[:-1] & whole[1:] & along[1::2, ::2] & along[1::2, 1::2]
    up = whole[:, :-1] & whole[:, 1:] & across[::2, 1::2] & across[1::2, 1::2]
    for axis, allowed in enumerate((right, up)):
        gaps = np.abs(np.diff(rank, axis=axis)) / 4.0**level
        for i, j in np.argwhere(allowed).tolist():
            next_one = (level, i + 1, j) if axis == 0 else (level, i, j + 1)
            yield Join(float(gaps[i, j]), (level, i, j), next_one, 1 + axis, None)


def _unlike(
    level: int, curve: Curve, large: Bools, small: Bools, nodes: Nodes, walls: Walls
) -> list[Join]:
    """Squares beside others of twice their size that may be joined to them."""
    assert curve.finer is not None
    found, ways = [], []
    rows, columns = small.shape
    for i, j in np.argwhere(large).tolist():
        for side, (across, along) in enumerate(_BEYOND):
            for half in (0, 1):
                # Along the side, as it goes round the square.
                first = half if side < 2 else 1 - half
                k = 2 * i + (2 if across > 0 else -1 if across < 0 else first)
                m = 2 * j + (2 if along > 0 else -1 if along < 0 else first)
                if not (0 <= k < rows and 0 <= m < columns and small[k, m]):
                    continue
                gap = abs(curve.rank[i, j] + 0.5 - (curve.finer.rank[k, m] + 0.5) / 4) / 4.0**level
                join = Join(float(gap), (level, i, j), (level + 1, k, m), side, half)
                one, other = _ring(nodes, join.one), _ring(nodes, join.other)
                u, v = nodes.xy[[one[side], one[(side + 1) % 4]]]
                p, q = nodes.xy[[other[(side + 2) % 4], other[(side + 3) % 4]]]
                middle = (u + v) / 2
                ways.append([[u, q], [p, middle]] if half == 0 else [[middle, q], [p, v]])
                found.append(join)
    if not found:
        return []
    ends = np.array(ways)
    free = np.flatnonzero(_free(walls, ends[:, :, 0], ends[:, :, 1]).all(1))
    return [found[k] for k in free]


def _tree(joins: list[Join]) -> Iterator[Join]:
    """Neighbours to be joined: a least tree of the steps along the curve (Kruskal 1956)."""
    group: dict[tuple[int, int, int], tuple[int, int, int]] = {}
    taken: set[tuple[tuple[int, int, int], int]] = set()

    def root(square: tuple[int, int, int]) -> tuple[int, int, int]:
        while (above := group.get(square, square)) != square:
            group[square] = group.get(above, above)
            square = group[square]
        return square

    for join in sorted(joins, key=lambda each: (each.gap, each.side, each.one, each.half or 0)):
        # Only one of two small squares fits half a side.
        if join.half is not None and (join.one, join.side) in taken:
            continue
        one, other = root(join.one), root(join.other)
        if one != other:
            group[one] = other
            taken.add((join.one, join.side))
            yield join
