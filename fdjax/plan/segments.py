"""All segments of a layer's roads in flat arrays, and which of them meet or come close."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from shapely import STRtree, linestrings

from fdjax.plan.toolpath import NO_NODES, Road, Roads
from fdjax.road.bead import section_area

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_TOUCH = 1e-6
"""Two points closer than this are one, mm."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Segments of several roads, one after the other; those of no length are left out.

    - `start`, `end`: shape (n, 2), mm; `width`, `length`: shape (n,), mm. `section`: mm^2, nan
      where it is that of the width in the layer's height.
    - `road`: index of the road of each segment.
    - `road_ends` (roads, 2, 2), `closed`, `family`, `of_graph`: of each road; the families are
      numbered.
    """

    start: Floats
    end: Floats
    width: Floats
    section: Floats
    length: Floats
    road: Ints
    road_ends: Floats
    closed: NDArray[np.bool_]
    family: Ints
    of_graph: NDArray[np.bool_]

    @classmethod
    def of(cls, roads: Sequence[Road]) -> "Segments":
        if isinstance(roads, Roads):
            return cls._flat(roads)
        names: dict[str, int] = {}
        family = np.array([names.setdefault(road.family, len(names)) for road in roads], int)
        closed = np.array([road.closed for road in roads], bool)
        of_graph = np.array([road.of_graph for road in roads], bool)
        if not roads:
            none = np.zeros(0)
            return cls(np.zeros((0, 2)), np.zeros((0, 2)), none, none, none, np.zeros(0, int),
                       np.zeros((0, 2, 2)), closed, family, of_graph)  # fmt: skip
        paths = [road.path for road in roads]
        start = np.concatenate([path[:-1] for path in paths])
        end = np.concatenate([path[1:] for path in paths])
        width = np.concatenate([road.width for road in roads])
        section = np.concatenate(
            [
                np.full(len(road.width), np.nan) if road.section is None else road.section
                for road in roads
            ]
        )
        owner = np.repeat(np.arange(len(roads)), [len(path) - 1 for path in paths])
        ends = np.stack([path[[0, -1]] for path in paths])
        return cls._lasting(start, end, width, section, owner, ends, closed, family, of_graph)

    @classmethod
    def _flat(cls, roads: Roads) -> "Segments":
        section = np.full(len(roads.width), np.nan) if roads.section is None else roads.section
        owner = roads.owner
        first = np.arange(len(owner)) + owner
        ends = np.stack([roads.points[roads.first[:-1]], roads.points[roads.first[1:] - 1]], 1)
        family = np.unique(roads.family, return_inverse=True)[1]
        lines = np.array([name in NO_NODES for name in roads.names])
        return cls._lasting(
            roads.points.take(first, axis=0),
            roads.points.take(first + 1, axis=0),
            roads.width,
            section,
            owner,
            ends,
            roads.closed,
            family,
            ~lines[roads.family],
        )

    @classmethod
    def _lasting(
        cls,
        start: Floats,
        end: Floats,
        width: Floats,
        section: Floats,
        owner: Ints,
        ends: Floats,
        closed: NDArray[np.bool_],
        family: Ints,
        of_graph: NDArray[np.bool_],
    ) -> "Segments":
        """Those of the segments that have a length."""
        run, rise = (end - start).T
        length = np.sqrt(run * run + rise * rise)
        keep = length > 0
        if not keep.all():
            start, end, width, section = start[keep], end[keep], width[keep], section[keep]
            owner, length = owner[keep], length[keep]
        return cls(start, end, width, section, length, owner, ends, closed, family, of_graph)

    @cached_property
    def road_length(self) -> Floats:
        """Length of each road, mm."""
        return np.bincount(self.road, self.length, len(self.closed)).astype(float)

    @cached_property
    def at(self) -> Floats:
        """Position of each segment's start along its road, mm."""
        total = self.road_length
        return np.cumsum(self.length) - self.length - (np.cumsum(total) - total)[self.road]

    def areas(self, height: float) -> Floats:
        """Section of each in a layer of this height, shape (n,), mm^2."""
        return np.where(np.isnan(self.section), section_area(self.width, height), self.section)

    @cached_property
    def unit(self) -> Floats:
        """Direction of each segment, shape (n, 2)."""
        return (self.end - self.start) / self.length[:, None]

    @cached_property
    def lines(self) -> NDArray[np.object_]:
        """The segments as geometries."""
        return np.asarray(linestrings(np.stack([self.start, self.end], 1)))

    def boxes(self, margin: float) -> NDArray[np.object_]:
        """Diagonals of the segments' bounding boxes, larger by a margin on each side."""
        low = np.minimum(self.start, self.end) - margin
        high = np.maximum(self.start, self.end) + margin
        return np.asarray(linestrings(np.stack([low, high], 1)))

    def near_pairs(self, tree: STRtree) -> tuple[Ints, Ints]:
        """Pairs i < j whose boxes in the tree meet; of one road not those in sequence."""
        i, j = tree.query(tree.geometries)
        keep = i < j
        i, j = i[keep], j[keep]
        same = self.road[i] == self.road[j]
        after = self.at[j] - (self.at[i] + self.length[i]) <= _TOUCH
        around = self.at[j] + self.length[j] - self.at[i] >= (
            self.road_length[self.road[i]] - _TOUCH
        )
        keep = ~(same & (after | (around & self.closed[self.road[i]])))
        return i[keep], j[keep]

    def point(self, index: Ints, place: Floats) -> Floats:
        """Where the position `place` of a road lies, given a segment that holds it."""
        return self.start[index] + (place - self.at[index])[:, None] * self.unit[index]

    def nearest(self, index: Ints, xy: Floats) -> tuple[Floats, Floats]:
        """Distance of points to segments, and the position along the road of the nearest point."""
        offset = xy - self.start[index]
        unit = self.unit[index]
        along = np.clip((offset * unit).sum(1), 0, self.length[index])
        distance = np.hypot(*(offset - along[:, None] * unit).T)
        return distance, self.at[index] + along

    def crossings(self, i: Ints, j: Ints) -> "Crossings":
        """Which of these pairs cross or touch; the free ends of open roads may touch."""
        p, r = self.start[i], self.end[i] - self.start[i]
        q, s = self.start[j], self.end[j] - self.start[j]
        across, size = _cross(r, s), self.length[i] * self.length[j]
        with np.errstate(divide="ignore", invalid="ignore"):
            t, u = _cross(q - p, s) / across, _cross(q - p, r) / across
        edge = 1e-9
        hit = (np.abs(across) > edge * size) & (t >= -edge) & (t <= 1 + edge)
        hit &= (u >= -edge) & (u <= 1 + edge)
        i, j, t, u = i[hit], j[hit], t[hit], u[hit]
        inside = ~(self.at_free_end(i, t) | self.at_free_end(j, u))
        i, j, t, u = i[inside], j[inside], t[inside], u[inside]
        xy = self.start[i] + t[:, None] * (self.end - self.start)[i]
        vertex = self._at_vertex(i, t) & self._at_vertex(j, u)
        sine = np.abs(across[hit][inside]) / size[hit][inside]
        # A crossing at a vertex is found once for each segment that ends there.
        places = np.column_stack([self.road[i], self.road[j], np.round(xy / _TOUCH)])
        first = np.sort(np.unique(places, axis=0, return_index=True)[1])
        return Crossings(i[first], j[first], xy[first], sine[first], vertex[first])

    def _at_vertex(self, index: Ints, share: Floats) -> NDArray[np.bool_]:
        return np.minimum(share, 1 - share) * self.length[index] <= _TOUCH

    @cached_property
    def nodes(self) -> "Nodes":
        """The points that several roads, or one several times, have among theirs, but for those at
        which one road was cut in two.
        """
        road = np.concatenate([self.road, self.road])
        at = np.concatenate([self.at, self.at + self.length])
        total = self.road_length[road]
        at = np.where(self.closed[road] & (at >= total - _TOUCH), at - total, at)
        places = np.round(np.concatenate([self.start, self.end]) / _TOUCH)
        _, first, owner = np.unique(places, axis=0, return_index=True, return_inverse=True)
        passes = np.unique(np.stack([owner, road, np.round(at / _TOUCH)], 1), axis=0)
        node, road = passes[:, 0].astype(int), passes[:, 1].astype(int)
        shared = np.bincount(node, minlength=len(first)) > 1
        number = np.cumsum(shared) - 1
        kept = shared[node]
        xy = np.concatenate([self.start, self.end])[first[shared]]
        node, road = number[node[kept]], road[kept]
        # A road that begins where the one before it ends, and at no third, was cut off it there.
        ends = np.round(self.road_ends / _TOUCH) @ [1, 1j]
        open_ = ~self.closed
        cut = (ends[1:, 0] == ends[:-1, 1]) & open_[1:] & open_[:-1]
        crowded = np.round(xy[np.bincount(node, minlength=len(xy)) > 2] / _TOUCH) @ [1, 1j]
        cut &= ~np.isin(ends[1:, 0], crowded)
        run = np.cumsum(np.concatenate([[True], ~cut])) - 1
        joint = np.isin(np.round(xy / _TOUCH) @ [1, 1j], ends[1:, 0][cut])
        kept = ~joint[node]
        return Nodes(xy, node[kept], run[road[kept]], run)

    def at_free_end(self, index: Ints, share: Floats) -> NDArray[np.bool_]:
        """Whether the place at this share of a segment is where an open road starts or ends."""
        place = self.at[index] + share * self.length[index]
        ends = (place <= _TOUCH) | (place >= self.road_length[self.road[index]] - _TOUCH)
        return ends & ~self.closed[self.road[index]]


@dataclass(frozen=True, eq=False)
class Crossings:
    """Pairs of segments that cross: where, the sine of the angle between them, and whether that
    place is a point of both roads.
    """

    i: Ints
    j: Ints
    xy: Floats
    sine: Floats
    vertex: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Nodes:
    """Points that roads share, shape (nodes, 2), mm; the node and the run of each pass; and the
    run that each road belongs to: pieces of one that follow each other are one run.
    """

    xy: Floats
    node: Ints
    run: Ints
    of_road: Ints


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
