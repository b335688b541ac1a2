"""A region as several four-sided blocks with shared sides, and the bands of lines through them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import LinearRing, LineString, Polygon

from fdjax.errors import InputError
from fdjax.part.curve import Curve, Floats, polyline
from fdjax.part.ring import at

ENDS = (0, 1), (1, 2), (3, 2), (0, 3)
"""The corners from which and to which bottom, right, top and left of a block run."""

MEET = 1e-4
"""Corners nearer to each other, or to a wall, than this share of the region's size are on it."""

UNCOVERED = 1e-4
"""Share of the region's area that blocks may leave out, or lie in twice."""

MOST = 64
"""Blocks of a region."""

FINE = 1e-3
"""What curved sides may lose when their points are thinned, mm."""


class Stretch(NamedTuple):
    """A block that a band runs through.

    - `block`; `axis`: 0 where the band's lines are those of constant xi there, 1 of eta.
    - `turned`: whether lines are counted against that coordinate; `back`: run against the other.
    """

    block: int
    axis: int
    turned: bool
    back: bool


class Band(NamedTuple):
    """Lines side by side that run on from block to block; `closed`: and into the first again.

    `family`: 0 or 1; where two bands cross they are of different families.
    """

    stretches: tuple[Stretch, ...]
    closed: bool
    family: int


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks that cover a region, each with four corners, and whose sides are shared whole.

    - `region`: the polygon that they cover.
    - `nodes`: all corners, shape (n, 2), mm.
    - `blocks`: of each the numbers of its corners, counter-clockwise, shape (m, 4); xi runs from
      the first to the second, eta from the second to the third.
    - `sides`: the curve between two nodes, from the lower number to the higher.
    - `cuts`: shared sides, each as its two nodes, at which lines are to end.
    """

    region: Polygon
    nodes: Floats
    blocks: NDArray[np.intp]
    sides: dict[tuple[int, int], Curve]
    cuts: frozenset[tuple[int, int]] = frozenset()

    @classmethod
    def of(cls, region: Polygon, blocks: ArrayLike, curves: Iterable[Curve] = ()) -> "Blocks":
        """From the corners of each block, shape (m, 4, 2), mm, either way round.

        Sides between corners that follow each other on an outline or a hole run along it; others
        are straight, or one of the `curves`, if one has the same ends. Raises `InputError`, with
        the place, for blocks that overlap, leave something out or do not share sides whole.
        """
        corners = np.asarray(blocks, float)
        if len(corners) > MOST:
            raise InputError(f"blocks: {len(corners)}; at most {MOST}")
        x0, y0, x1, y1 = region.bounds
        near = MEET * max(x1 - x0, y1 - y0)
        nodes, index = _merged(corners.reshape(-1, 2), near)
        index = index.reshape(-1, 4)
        for k, four in enumerate(index):
            if len(set(four.tolist())) < 4:
                raise InputError(f"blocks: block {k + 1} has two corners at one place")
            if not LinearRing(nodes[four]).is_ccw:
                index[k] = four[::-1]
        sides: dict[tuple[int, int], Curve] = {}
        for ring in (region.exterior, *region.interiors):
            sides |= _along(ring if ring.is_ccw else ring.reverse(), nodes, near)
        for curve in curves:
            distance = [np.hypot(*(nodes - end).T) for end in (curve.start, curve.end)]
            first, last = (int(each.argmin()) for each in distance)
            if max(each.min() for each in distance) > near or first == last:
                raise InputError(
                    f"curves: one from {at(curve.start)} to {at(curve.end)} joins no two corners"
                )
            key = (min(first, last), max(first, last))
            sides[key] = curve if first < last else curve.reversed()
        used: dict[tuple[int, int], Curve] = {}
        for four in index.tolist():
            for a, b in ENDS:
                key = min(four[a], four[b]), max(four[a], four[b])
                used[key] = sides.get(key) or polyline(nodes[list(key)])
        found = cls(region, nodes, index, used)
        found._check()
        return found

    def _check(self) -> None:
        outlines = [Polygon(self.outline(k)) for k in range(len(self.blocks))]
        for k, outline in enumerate(outlines):
            x, y = self.nodes[self.blocks[k]].mean(0)
            if not outline.is_valid:
                raise InputError(f"blocks: the sides of the block at ({x:.4g}, {y:.4g}) cross")
        slack = UNCOVERED * self.region.area
        for k, one in enumerate(outlines):
            for other in outlines[:k]:
                both = one.intersection(other)
                if both.area > slack:
                    raise InputError(f"blocks: two overlap at {_inside(both)}")
        left = self.region.difference(shapely.union_all(outlines))
        if left.area > slack:
            raise InputError(f"blocks: none covers the part at {_inside(left)}")
        over = shapely.union_all(outlines).difference(self.region)
        if over.area > slack:
            raise InputError(f"blocks: one reaches beyond the part at {_inside(over)}")
        walls = [self.region.exterior, *self.region.interiors]
        for key, users in self.users.items():
            if len(users) == 1:
                xy = self.sides[key].polyline()
                off = shapely.distance(shapely.points(xy.mean(0)), walls).min()
                far = shapely.distance(shapely.points(xy[len(xy) // 2]), walls).min()
                if min(off, far) > 0.01 * self.sides[key].length:
                    raise InputError(
                        f"blocks: the side from {at(xy[0])} to {at(xy[-1])} belongs to one block "
                        "only; blocks share whole sides, from corner to corner"
                    )

    def keys(self, block: int) -> list[tuple[int, int]]:
        """Which of the `sides` bottom, right, top and left of a block are."""
        four = self.blocks[block].tolist()
        return [(min(four[p], four[q]), max(four[p], four[q])) for p, q in ENDS]

    def side(self, block: int, k: int) -> Curve:
        """Bottom, right, top or left of a block, along rising xi or eta."""
        first, last = (int(self.blocks[block][end]) for end in ENDS[k])
        curve = self.sides[min(first, last), max(first, last)]
        return curve if first < last else curve.reversed()

    def outline(self, block: int) -> Floats:
        """Its points, counter-clockwise, (n, 2), mm."""
        bottom, right, top, left = (self.side(block, k) for k in range(4))
        ring = (bottom, right, top.reversed(), left.reversed())
        return np.concatenate([curve.polyline()[:-1] for curve in ring])

    @cached_property
    def users(self) -> dict[tuple[int, int], list[tuple[int, int]]]:
        """The blocks, and which side of theirs, that each side belongs to."""
        found: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for b in range(len(self.blocks)):
            for k, key in enumerate(self.keys(b)):
                found.setdefault(key, []).append((b, k))
        return found

    @cached_property
    def lengths(self) -> Floats:
        """How long lines of constant xi and of constant eta are, in the mean of the two sides that
        they run along, (m, 2), mm."""
        side = np.array([
            [self.sides[key].length for key in self.keys(block)]
            for block in range(len(self.blocks))
        ])  # fmt: skip
        return np.stack([side[:, 1::2].mean(1), side[:, ::2].mean(1)], 1)

    @cached_property
    def extents(self) -> Floats:
        """How long and how wide each block is as a rectangle, (m, 2), mm.

        Sides that face each other, from block to block, are alike then: each is as long as they
        are in the mean.
        """
        key = {user: k for k, users in enumerate(self.users.values()) for user in users}
        facing = [(key[b, k], key[b, k + 2]) for b in range(len(self.blocks)) for k in (0, 1)]
        i, j = np.array(facing).T
        count = len(self.users)
        _, group = connected_components(coo_array((np.ones(len(i)), (i, j)), (count, count)))
        length = np.array([self.sides[each].length for each in self.users])
        mean = np.bincount(group, length) / np.bincount(group)
        return mean[group[i]].reshape(-1, 2)

    @cached_property
    def family(self) -> NDArray[np.intp]:
        """The family, 0 or 1, of each block's lines of constant xi; the other lines' is the other.

        Chosen so that as little length of side as may be has lines of other families beyond it.
        """
        shared = [
            (users, self.sides[key].length) for key, users in self.users.items() if len(users) == 2
        ]
        unlike = np.array([(a[0], b[0], (a[1] + b[1]) % 2) for (a, b), _ in shared], int)
        length = np.array([length for _, length in shared])
        count = len(self.blocks)

        def lost(choice: NDArray[np.intp]) -> float:
            if not len(unlike):
                return 0.0
            return float(length[(choice[unlike[:, 0]] + choice[unlike[:, 1]] + unlike[:, 2]) % 2
                                == 1].sum())  # fmt: skip

        starts = [np.zeros(count, int)]
        if count <= _TRIED:
            starts = [np.array((0, *rest)) for rest in product((0, 1), repeat=count - 1)]
            return min(starts, key=lost)
        random = np.random.default_rng(0)
        starts += [random.integers(0, 2, count) for _ in range(_TRIED)]
        best = starts[0]
        for choice in starts:
            improved = True
            while improved:
                improved = False
                for k in range(count):
                    other = choice.copy()
                    other[k] = 1 - other[k]
                    if lost(other) < lost(choice) - 1e-9:
                        choice, improved = other, True
            best = min(best, choice, key=lost)
        return best if best[0] == 0 else 1 - best

    def _family_across(self, block: int, k: int) -> int:
        """The family of the lines that end on side k of a block."""
        return int(self.family[block]) ^ k % 2

    @cached_property
    def broken(self) -> list[tuple[int, int]]:
        """Shared sides across which lines do not run on."""
        return [
            key
            for key, users in self.users.items()
            if len(users) == 2
            and (key in self.cuts or len({self._family_across(*user) for user in users}) == 2)
        ]

    @cached_property
    def bands(self) -> tuple[Band, ...]:
        """All bands: each block lies in two of them, one of each family."""
        found: list[Band] = []
        seen: set[tuple[int, int]] = set()
        for block, axis in product(range(len(self.blocks)), (0, 1)):
            if (block, axis) in seen:
                continue
            first = Stretch(block, axis, False, False)
            onwards, closed = self._followed(first)
            way = [first, *onwards]
            if not closed:
                before, _ = self._followed(first._replace(back=True))
                way = [s._replace(back=not s.back) for s in reversed(before)] + way
            seen |= {(s.block, s.axis) for s in way}
            found.append(Band(tuple(way), closed, int(self.family[block]) ^ axis))
        return tuple(found)

    def _followed(self, first: Stretch) -> tuple[list[Stretch], bool]:
        """The stretches beyond one, and whether the last runs into it again."""
        way: list[Stretch] = []
        now = first
        while True:
            # Lines of xi leave by top or bottom, those of eta by right or left.
            leave = (2, 1)[now.axis] if not now.back else (0, 3)[now.axis]
            p, q = (int(self.blocks[now.block][end]) for end in ENDS[leave])
            key = min(p, q), max(p, q)
            beyond = [user for user in self.users[key] if user != (now.block, leave)]
            if not beyond or key in self.broken:
                return way, False
            (block, k), *_ = beyond
            start = int(self.blocks[block][ENDS[k][0]])
            turned = now.turned ^ (start != p)
            now = Stretch(block, k % 2, turned, k in (1, 2))
            if (now.block, now.axis) == (first.block, first.axis):
                return way, True
            way.append(now)

    def is_wall(self, block: int, k: int) -> bool:
        """Whether lines end at side k of a block."""
        key = self.keys(block)[k]
        return len(self.users[key]) == 1 or key in self.broken


_TRIED = 12


def _inside(geometry: shapely.Geometry) -> str:
    return at(shapely.get_coordinates(shapely.point_on_surface(geometry))[0])


def _merged(points: Floats, near: float) -> tuple[Floats, NDArray[np.intp]]:
    """The points, those near to each other once, and which of these each is."""
    nodes: list[Floats] = []
    index = []
    for point in points:
        gap = [float(np.hypot(*(point - node))) for node in nodes]
        if gap and min(gap) <= near:
            index.append(int(np.argmin(gap)))
        else:
            index.append(len(nodes))
            nodes.append(point)
    return np.array(nodes), np.array(index)


def _along(ring: LinearRing, nodes: Floats, near: float) -> dict[tuple[int, int], Curve]:
    """The pieces of a ring between the nodes on it; these are moved onto it."""
    points: Any = shapely.points(nodes)
    on = np.flatnonzero(shapely.distance(points, ring) <= near)
    xy = np.asarray(ring.coords)[:, :2]
    place = shapely.line_locate_point(ring, points[on])
    order = np.argsort(place)
    on, place = on[order], place[order]
    found: dict[tuple[int, int], Curve] = {}
    if len(on) < 3:
        return found
    walked = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    total = walked[-1]
    for k, node in enumerate(on):
        on_ring: Any = shapely.line_interpolate_point(ring, float(place[k]))
        x, y = on_ring.x, on_ring.y
        corner = int(np.hypot(*(xy - [x, y]).T).argmin())
        nodes[node] = xy[corner] if np.hypot(*(xy[corner] - [x, y])) <= near else (x, y)
    for a, b, begin, end in zip(on, np.roll(on, -1), place, np.roll(place, -1), strict=True):
        end = end if end > begin else end + total
        turns = np.concatenate([walked[:-1], walked[:-1] + total])
        inner = np.concatenate([xy[:-1], xy[:-1]])[(turns > begin + near) & (turns < end - near)]
        points = np.vstack([nodes[a], inner, nodes[b]])
        if len(points) > 3:
            points = shapely.get_coordinates(LineString(points).simplify(FINE))
        curve = polyline(points)
        found[min(a, b), max(a, b)] = curve if a < b else curve.reversed()
    return found


def padded(curves: Sequence[Curve]) -> list[Curve]:
    """The same polylines, all with as many points: more on their longest straight pieces."""
    points = [curve.polyline() for curve in curves]
    most = max(map(len, points))
    result = []
    for xy in points:
        step = np.hypot(*np.diff(xy, axis=0).T)
        parts = np.ones(len(step), int)
        for _ in range(most - len(xy)):
            parts[np.argmax(step / parts)] += 1
        share = np.concatenate([np.arange(n) / n for n in parts])
        which = np.repeat(np.arange(len(step)), parts)
        fine = xy[which] + share[:, None] * np.diff(xy, axis=0)[which]
        result.append(polyline(np.vstack([fine, xy[-1:]])))
    return result
