"""Graphs as roads: each edge once, cut at the walls, with little travel."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from fdjax.errors import InputError
from fdjax.limits import Limits
from fdjax.plan.check import check
from fdjax.plan.euler import trails
from fdjax.plan.order import order_roads
from fdjax.plan.pairing import pairs
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.plan.trail import lay_graph
from fdjax.road.stroke import Graph

HOLED = shapely.Point(0, 0).buffer(20).difference(shapely.Point(6, 3).buffer(5))


def triangles(count, seed=0, reach=22.0):
    """Nodes and edges of a triangulation of random points, none near another."""
    rng = np.random.default_rng(seed)
    step = reach * 2 / np.sqrt(count)
    lattice = np.arange(-reach, reach + step, step)
    x, y = np.meshgrid(lattice, lattice)
    x = x + step / 2 * (np.arange(len(lattice)) % 2)[:, None]
    xy = np.stack([x.ravel(), y.ravel()], 1) + rng.uniform(-0.2, 0.2, (x.size, 2)) * step
    corners = Delaunay(xy).simplices
    edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return xy, np.unique(edges, axis=0)


def graph(xy, edges, width=0.4):
    return Graph(xy, edges, np.full(len(edges), width), "mesh")


def lattice(n, step=2.0):
    """A honeycomb's nodes and edges, three edges at each node inside."""
    across = step * np.sqrt(3)
    k, m = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    middle = np.stack([across * (k + m % 2 / 2), step * 1.5 * m], -1).reshape(-1, 2)
    turn = np.radians(np.arange(30, 390, 60))
    around = middle[:, None] + step * np.stack([np.cos(turn), np.sin(turn)], 1)
    xy, own = np.unique(np.round(around.reshape(-1, 2), 6), axis=0, return_inverse=True)
    own = own.reshape(-1, 6)
    edges = np.sort(np.stack([own, np.roll(own, -1, 1)], -1).reshape(-1, 2), axis=1)
    return xy, np.unique(edges, axis=0)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), nodes=st.integers(2, 14), share=st.floats(0.1, 1.0))
def test_each_edge_is_laid_once_and_the_roads_are_as_few_as_may_be(seed, nodes, share):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 10, (nodes, 2))
    every = np.array([(a, b) for a in range(nodes) for b in range(a)])
    edges = every[rng.random(len(every)) < share]
    found = trails(xy, edges)
    laid = sorted(edge for _, own, _ in found for edge in own)
    assert laid == list(range(len(edges)))
    for path, own, closed in found:
        steps = zip(path, [*path[1:], *path[: int(closed)]], strict=closed)
        ends = [sorted(step) for step in steps][: len(own)]
        assert ends == [sorted(edges[edge]) for edge in own]
    # As many roads as pairs of odd nodes, and a closed one where a part has none.
    odd = int((np.bincount(edges.ravel(), minlength=1) % 2).sum())
    assert sum(not closed for *_, closed in found) == odd // 2


def test_straight_on_where_that_is_possible():
    line = np.arange(5.0)
    x, y = np.meshgrid(line, line, indexing="ij")
    xy = np.stack([x.ravel(), y.ravel()], 1)
    number = np.arange(25).reshape(5, 5)
    edges = np.concatenate([
        np.stack([number[:-1].ravel(), number[1:].ravel()], 1),
        np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], 1),
    ])  # fmt: skip
    turns = 0
    for path, _, _ in trails(xy, edges):
        step = np.diff(xy[path], axis=0)
        turns += int(((step[1:] * step[:-1]).sum(1) < 0.5).sum())
    # The rim turns at its corners, and where it takes up what would be a road by itself.
    assert turns <= 12


def apart(roads, off):
    """The roads with each of their nodes cut off, and their ends: lines that share no point, unless
    roads cross, or share more than a node.
    """
    lines = []
    for path, closed in roads:
        step = np.diff(path, axis=0)
        away = off * step / np.hypot(*step.T)[:, None]
        cut = np.stack([path[:-1] + away, path[1:] - away], 1).reshape(-1, 2)
        lines.append(shapely.LinearRing(cut) if closed else shapely.LineString(cut))
    return lines


def met(lines):
    """How many pairs of the lines share a point, or one has a point twice."""
    pairs = shapely.STRtree(lines).query(lines, predicate="intersects")
    return (pairs[0] < pairs[1]).sum() + (~shapely.is_simple(lines)).sum()


def as_lines(xy, found):
    return [(xy[[*path, path[0]] if closed else path], closed) for path, _, closed in found]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(5, 60), share=st.floats(0.3, 1.0))
def test_roads_that_may_not_cross_touch_in_nodes_at_most(seed, count, share):
    rng = np.random.default_rng(seed)
    xy, edges = triangles(count, seed)
    edges = edges[rng.random(len(edges)) < share]
    off = 0.01 * np.hypot(*np.diff(xy[edges], axis=1)[:, 0].T).min(initial=1.0)
    found = trails(xy, edges, crossing=False)
    assert sorted(edge for _, own, _ in found for edge in own) == list(range(len(edges)))
    assert met(apart(as_lines(xy, found), off)) == 0
    # Nothing travels more for it: as many roads as with crossings.
    free = trails(xy, edges)
    odd = int((np.bincount(edges.ravel(), minlength=1) % 2).sum())
    assert sum(not closed for *_, closed in found) == odd // 2
    assert sum(closed for *_, closed in found) == sum(closed for *_, closed in free)


def test_the_look_for_crossings_finds_them():
    xy, edges = triangles(60)
    assert met(apart(as_lines(xy, trails(xy, edges)), 1e-3)) > 20
    star = np.array([(0.0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])
    spokes = np.array([(0, 1), (0, 2), (0, 3), (0, 4)])
    assert met(apart(as_lines(star, trails(star, spokes)), 1e-3)) == 1
    found = trails(star, spokes, crossing=False)
    assert met(apart(as_lines(star, found), 1e-3)) == 0
    assert len(found) == 2


def test_roads_of_a_mesh_in_a_disc_with_a_hole_may_be_kept_from_crossing():
    xy, edges = triangles(220)
    free, kept = (
        lay_graph(replace(graph(xy, edges), crossing=crossing), HOLED).roads
        for crossing in (True, False)
    )
    assert sum(road.length for road in kept) == pytest.approx(sum(road.length for road in free))

    def crossed(roads):
        return met(apart([(road.path, road.closed) for road in roads], 1e-3))

    assert crossed(kept) == 0
    assert crossed(free) > 100
    travel = [Layer(0.2, 0.2, roads, HOLED).travel for roads in (free, kept)]
    assert travel[1] < 1.3 * travel[0]
    # Of six edges two go straight on and the others turn back to their neighbours.
    steps = [np.diff(road.path, axis=0) for road in kept]
    turns = np.concatenate(
        [
            (step[1:] * step[:-1]).sum(1) / np.hypot(*step[1:].T) / np.hypot(*step[:-1].T)
            for step in steps
        ]
    )
    assert (turns > 0.8).mean() > 0.2


def test_a_mesh_is_cut_at_the_walls_of_a_disc_with_a_hole():
    xy, edges = triangles(220)
    laid = lay_graph(graph(xy, edges), HOLED)
    free = shapely.buffer(HOLED, -0.2)
    lines = shapely.MultiLineString([road.path for road in laid.roads])
    assert free.buffer(1e-6).covers(lines)
    inside = shapely.linestrings(xy[edges])
    asked = shapely.length(shapely.intersection(inside, free)).sum()
    assert lines.length == pytest.approx(asked, rel=0.01)
    layer = Layer(0.2, 0.2, laid.roads, HOLED)
    found = check(Build((layer,), origin=(20, 20)), Limits(least_road=1.0))
    assert {f.severity for f in found} <= {"warning"}
    assert [f.kind for f in found].count("nodes") == 1


def test_edges_that_cross_between_nodes_are_no_node():
    xy = np.array([(2.0, 2), (8, 8), (2, 8), (8, 2)])
    cross = lay_graph(graph(xy, np.array([(0, 1), (2, 3)])), shapely.box(0, 0, 10, 10))
    (found,) = check(Build((Layer(0.2, 0.2, cross.roads, shapely.box(0, 0, 10, 10)),)))
    assert (found.kind, found.severity) == ("crossing", "error")


def test_three_edges_at_each_node_travel_less_than_to_the_nearest_edge_each_time():
    xy, edges = lattice(18, step=4.0)
    xy = xy + np.random.default_rng(1).uniform(-1.8, 1.8, xy.shape)
    laid = lay_graph(graph(xy, edges), shapely.box(-9, -9, 140, 140))
    length = np.hypot(*np.diff(xy[edges], axis=1)[:, 0].T).sum()
    assert sum(road.length for road in laid.roads) == pytest.approx(length)
    ends = xy[edges]
    here, travel, free = ends[0, 0], 0.0, ends.reshape(-1, 2).copy()
    for _ in edges:
        gap = np.hypot(*(free - here).T)
        first = int(np.argmin(gap))
        travel += gap[first]
        here = ends[first // 2, 1 - first % 2]
        free[[first, first ^ 1]] = np.inf
    assert Layer(0.2, 0.2, laid.roads).travel < 0.9 * travel
    steps = [np.diff(road.path, axis=0) for road in laid.roads]
    turns = np.concatenate([(step[1:] * step[:-1]).sum(1) for step in steps])
    assert (turns < 0).mean() < 0.05


def test_a_short_bit_is_left_out_and_said():
    xy = np.array([(2.0, 2), (8, 2), (5, 5), (5.9, 5)])
    laid = lay_graph(graph(xy, np.array([(0, 1), (2, 3)])), shapely.box(0, 0, 10, 10))
    assert [road.length for road in laid.roads] == [6]
    assert [road.length for road in laid.left_out] == pytest.approx([0.9])


def test_order_of_many_roads_is_not_made_worse():
    xy, edges = lattice(9)
    roads = [Road(xy[path], 0.4) for path, _, closed in trails(xy, edges) if not closed]
    given = Layer(0.2, 0.2, tuple(roads)).travel
    assert Layer(0.2, 0.2, tuple(order_roads(roads))).travel <= given + 1e-9


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), half=st.integers(0, 4))
def test_pairs_are_near_the_best_there_are(seed, half):
    points = np.random.default_rng(seed).uniform(0, 10, (2 * half, 2))
    found = pairs(points)
    assert sorted(found.ravel()) == list(range(2 * half))

    def least(left):
        if not left:
            return 0.0
        first, *others = left
        return min(
            np.hypot(*(points[first] - points[other]))
            + least([each for each in others if each != other])
            for other in others
        )

    length = np.hypot(*(points[found[:, 0]] - points[found[:, 1]]).T).sum()
    assert length <= 1.5 * least(list(range(2 * half))) + 1e-9


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"xy": np.array([(0.0, np.nan), (1, 1)])}, "nodes must be finite"),
        ({"edges": np.array([(0, 2)])}, "beyond the 2"),
        ({"edges": np.array([(0.0, 1.0)])}, "whole numbers"),
        ({"width": np.array([0.0])}, "1 positive widths"),
        ({"family": "xi"}, "family of lines"),
    ],
)
def test_a_graph_that_does_not_fit_is_refused(changes, said):
    values = {
        "xy": np.array([(1.0, 1), (4, 4)]), "edges": np.array([(0, 1)]),
        "width": np.array([0.4]), "family": "mesh",
    }  # fmt: skip
    with pytest.raises(InputError, match=said):
        lay_graph(Graph(**(values | changes)), shapely.box(0, 0, 9, 9))


def test_nothing_to_lay():
    empty = Graph(np.zeros((0, 2)), np.zeros((0, 2), int), np.zeros(0), "mesh")
    assert lay_graph(empty, shapely.box(0, 0, 9, 9)).roads == ()
