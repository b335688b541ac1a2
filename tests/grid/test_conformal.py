"""Conformal maps against maps known in closed form, their lines, and their derivatives."""

from math import gamma

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import evaluate

from fdjax.grid import conformal
from fdjax.grid.base import tangents

solved = jax.jit(conformal.solve, static_argnums=1)
mapped = jax.jit(conformal.rectangle_map)
ELL = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], float)
ELL_CORNERS = (0, 1, 2, 5)
QUAD = np.array([(0, 0), (4, 0.5), (3.5, 3), (-0.5, 2.5)])
CORNERS = (0, 1, 2, 3)


@pytest.mark.parametrize("ratio", [0.125, 0.5, 1.0, 3.0])
def test_a_rectangle_is_mapped_onto_itself(ratio):
    found = solved(jnp.array([(0, 0), (1, 0), (1, ratio), (0, ratio)]), CORNERS)
    assert float(found.error) < 1e-9
    assert float(found.modulus) == pytest.approx(ratio, rel=1e-9)
    xi, eta = np.array([0.3, 0.0, 1.0, 0.5, 0.77]), np.array([0.7, 1.0, 1.0, 1.0, 0.01])
    got = np.asarray(mapped(found, xi, eta))
    exact = np.stack([xi, ratio * eta], 1)
    np.testing.assert_allclose(got[[0, 3, 4]], exact[[0, 3, 4]], atol=1e-9 * max(1, ratio))
    # At right-angled corners roundings of the disc come out as their square roots.
    # the more so, the more crowded its prevertices are.
    np.testing.assert_allclose(got, exact, atol=2e-7 / min(ratio, 1))


def test_the_modulus_of_an_ell_is_the_root_of_a_third():
    found = solved(ELL, ELL_CORNERS)
    assert float(found.error) < 1e-12
    assert float(found.modulus) == pytest.approx(1 / np.sqrt(3), rel=1e-12)


def test_a_regular_polygon_has_prevertices_at_equal_angles():
    angle = 2 * np.pi * np.arange(8) / 8
    found = solved(np.stack([np.cos(angle), np.sin(angle)], 1), (0, 2, 4, 6))
    assert float(found.error) < 1e-12
    np.testing.assert_allclose(np.diff(found.angle), np.pi / 4, atol=1e-12)
    assert float(found.modulus) == pytest.approx(1, rel=1e-12)
    # f' of a regular n-gon: (1 - z^n)^(-2/n), here along a ray, as a series.
    power, count = np.zeros(400), np.arange(400)
    power[0] = 1.0
    for k in count[1:]:
        power[k] = power[k - 1] * (0.25 + k - 1) / k
    radius = 0.6
    length = (power * radius ** (8 * count + 1) / (8 * count + 1)).sum()
    rim = gamma(1 / 8) * gamma(3 / 4) / gamma(1 / 8 + 3 / 4) / 8
    ray = np.exp(1j * float(found.angle[0]))
    got = np.asarray(jax.jit(conformal.disc_map)(found, jnp.array([radius * ray, 0.0])))
    assert abs(got[1]) < 1e-12
    assert abs(got[0]) == pytest.approx(length / rim, rel=1e-11)


def test_lines_cross_squarely_and_cells_keep_one_shape():
    """Cauchy-Riemann: |r_xi| is the modulus times |r_eta| everywhere, and both are square."""
    found = solved(QUAD, CORNERS)
    assert float(found.error) < 1e-12
    step = 1e-5
    xi, eta = np.array([0.3, 0.5, 0.8])[:, None], np.array([0.2, 0.6])[None]
    along_xi = np.asarray(mapped(found, xi + step, eta) - mapped(found, xi - step, eta))
    along_eta = np.asarray(mapped(found, xi, eta + step) - mapped(found, xi, eta - step))
    size_xi, size_eta = np.hypot(*along_xi.T), np.hypot(*along_eta.T)
    np.testing.assert_allclose(size_eta / size_xi, float(found.modulus), rtol=1e-7)
    assert np.abs((along_xi * along_eta).sum(-1).T / (size_xi * size_eta)).max() < 1e-7


def test_the_modulus_of_a_polygon_and_of_the_same_turned_are_reciprocal():
    found, turned = (solved(np.roll(QUAD, -k, axis=0), CORNERS) for k in (0, 1))
    assert float(found.modulus * turned.modulus) == pytest.approx(1, rel=1e-11)
    moved = solved(3 * QUAD @ np.array([[0.6, 0.8], [-0.8, 0.6]]) + [5, -7], CORNERS)
    np.testing.assert_allclose(moved.angle, found.angle, atol=1e-11)


def test_derivatives_in_the_vertices_are_those_of_central_differences():
    def value(vertices):
        found = conformal.solve(vertices, ELL_CORNERS)
        at = conformal.rectangle_map(found, jnp.array([0.3, 0.6]), jnp.array([0.4, 0.7]))
        return found.modulus + (at * jnp.array([[1.0, 0.5], [-0.3, 2.0]])).sum()

    gradient = jax.jit(jax.grad(value))(ELL)
    plain = jax.jit(value)
    random = np.random.default_rng(5)
    for _ in range(3):
        way = random.normal(size=ELL.shape)
        way = way / np.linalg.norm(way)
        step = 1e-4
        # The third-order error is taken off by a second step.
        slopes = [(plain(ELL + s * way) - plain(ELL - s * way)) / (2 * s) for s in (step, 2 * step)]
        slope = (4 * slopes[0] - slopes[1]) / 3
        assert abs(slope - (gradient * way).sum()) < 1e-6 * np.linalg.norm(gradient)


def test_a_chart_keeps_the_sides_and_lies_on_the_map():
    grid, error = conformal.chart(QUAD, CORNERS)
    assert error < 1e-12
    places = np.linspace(0, 1, 9)
    found = solved(QUAD, CORNERS)
    xi, eta = places[:, None], places[None]
    # Between its nodes too, off the corners, at which the map has no second derivative.
    shifted = evaluate(grid, xi[2:-2] + 0.003, eta[:, 2:-2] - 0.002)
    exact = mapped(found, xi[2:-2] + 0.003, eta[:, 2:-2] - 0.002)
    np.testing.assert_allclose(shifted, exact, atol=1e-5)
    corners = evaluate(grid, jnp.array([0.0, 1.0, 1.0, 0.0]), jnp.array([0.0, 0.0, 1.0, 1.0]))
    np.testing.assert_allclose(corners, QUAD, atol=1e-9)
    _, along = tangents(grid, jnp.asarray(places)[1:-1, None], jnp.asarray(places)[None, 1:-1])
    assert float(along.skew.max()) < 1e-3


def test_a_vertex_within_a_side_is_a_point_of_the_chart():
    grid, _ = conformal.chart(ELL, ELL_CORNERS)
    top = grid.sides.top
    reached = top(np.asarray(top.breaks))
    for vertex in ELL[3:5]:
        assert np.hypot(*(reached - vertex).T).min() < 1e-9
