"""Areas of regions in cells, against intersections."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from outlines import OUTLINES

from fdjax.part.cells import cell_areas, cells


@pytest.mark.parametrize("turn", [0.0, 0.6435])
@pytest.mark.parametrize("name", OUTLINES)
def test_areas_are_those_of_the_intersections(name, turn):
    matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    region = shapely.transform(OUTLINES[name](), lambda xy: xy @ matrix)
    x0, y0, x1, y1 = region.bounds
    for inside in (0.0, 9.0):
        # Cells that leave some of the region out, too.
        x, y = cells(x0 + inside, x1, 2.3)[0], cells(y0, y1 - inside, 1.9)[0]
        boxes = shapely.box(x[:-1, None], y[:-1], x[1:, None], y[1:])
        expected = shapely.area(shapely.intersection(region, boxes))
        np.testing.assert_allclose(cell_areas(region, x, y), expected, atol=1e-10)


def test_several_polygons_add_up():
    both = shapely.MultiPolygon([shapely.box(0, 0, 2, 2), shapely.box(3, 1, 5, 4)])
    x, y = np.linspace(0, 5, 8), np.linspace(0, 4, 5)
    assert cell_areas(both, x, y).sum() == pytest.approx(both.area)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), corners=st.integers(3, 12), columns=st.integers(1, 9))
def test_random_polygons_with_holes_that_leave_the_lattice(seed, corners, columns):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    radius = rng.uniform(2, 6, corners)
    outer = np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
    region = shapely.Polygon(outer).buffer(0)
    for _ in range(3):
        region = region.difference(shapely.Point(rng.uniform(-4, 4, 2)).buffer(rng.uniform(0.2, 1)))
    # The lattice covers a part of the region, and some of its outside.
    x, y = np.linspace(-3.5, 5, columns + 1), np.linspace(-7, 2.5, 7)
    boxes = shapely.box(x[:-1, None], y[:-1], x[1:, None], y[1:])
    expected = shapely.area(shapely.intersection(region, boxes))
    np.testing.assert_allclose(cell_areas(region, x, y), expected, atol=1e-9)


def test_what_lies_outside_counts_nowhere():
    x, y = np.linspace(0, 4, 5), np.linspace(0, 3, 4)
    for off in (shapely.box(5, 0, 9, 3), shapely.box(-9, 0, -1, 3), shapely.box(0, 4, 4, 9)):
        np.testing.assert_allclose(cell_areas(off, x, y), 0, atol=1e-12)
    np.testing.assert_allclose(cell_areas(shapely.box(-9, -9, 9, 9), x, y), np.ones((4, 3)))
