"""Cubic B-splines: what they reproduce, and that their forms agree."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import places, quick_jit

from fdjax.grid import bspline

CUBIC = np.polynomial.Polynomial([0.3, -1.2, 2.0, 1.7])
field = quick_jit(bspline.field)


def bicubic(xi, eta):
    return CUBIC(xi) * (1 - eta + 2 * eta**3) + xi**2 * eta


def test_the_field_reproduces_a_bicubic_everywhere():
    values = bicubic(*places(7, 6))
    coefficients = bspline.interpolation(7) @ values @ bspline.interpolation(6).T
    xi, eta = np.random.default_rng(1).uniform(size=(2, 50))
    np.testing.assert_allclose(field(coefficients, xi, eta), bicubic(xi, eta), atol=1e-13)


def test_lattice_points_and_components_agree():
    coefficients = np.random.default_rng(2).normal(size=(6, 5, 2))
    xi, eta = places(9, 7)
    on_lattice = field(coefficients, xi, eta)
    at_points = field(coefficients, *np.broadcast_arrays(xi, eta))
    assert on_lattice.shape == at_points.shape == (9, 7, 2)
    np.testing.assert_allclose(on_lattice, at_points, atol=1e-14)
    second = field(coefficients[..., 1], xi, eta)
    np.testing.assert_allclose(on_lattice[..., 1], second, atol=1e-14)


@pytest.mark.parametrize("count", [4, 5, 9])
def test_the_basis_is_a_partition_of_one_with_linear_precision(count):
    t = np.linspace(0, 1, 33)
    basis = bspline.basis(t, count)
    assert (basis >= 0).all()
    assert ((basis > 0).sum(1) <= 4).all()
    np.testing.assert_allclose(basis.sum(1), 1, atol=1e-14)
    np.testing.assert_allclose(basis @ ((np.arange(count) - 1) / (count - 3)), t, atol=1e-14)


def test_basis_and_field_are_the_same_splines():
    coefficients = np.random.default_rng(3).normal(size=8)
    t = np.linspace(0, 1, 50)
    constant_in_eta = np.repeat(coefficients[:, None], 4, 1)
    got = field(constant_in_eta, t, np.full(50, 0.3))
    np.testing.assert_allclose(bspline.basis(t, 8) @ coefficients, got, atol=1e-14)


@pytest.mark.parametrize("nodes", [4, 5, 11])
def test_interpolation_meets_its_nodes_and_reproduces_cubics(nodes):
    t, values = np.linspace(0, 1, nodes), np.random.default_rng(4).normal(size=nodes)
    through = bspline.interpolation(nodes)
    at_nodes = bspline.basis(t, nodes + 2) @ through
    np.testing.assert_allclose(at_nodes @ values, values, atol=1e-12)
    between = np.linspace(0, 1, 29)
    at_between = bspline.basis(between, nodes + 2) @ through
    np.testing.assert_allclose(at_between @ CUBIC(t), CUBIC(between), atol=1e-12)


def test_the_second_derivative_is_continuous_across_a_knot():
    coefficients = jnp.asarray(np.random.default_rng(5).normal(size=(7, 4)))

    def along(t):
        return bspline.field(coefficients, t, jnp.asarray(0.4))

    bend = quick_jit(jax.vmap(jax.grad(jax.grad(along))))
    below, at, above = bend(np.array([0.5 - 1e-9, 0.5, 0.5 + 1e-9]))
    np.testing.assert_allclose([below, above], at, atol=1e-4)


def test_slopes_at_places_one_by_one_are_those_of_the_lattice():
    rng = np.random.default_rng(5)
    coefficients, change = jnp.asarray(rng.normal(size=(2, 6, 7)))
    xi, eta = (jnp.asarray(each) for each in rng.uniform(size=(2, 1)))

    def single(coefficients, xi, eta):
        return bspline.field(coefficients, xi, eta)[0]

    def product(coefficients, xi, eta):
        along = bspline.dense(xi, 6)[0], bspline.dense(eta, 7)[0]
        return along[0] @ coefficients @ along[1]

    for slope in (jax.grad, jax.jacfwd):
        got, expected = (slope(of, 1)(coefficients, xi, eta) for of in (single, product))
        np.testing.assert_allclose(got, expected, rtol=1e-12)
    second, other = (
        jax.jit(jax.jacfwd(jax.grad(of, 1), 2))(coefficients, xi, eta) for of in (single, product)
    )
    np.testing.assert_allclose(second, other, rtol=1e-11)
    moved = jax.jvp(lambda c: single(c, xi, eta), (coefficients,), (change,))[1]
    np.testing.assert_allclose(moved, product(change, xi, eta), rtol=1e-12)


def test_a_curve_is_the_basis_times_its_coefficients():
    rng = np.random.default_rng(6)
    coefficients, t = jnp.asarray(rng.normal(size=(7, 2))), jnp.asarray(rng.uniform(size=9))
    expected = bspline.basis(np.asarray(t), 7) @ np.asarray(coefficients)
    np.testing.assert_allclose(bspline.curve(coefficients, t), expected, atol=1e-13)
    _, slope = jax.jvp(lambda t: bspline.curve(coefficients, t), (t,), (jnp.ones(9),))
    h = 1e-6
    near = [bspline.curve(coefficients, t + s) for s in (h, -h)]
    np.testing.assert_allclose(slope, (near[0] - near[1]) / (2 * h), rtol=1e-6, atol=1e-6)
