"""Spacings: maps of [0, 1] onto itself, their closed forms and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import evaluate, quick_jit
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.grid.spacing import (
    DensitySpacing,
    GeometricSpacing,
    RobertsSpacing,
    UniformSpacing,
    fit_log_density,
    tanh_spacing,
)

T = np.linspace(0, 1, 201)
logs = st.lists(st.floats(-2.5, 2.5), min_size=8, max_size=8)
betas = st.floats(1e-4, 1e3).map(lambda excess: 1 + excess)
alphas = st.sampled_from([0.0, 0.5])


@quick_jit
def by_density(log_density, t):
    return DensitySpacing.of(log_density)(t)


def by_equation_1(beta, alpha, t=T):
    return np.asarray(evaluate(RobertsSpacing(np.asarray(beta), alpha), t))


def assert_onto(s):
    assert s[0] == pytest.approx(0, abs=1e-14)
    assert s[-1] == pytest.approx(1, abs=1e-14)
    assert (np.diff(s) > 0).all()


@given(log_density=logs)
@settings(max_examples=20, deadline=None)
def test_any_density_gives_a_rising_map(log_density):
    assert_onto(by_density(np.array(log_density), T))


@given(beta=betas, alpha=alphas)
@settings(max_examples=20, deadline=None)
def test_any_stretching_gives_a_rising_map(beta, alpha):
    assert_onto(by_equation_1(beta, alpha))


@given(beta=st.floats(1.01, 10), alpha=alphas)
@settings(max_examples=20, deadline=None)
def test_stretching_is_equation_1_as_printed(beta, alpha):
    power = ((beta + 1) / (beta - 1)) ** ((T - alpha) / (1 - alpha))
    printed = ((2 * alpha + beta) * power + 2 * alpha - beta) / ((2 * alpha + 1) * (1 + power))
    np.testing.assert_allclose(by_equation_1(beta, alpha), printed, atol=1e-13)


def test_stretching_by_hand():
    # R = 21, so s(1/2) = 1.1 (sqrt 21 - 1) / (sqrt 21 + 1).
    expected = 1.1 * (np.sqrt(21) - 1) / (np.sqrt(21) + 1)
    assert by_equation_1(1.1, 0.0)[100] == pytest.approx(expected, abs=1e-15)
    # R = 3; at t = 1/4, R^q = 1 / sqrt 3 and s = (sqrt 3 - 1)^2 sqrt 3 / 4; at t = 1/2, s = 1/2.
    expected = (np.sqrt(3) - 1) ** 2 * np.sqrt(3) / 4, 0.5
    np.testing.assert_allclose(by_equation_1(2.0, 0.5)[[50, 100]], expected, atol=1e-15)


@pytest.mark.parametrize("alpha", [0.0, 0.5])
def test_stretching_fades_with_large_beta_and_clusters_with_small(alpha):
    np.testing.assert_allclose(by_equation_1(1e8, alpha), T, atol=1e-15)
    steps = np.diff(by_equation_1(1.01, alpha))
    assert steps[-1] < 0.1 * steps.max()
    assert (steps[0] < 0.1 * steps.max()) == (alpha == 0.5)


@pytest.mark.parametrize("alpha", [0.25, 1.0])
def test_other_alphas_do_not_map_0_to_0_and_are_refused(alpha):
    with pytest.raises(ValueError, match=f"alpha is {alpha}"):
        RobertsSpacing(np.asarray(1.1), alpha)


@pytest.mark.parametrize("a", [-2.0, 0.7, 3.0])
def test_an_exponential_density_has_its_closed_form(a):
    # log rho = a s + const. is linear, so its coefficients are.
    log_density = 5.0 + a * (np.arange(8) - 1) / 5
    s, slope = slopes(log_density)
    np.testing.assert_allclose(s, np.log1p(T * np.expm1(a)) / a, atol=3e-8)
    exact = np.expm1(a) / a / (1 + T * np.expm1(a))
    np.testing.assert_allclose(slope, exact, rtol=2e-5)


@quick_jit
def slopes(log_density):
    return jax.jvp(DensitySpacing.of(log_density), (T,), (np.ones_like(T),))


def test_equal_coefficients_are_uniform():
    np.testing.assert_allclose(by_density(np.full(8, 700.0), T), T, atol=1e-15)
    np.testing.assert_array_equal(UniformSpacing()(T), T)


def test_too_few_coefficients_are_refused():
    with pytest.raises(ValueError, match="3 coefficients; at least 4"):
        DensitySpacing.of(np.zeros(3))


def test_a_density_fitted_to_samples_is_met():
    s = np.linspace(0, 1, 65)
    fitted = fit_log_density(2 * np.exp(0.7 * s), 8)
    exact = np.log1p(T * np.expm1(0.7)) / 0.7
    np.testing.assert_allclose(by_density(fitted, T), exact, atol=1e-9)


def test_derivatives_of_density_spacing_match_differences():
    random = np.random.default_rng(1)
    log_density, direction = random.normal(size=(2, 8))
    weights = random.normal(size=T.size)

    @quick_jit
    def derivatives(log_density):
        def moved(c):
            return DensitySpacing.of(c)(T)

        _, forward = jax.jvp(moved, (log_density,), (direction,))
        return forward, jax.grad(lambda c: weights @ moved(c))(log_density)

    forward, reverse = derivatives(log_density)
    ahead, behind = (by_density(log_density + step * direction, T) for step in (1e-5, -1e-5))
    np.testing.assert_allclose(forward, (ahead - behind) / 2e-5, atol=1e-9)
    assert reverse @ direction == pytest.approx(float(weights @ forward), rel=1e-12)


@pytest.mark.parametrize("alpha", [0.0, 0.5])
def test_tanh_is_eq_1_by_another_number(alpha):
    t = jnp.linspace(0, 1, 41)
    own = evaluate(tanh_spacing(jnp.arctanh(1 / 1.2), alpha), t)
    np.testing.assert_allclose(own, evaluate(RobertsSpacing(jnp.asarray(1.2), alpha), t))
    np.testing.assert_allclose(evaluate(tanh_spacing(jnp.asarray(1e-4), alpha), t), t, atol=1e-8)


@pytest.mark.parametrize("growth", [-3.0, -1e-7, 0.0, 1e-7, 1e-5, 2.0])
def test_steps_of_a_geometric_spacing_grow_by_one_ratio(growth):
    s = np.asarray(evaluate(GeometricSpacing(jnp.asarray(growth)), jnp.linspace(0, 1, 11)))
    assert s[[0, -1]] == pytest.approx([0, 1], abs=1e-15)
    steps = np.diff(s)
    np.testing.assert_allclose(steps[1:] / steps[:-1], np.exp(growth / 10), rtol=1e-9)


@pytest.mark.parametrize("kind", [tanh_spacing, GeometricSpacing])
def test_stretchings_are_derived_in_their_strength(kind):
    t = jnp.linspace(0, 1, 9)
    for strength in (0.7, 2.0):
        slope = jax.jacfwd(lambda each: kind(each)(t))(jnp.asarray(strength))
        ahead, behind = (kind(jnp.asarray(strength + step))(t) for step in (1e-6, -1e-6))
        np.testing.assert_allclose(slope, (ahead - behind) / 2e-6, atol=1e-9)


def test_a_geometric_spacing_is_derived_where_it_is_even():
    slope = jax.grad(lambda growth: GeometricSpacing(growth)(jnp.asarray(0.25)))(0.0)
    assert float(slope) == pytest.approx(-0.25 * 0.75 / 2)
