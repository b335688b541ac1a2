"""Graphs as roads: each edge once, from wall to wall, in roads that are long enough."""

import itertools

import numpy as np
import pytest
import shapely
from outlines import OUTLINES

from fdjax.errors import InputError
from fdjax.plan.check import check
from fdjax.plan.drawing import lay_drawing
from fdjax.plan.toolpath import Build, Layer
from fdjax.road.stroke import Drawing


def graph_of(edges, **changes):
    """The drawing of pairs of points."""
    points, number = np.unique(np.round(np.reshape(edges, (-1, 2)), 9), axis=0, return_inverse=True)
    values = {"width": np.full(len(edges), 0.4), "family": "drawn"} | changes
    return Drawing(points, number.reshape(-1, 2), **values)


def honeycomb(side, size=90.0):
    """Hexagons over a square from -5 mm on."""
    s = np.sqrt(3) / 2
    cell = [((0, 0.5), (s, 0)), ((s, 0), (2 * s, 0.5)), ((0, 0.5), (0, 1.5)),
            ((0, 1.5), (s, 2)), ((s, 2), (2 * s, 1.5)), ((s, 2), (s, 3))]  # fmt: skip
    at = [
        (i * 2 * s, j * 3)
        for i in range(int(size / side / 2 / s) + 1)
        for j in range(int(size / side / 3) + 1)
    ]
    return graph_of([
        [np.add(shift, end) * side - 5 for end in edge] for shift in at for edge in cell
    ])  # fmt: skip


def squares(side, size=90.0):
    at = np.arange(-5, size, side)
    across = [((a, y), (b, y)) for a, b in itertools.pairwise(at) for y in at]
    return graph_of([*across, *(((y, x), (v, u)) for (x, y), (u, v) in across)])


def errors(roads, region, **options):
    build = Build((Layer(0.2, 0.2, tuple(roads), region),), origin=(100.0, 100.0))
    return [each for each in check(build, **options) if each.severity == "error"]


@pytest.mark.parametrize("drawn", [honeycomb(2.5), honeycomb(0.85), squares(2.0)])
@pytest.mark.parametrize("outline", ["disc", "ring", "star"])
def test_each_edge_is_laid_once(drawn, outline):
    region = OUTLINES[outline]()
    laid = lay_drawing(drawn, region, tolerance=2e-3, least_road=1.0)
    assert errors(laid.roads, region) == []
    free = region.buffer(-0.2, join_style="mitre")
    asked = shapely.MultiLineString(list(drawn.xy[drawn.edges])).intersection(free).length
    got = sum(road.length for road in laid.roads)
    left_out = sum(road.length for road in laid.left_out)
    # Ends that lie near each other at a wall are joined there.
    assert (1 - 1e-9) * asked < got + left_out < 1.002 * asked
    assert left_out < 0.015 * asked
    assert min(road.length for road in laid.roads) >= 1.2
    # What crosses where nothing allows it is still seen.
    assert {each.kind for each in errors(laid.roads, region)} <= {"crossing", "spacing"}


def test_roads_go_straight_on_through_nodes():
    roads = lay_drawing(squares(4.0), OUTLINES["square"]()).roads
    assert all(road.length == pytest.approx(79.6) for road in roads)
    assert len(roads) == 40


def test_loops_are_closed_roads():
    ring = [(10 + 5 * np.cos(t), 10 + 5 * np.sin(t)) for t in np.linspace(0, 2 * np.pi, 41)]
    (road,) = lay_drawing(graph_of(list(itertools.pairwise(ring))), shapely.box(0, 0, 20, 20)).roads
    assert road.closed
    assert len(road.xy) == 40


@pytest.mark.parametrize("before", [-0.2, 0.3])
def test_ends_near_each_other_at_a_wall_are_joined_once(before):
    # Two edges from a node on either side of the free region's side at x = 9.8.
    node = (9.8 - before, 5.0)
    away = [(1.0, y) for y in (4.0, 6.0)] if before < 0 else [(12.0, y) for y in (3.6, 6.4)]
    edges = [(node, each) for each in away] + ([] if before < 0 else [((1.0, 5.0), node)])
    if before > 0:
        # The way to the node may have corners.
        corner = tuple(np.mean([node, (9.8, 4.9)], axis=0))
        edges = [(node, corner), (corner, away[0]), *edges[1:]]
    laid = lay_drawing(graph_of(edges), shapely.box(0, 0, 10, 10), least_road=1.0)
    lines = shapely.linestrings(edges)
    inside = shapely.length(shapely.intersection(lines, shapely.box(0.2, 0.2, 9.8, 9.8))).sum()
    total = sum(road.length for road in (*laid.roads, *laid.left_out))
    joined = 2 * 0.2 / (9.8 + 0.2 - 1.0) if before < 0 else 0.0
    assert total == pytest.approx(inside + joined, abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": np.full(2, 0.4)}, "4 positive widths"),
        ({"edges": np.array([[0, 9]])}, "nodes beyond the 4"),
        ({"xy": np.full((4, 2), np.nan)}, "must be finite"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changes, words):
    corners = np.array([(0.0, 0), (1, 0), (1, 1), (0, 1)])
    edges = np.array([(0, 1), (1, 2), (2, 3), (3, 0)])
    whole = {"xy": corners, "edges": edges, "width": np.full(4, 0.4), "family": "drawn"}
    with pytest.raises(InputError, match=words):
        lay_drawing(Drawing(**(whole | changes)), shapely.box(0, 0, 9, 9))
