"""A lattice of nodes as a map: nodes and sides met, one value however it is asked for."""

import numpy as np
import pytest
from grid_samples import bumped, chevron, evaluate, places, quick_jit, transfinite

from fdjax.grid.algebraic import Spacings
from fdjax.grid.base import Sides
from fdjax.grid.elliptic import NodeMap
from fdjax.grid.spacing import RobertsSpacing, UniformSpacing
from fdjax.part.patch import cosine_top

through = quick_jit(NodeMap.through)
SPACINGS = Spacings(
    RobertsSpacing(np.asarray(1.3), 0.0),
    RobertsSpacing(np.asarray(1.4), 0.0),
    UniformSpacing(),
    RobertsSpacing(np.asarray(1.2), 0.5),
)


XI, ETA = places(65, 65)
"""Every fourth line is one of nodes."""


@pytest.fixture(scope="module")
def polygon():
    """Nodes of a polygon whose sides have corners between them, their map and its values."""
    nodes = bumped(transfinite(chevron(), spacings=SPACINGS), 2.0)
    grid = through(nodes, Sides.of(chevron()), SPACINGS)
    return nodes, grid, np.asarray(evaluate(grid, XI, ETA))


def test_nodes_are_met(polygon):
    nodes, _, xy = polygon
    np.testing.assert_allclose(xy[::4, ::4], nodes, atol=1e-12)


def test_sides_with_corners_are_met_between_the_nodes(polygon):
    _, _, xy = polygon
    sides = Sides.of(chevron())
    t = XI[:, 0]
    for got, side, spacing in (
        (xy[:, 0], sides.bottom, SPACINGS.bottom),
        (xy[-1], sides.right, SPACINGS.right),
        (xy[:, -1], sides.top, SPACINGS.top),
        (xy[0], sides.left, SPACINGS.left),
    ):
        np.testing.assert_allclose(got, side(np.asarray(evaluate(spacing, t))), atol=1e-12)


def test_a_lattice_points_and_one_point_agree(polygon):
    _, grid, xy = polygon
    assert xy.shape == (65, 65, 2)
    points = evaluate(grid, *np.broadcast_arrays(XI, ETA))
    np.testing.assert_allclose(points, xy, atol=1e-12)
    one = evaluate(grid, XI[4, 0], ETA[0, 3])
    np.testing.assert_allclose(one, xy[4, 3], atol=1e-12)


def test_smooth_sides_are_kept_to_fourth_order():
    sides = Sides.of(cosine_top())
    t = np.linspace(0, 1, 401)[:, None]
    off = []
    for shape in ((17, 5), (33, 5)):
        smooth = through(transfinite(cosine_top(), shape), sides, Spacings())
        on_top = np.asarray(evaluate(smooth, t, np.ones((1, 1))))[:, 0]
        off.append(np.hypot(*(on_top - sides.top(t[:, 0])).T).max())
    assert off[1] < 2e-3
    assert np.log2(off[0] / off[1]) == pytest.approx(4, abs=0.5)
