"""Faces of graphs as closed roads."""

import numpy as np
import pytest
import shapely

from fdjax.plan.polygons import lay_polygons
from fdjax.road.stroke import Polygons


def grid(count, side, start=0.0):
    """A square grid as a graph, its lines cut at every crossing."""
    places = start + side * np.arange(count + 1)
    xy = np.stack(np.meshgrid(places, places, indexing="ij"), -1).reshape(-1, 2)
    number = np.arange((count + 1) ** 2).reshape(count + 1, -1)
    pairs = [(number[:-1], number[1:]), (number[:, :-1], number[:, 1:])]
    edges = np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in pairs])
    return Polygons(xy, edges, np.full(len(edges), 0.4), "mesh")


def test_each_face_is_one_closed_road_inside_its_edges():
    laid = lay_polygons(grid(4, 5.0), shapely.box(0, 0, 20, 20))
    assert len(laid.roads) == 16
    for road in laid.roads:
        assert road.closed
        assert road.length == pytest.approx(4 * (5 - 0.4), abs=0.02)
    beads = [shapely.Polygon(road.xy).exterior.buffer(0.2) for road in laid.roads]
    assert shapely.union_all(beads).area == pytest.approx(sum(b.area for b in beads), rel=1e-3)


def test_walls_cut_faces_and_what_is_left_of_one_joins_another():
    # Columns of 5, 5, 5 and 0.5 mm: the last joins the third.
    laid = lay_polygons(grid(4, 5.0), shapely.box(0, 0, 15.5, 20))
    assert len(laid.roads) == 12
    right = max(road.xy[:, 0].max() for road in laid.roads)
    assert right == pytest.approx(15.3, abs=0.01)
    assert not laid.left_out


def test_a_hole_takes_its_place_out_of_faces():
    hole = shapely.Point(10, 10).buffer(3)
    laid = lay_polygons(grid(4, 5.0), shapely.box(0, 0, 20, 20).difference(hole))
    assert len(laid.roads) == 16
    away = [shapely.distance(hole, shapely.Polygon(r.xy).exterior) for r in laid.roads]
    assert min(away) == pytest.approx(0.2, abs=0.01)


def test_faces_too_small_for_a_road_are_left_out():
    laid = lay_polygons(grid(3, 1.1), shapely.box(0, 0, 3.3, 3.3), least_road=4.0)
    assert laid.roads == ()
    assert len(laid.left_out) == 9
    assert lay_polygons(grid(3, 0.7), shapely.box(0, 0, 2.1, 2.1)).roads == ()
