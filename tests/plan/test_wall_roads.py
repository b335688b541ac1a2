"""Closed roads along the walls, and edges that end at them."""

import numpy as np
import pytest
import shapely

from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.plan.check import check
from fdjax.plan.rings import lay_rings
from fdjax.plan.trace import lay
from fdjax.road.stroke import Graph, Rings

HOLED = shapely.box(0, 0, 20, 12).difference(shapely.Point(7, 6).buffer(3))


def test_a_road_runs_along_each_wall_half_its_width_inside():
    laid = lay_rings(Rings(0.4, "wall"), HOLED)
    assert [road.closed for road in laid.roads] == [True, True]
    length = sorted(road.length for road in laid.roads)
    assert length[1] == pytest.approx(2 * (19.6 + 11.6))
    assert length[0] == pytest.approx(2 * np.pi * 3.2, rel=0.01)
    beads = shapely.union_all([
        shapely.buffer(shapely.LinearRing(road.xy), 0.2) for road in laid.roads
    ])  # fmt: skip
    assert HOLED.buffer(1e-6).covers(beads)


def test_none_goes_through_a_neck_in_which_two_would_lie_on_each_other():
    dumbbell = shapely.union_all(
        [shapely.box(0, 0, 8, 8), shapely.box(12, 0, 20, 8), shapely.box(7, 3.7, 13, 4.3)]
    )
    roads = lay_rings(Rings(0.4, "wall"), dumbbell).roads
    assert len(roads) == 2
    assert all(road.length < 33 for road in roads)
    narrow = lay_rings(Rings(0.4, "wall"), shapely.box(0, 0, 9, 0.6))
    assert narrow.roads == ()


def test_edges_end_where_the_bead_along_the_wall_does():
    part = Part.plate(HOLED, layers=1)
    x = np.linspace(-1, 21, 5)
    xy = np.concatenate([np.column_stack([x, np.full(5, y)]) for y in (1.5, 10.5)])
    edges = np.concatenate(
        [np.column_stack([np.arange(4), np.arange(1, 5)]) + 5 * k for k in (0, 1)]
    )
    graph = Graph(xy, edges, np.full(8, 0.4), "mesh", margin=0.4)
    build = lay([[Rings(0.4, "wall"), graph]], part, lift_length=4.0)
    ring, edge = (
        [road for road in build.layers[0].roads if road.family == family]
        for family in ("wall", "mesh")
    )
    ends = np.concatenate([road.path[[0, -1]] for road in edge])
    assert np.sort(ends[:, 0]) == pytest.approx([0.6, 0.6, 19.4, 19.4])
    assert len(ring) == 2
    assert check(build, Limits()) == ()


def test_a_room_smaller_than_the_margin_holds_the_ring_alone():
    graph = Graph(np.array([(0.5, 0.5), (0.5, 3)]), np.array([(0, 1)]), np.full(1, 0.4), "mesh",
                  margin=0.6)  # fmt: skip
    build = lay(
        [[Rings(0.4, "wall"), graph]], Part.plate(shapely.box(0, 0, 1, 9), layers=1), lift_length=4
    )
    assert [road.family for road in build.layers[0].roads] == ["wall"]
