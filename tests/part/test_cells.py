"""Areas of regions in cells, against intersections."""

import numpy as np
import pytest
import shapely
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
