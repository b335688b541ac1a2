"""Continuation in the controls: where a cold start fails, and only there."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import circle, controls, quick_jit, solved, transfinite

from fdjax.grid import elliptic
from fdjax.grid.continuation import Continuation
from fdjax.grid.solvers import Newton
from fdjax.part.patch import cosine_top

SHAPE = (41, 31)
PLAIN = Newton(1e-10)
LED = Continuation(PLAIN)


def clustered(strength):
    """phi that draws lines to both walls xi = 0 and 1: steps there are a share of those inside."""
    side = np.sign(np.linspace(-1, 1, SHAPE[0])[1:-1, None])
    return controls(SHAPE, phi=strength * side)


def sources(strength):
    """P and Q of one sign each, `strength` over the area of the domain of eq. (8)."""
    start = transfinite(cosine_top(), SHAPE)
    area = np.prod(start[-1, -1] - start[0, 0])
    return controls(SHAPE, p=strength * (SHAPE[0] - 1) / area, q=-strength * (SHAPE[1] - 1) / area)


HARD = {
    "clustered": (circle, clustered(0.3)),
    "sources": (cosine_top, sources(1.0)),
    "strong sources": (cosine_top, sources(2.0)),
}


@pytest.mark.parametrize("case", HARD)
def test_controls_that_newton_fails_on_are_reached(case):
    domain, functions = HARD[case]
    start = transfinite(domain(), SHAPE)
    _, alone = solved(PLAIN, start, functions)
    assert not alone.converged
    lattice, report = solved(LED, start, functions)
    assert report.converged
    assert not report.folded
    assert report.iterations > alone.iterations
    # It solves the equations themselves: nothing is left for a warm start to do.
    _, again = solved(PLAIN, lattice, functions, True)
    assert again.converged
    assert again.iterations <= 1
    print(case, int(alone.iterations), int(report.iterations))


def test_nothing_is_added_where_a_cold_start_succeeds():
    start, functions = transfinite(cosine_top(), SHAPE), controls(SHAPE, 0.03, -0.03)
    alone, led = solved(PLAIN, start, functions), solved(LED, start, functions)
    for one, other in zip(jax.tree.leaves(led), jax.tree.leaves(alone), strict=True):
        np.testing.assert_array_equal(one, other)


def test_where_it_fails_too_the_first_result_is_told():
    # All shares above a third of these controls fold: there is no way to the whole.
    start, functions = transfinite(cosine_top(), SHAPE), controls(SHAPE, 0.4, -0.4)
    found, alone = solved(PLAIN, start, functions)
    lattice, report = solved(LED, start, functions)
    np.testing.assert_array_equal(lattice, found)
    assert not report.converged
    assert report.reason == alone.reason
    assert report.correction == alone.correction
    assert report.iterations > alone.iterations


def test_hard_and_easy_ones_together_are_solved_as_each_alone():
    start = jnp.asarray(transfinite(cosine_top(), SHAPE))
    all_functions = [controls(SHAPE), sources(1.0), controls(SHAPE, 0.4, -0.4)]
    starts = jnp.stack([start] * len(all_functions))
    functions = jax.tree.map(lambda *each: jnp.stack(each), *all_functions)
    together, reports = quick_jit(jax.vmap(LED.solve))(starts, functions)
    np.testing.assert_array_equal(reports.converged, [True, True, False])
    for k, each in enumerate(all_functions):
        alone, report = solved(LED, start, each)
        np.testing.assert_allclose(together[k], alone, atol=1e-7)
        assert reports.iterations[k] == report.iterations


def test_the_derivative_is_that_of_the_equations():
    start, functions = jnp.asarray(transfinite(cosine_top(), SHAPE)), sources(1.0)
    weight = np.random.default_rng(5).normal(size=start.shape)

    def value(strength):
        scaled = jax.tree.map(lambda field: strength * field, functions)
        return (weight * elliptic.solve(Continuation(Newton(1e-13)), start, scaled)[0]).sum()

    slope = quick_jit(jax.grad(value))(1.0)
    step, at = 1e-4, quick_jit(value)
    assert float(slope) == pytest.approx(float(at(1 + step) - at(1 - step)) / (2 * step), rel=1e-6)
