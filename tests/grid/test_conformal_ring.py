"""Conformal maps of rings against each other, their lines, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import evaluate
from shapely import Point, Polygon

from fdjax.grid import conformal, conformal_ring, ring_chart
from fdjax.grid.base import tangents

OUTLINE = np.array([(0, 0), (4, 0), (4, 4), (0, 4)], float)
SQUARE = np.array([(1, 1), (3, 1), (3, 3), (1, 3)], float)
BENT = np.array([(0, 0), (6, 0), (4.5, 5), (-1, 4)])
HOLE = np.array([(1.5, 1), (3, 1.5), (2.5, 3), (1, 2.5)])

solved = jax.jit(conformal_ring.solve)
mapped = jax.jit(conformal_ring.ring_map, static_argnums=1)


def test_a_square_ring_is_four_of_its_quarters():
    """Lines of symmetry are straight: each quarter is an L, mapped to a rectangle."""
    found = solved(OUTLINE, SQUARE)
    assert float(found.error) < 1e-11
    ell = np.array([(2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (0, 0)], float)
    # Bottom and top are the lines of symmetry, left and right the walls.
    quarter = jax.jit(conformal.solve, static_argnums=1)(ell, (0, 1, 3, 4))
    assert float(quarter.error) < 1e-11
    assert float(found.span) == pytest.approx(np.pi / 2 / float(quarter.modulus), rel=1e-10)
    xi, eta = np.array([0.3, 0.5, 0.8]), np.array([0.2, 0.5, 0.9])
    exact = np.asarray(jax.jit(conformal.rectangle_map)(quarter, 1 - xi, eta))
    # From the middle of the bottom side of the ring back to its corner, and up the left side.
    got = np.asarray(mapped(found, 4, xi, 0.125 - 0.25 * eta))
    np.testing.assert_allclose(got, exact, atol=1e-9)


def test_walls_are_walls_and_vertices_are_reached():
    found = solved(BENT, HOLE)
    assert float(found.error) < 1e-10
    eta = np.linspace(0, 1, 17)
    for at, wall, angle in ((1.0, BENT, found.angle[:4]), (0.0, HOLE, found.angle[4:])):
        ring = Polygon(wall).exterior
        xy = np.asarray(mapped(found, 4, np.full(17, at), eta))
        assert max(ring.distance(Point(point)) for point in xy) < 1e-8
        places = np.resize(np.asarray(angle) / (2 * np.pi), 17)
        got = np.asarray(mapped(found, 4, np.full(17, at), places))
        np.testing.assert_allclose(got, np.resize(wall, (17, 2)), atol=1e-6)


def test_slopes_are_those_of_central_differences():
    weight = np.random.default_rng(1).normal(size=(3, 2))
    places = jnp.array([0.2, 0.5, 0.9]), jnp.array([0.1, 0.45, 0.8])

    def plain(outline, hole):
        found = conformal_ring.solve(outline, hole)
        points = conformal_ring.ring_map(found, 4, *places)
        return found.span + (weight * points).sum()

    value, gradient = jax.jit(plain), jax.jit(jax.grad(plain, argnums=(0, 1)))(BENT, HOLE)
    random = np.random.default_rng(2)
    ways = [random.normal(size=(4, 2)) for _ in range(2)]
    slope = sum((each * way).sum() for each, way in zip(gradient, ways, strict=True))
    step = 1e-5
    ahead, behind = (value(BENT + s * ways[0], HOLE + s * ways[1]) for s in (step, -step))
    norm = np.sqrt(sum((np.asarray(each) ** 2).sum() for each in gradient))
    assert abs((ahead - behind) / (2 * step) - slope) < 1e-6 * norm
    _, pushed = jax.jit(lambda at, by: jax.jvp(plain, at, by))((BENT, HOLE), tuple(ways))
    assert abs(pushed - slope) < 1e-8 * norm


def test_lines_of_a_chart_cross_squarely_and_close():
    grid, error, off = ring_chart.chart(10 * BENT, 10 * HOLE, 64)
    assert error < 1e-10
    assert off == 0
    # Near corners of the walls the splines follow the map less well.
    xi, eta = jnp.linspace(0.3, 0.7, 5)[:, None], jnp.linspace(0, 1, 41)[None]
    xy, along = tangents(grid, xi, eta)
    assert (np.asarray(along.jacobian) > 0).all()
    assert float(along.skew.max()) < 5e-3
    np.testing.assert_allclose(xy[:, 0], xy[:, -1], atol=1e-9)
    for place, wall in ((1.0, BENT), (0.0, HOLE)):
        ring = Polygon(10 * wall).exterior
        points = np.asarray(evaluate(grid, jnp.full(41, place), eta[0]))
        assert max(ring.distance(Point(point)) for point in points) < 1e-9


def test_a_wall_of_many_points_is_kept_though_fewer_are_mapped():
    angle = 2 * np.pi * np.arange(96) / 96
    circle = np.array([20, 20]) + 9 * np.stack([np.cos(angle), np.sin(angle)], 1)
    grid, error, off = ring_chart.chart(10 * OUTLINE, circle, 20)
    assert error < 1e-9
    assert 0 < off < 0.3
    points = np.asarray(evaluate(grid, jnp.zeros(97), jnp.linspace(0, 1, 97)))
    ring = Polygon(circle).exterior
    assert max(ring.distance(Point(point)) for point in points) < 1e-9
