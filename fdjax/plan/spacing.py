"""Distances within a layer and between layers: roads too close, roads over nothing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import STRtree, points

from fdjax.plan.segments import Nodes, Segments
from fdjax.plan.stadium import stadium_chord

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

NEAR_TURN = 4.0
"""Parts of one run nearer along it than this many times the limit are its own turn."""

_SAME_PLACE = 0.01
"""Ends of two roads nearer than this continue each other, mm."""


@dataclass(frozen=True, eq=False)
class Approaches:
    """Pairs of segments too close to each other: their distance, the limit, and where."""

    i: Ints
    j: Ints
    distance: Floats
    limit: Floats
    xy: Floats


def approaches(
    segments: Segments,
    i: Ints,
    j: Ints,
    least: float | None,
    slack: float,
) -> Approaches:
    """Which of these pairs, of one family, come closer than the limit less `slack`, mm.

    The limit is `least`, or where None the mean of the two widths. The distance of two segments
    is that of an end of one to the other (crossings are found elsewhere). Places of one run that
    are near each other along it too, by `NEAR_TURN` limits, belong to its turn and do not count;
    nor, likewise, where one road ends and another goes on from there; nor, of roads of graphs, near
    a point that both have, by so much from the one place to it and on to the other.
    """
    same = segments.family[segments.road[i]] == segments.family[segments.road[j]]
    i, j = i[same], j[same]
    limit = (segments.width[i] + segments.width[j]) / 2 if least is None else np.full(len(i), least)
    found = []
    for a, b, share in ((i, j, 0), (i, j, 1), (j, i, 0), (j, i, 1)):
        point = segments.end[a] if share else segments.start[a]
        distance, place = segments.nearest(b, point)
        near = np.flatnonzero(distance < limit - slack)
        own = segments.at[a[near]] + share * segments.length[a[near]]
        apart = _along(segments, a[near], own, b[near], place[near])
        near = near[apart > NEAR_TURN * limit[near]]
        graph = segments.of_graph[segments.road[a[near]]]
        if graph.any():
            _, place = segments.nearest(b[near], point[near])
            places = point[near], segments.point(b[near], place)
            roads = segments.road[a[near]], segments.road[b[near]]
            met = _at_a_node(segments.nodes, places, roads, NEAR_TURN * limit[near])
            near = near[~(graph & met)]
        found.append((a[near], b[near], distance[near], limit[near], point[near]))
    return Approaches(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _along(segments: Segments, a: Ints, at_a: Floats, b: Ints, at_b: Floats) -> Floats:
    """Way along the roads from one place to another; infinite where they do not meet."""
    road_a, road_b = segments.road[a], segments.road[b]
    total_a, total_b = segments.road_length[road_a], segments.road_length[road_b]
    gap = np.abs(at_a - at_b)
    gap = np.where(segments.closed[road_a], np.minimum(gap, total_a - gap), gap)
    gap = np.where(road_a == road_b, gap, np.inf)
    for end_a, way_a in ((0, at_a), (1, total_a - at_a)):
        for end_b, way_b in ((0, at_b), (1, total_b - at_b)):
            between = segments.road_ends[road_a, end_a] - segments.road_ends[road_b, end_b]
            meet = (np.hypot(*between.T) < _SAME_PLACE) & (road_a != road_b)
            gap = np.where(meet, np.minimum(gap, way_a + way_b), gap)
    return gap


def _at_a_node(
    nodes: Nodes, places: tuple[Floats, Floats], roads: tuple[Ints, Ints], reach: Floats
) -> NDArray[np.bool_]:
    """Whether the way between two places of two roads, by a node of both, is within reach."""
    found = np.zeros(len(reach), bool)
    if not len(nodes.node):
        return found
    runs = tuple(nodes.of_road[road] for road in roads)
    tree = STRtree(np.asarray(points(nodes.xy)))
    pair, node = tree.query(points(places[0]), predicate="dwithin", distance=reach)
    way = sum(np.hypot(*(place[pair] - nodes.xy[node]).T) for place in places)
    # Passes of a road through a node: of one road with itself two are needed.
    count = int(nodes.of_road.max()) + 1
    passes, times = np.unique(nodes.node * count + nodes.run, return_counts=True)
    meet = way <= reach[pair]
    needed = 1 + (runs[0] == runs[1])[pair]
    for run in runs:
        key = node * count + run[pair]
        at = np.minimum(np.searchsorted(passes, key), len(passes) - 1)
        meet &= (passes[at] == key) & (times[at] >= needed)
    found[pair[meet]] = True
    return found


@dataclass(frozen=True, eq=False)
class Spans:
    """Stretches of roads over nothing: length and middle of each."""

    length: Floats
    xy: Floats


def spans(upper: Segments, lower: Segments, tree: STRtree) -> Spans:
    """The stretches of the upper layer's centre lines that lie on no bead of the layer below.

    A bead reaches half its width to either side of its centre line and beyond its ends. `tree`
    holds the lower segments' boxes, grown by at least half their width. Stretches at the end of
    a road count like those between two beads; a closed road is cut where it starts.
    """
    i, j = tree.query(upper.lines)
    low, high = stadium_chord(
        upper.start[i], upper.unit[i], lower.start[j], lower.end[j], lower.width[j] / 2
    )
    low, high = np.maximum(low, 0), np.minimum(high, upper.length[i])
    hit = low <= high
    offset = np.cumsum(upper.road_length) - upper.road_length
    begin = (offset[upper.road] + upper.at)[i[hit]]
    # The ends of the roads bound what lies over nothing as beads do.
    low = np.concatenate([begin + low[hit], offset, offset + upper.road_length])
    high = np.concatenate([begin + high[hit], offset, offset + upper.road_length])
    order = np.argsort(low)
    low, reached = low[order], np.maximum.accumulate(high[order])
    gap = low[1:] - reached[:-1]
    open_ = np.flatnonzero(gap > 1e-9)
    middle = (low[1:] + reached[:-1])[open_] / 2
    index = np.searchsorted(offset[upper.road] + upper.at, middle, side="right") - 1
    return Spans(gap[open_], upper.point(index, middle - offset[upper.road[index]]))
