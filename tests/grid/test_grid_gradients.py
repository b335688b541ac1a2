"""Derivatives through the elliptic solve, forward and reverse, against central differences."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import places, quick_jit

from fdjax.grid.algebraic import Spacings
from fdjax.grid.base import Sides
from fdjax.grid.elliptic import Elliptic
from fdjax.grid.solvers import Newton
from fdjax.grid.spacing import DensitySpacing
from fdjax.part.patch import cosine_top

RANDOM = np.random.default_rng(7)
WEIGHTS = RANDOM.normal(size=(11, 12, 2))
SIDES = Sides.of(cosine_top())
START = {
    "top": SIDES.top.coefficients,
    "log_density": RANDOM.uniform(-0.4, 0.4, size=(2, 6)),
    "phi": RANDOM.uniform(-1, 1, size=(7, 6)),
    "psi": RANDOM.uniform(-1, 1, size=(7, 6)),
    "p": RANDOM.uniform(-1e-3, 1e-3, size=(7, 6)),
    "q": np.array(4e-4),
}


def functional(given):
    """A weighted sum of points of an elliptic map, off its nodes."""
    top, (below, left) = replace(SIDES.top, coefficients=given["top"]), given["log_density"]
    grid, _ = Elliptic(
        SIDES._replace(top=top),
        Spacings(bottom=DensitySpacing.of(below), left=DensitySpacing.of(left)),
        given["phi"],
        given["psi"],
        given["p"],
        given["q"],
        nodes=(9, 8),
        follow_sides=True,
        solver=Newton(tolerance=1e-14),
    ).map()
    return (WEIGHTS * grid(*map(jnp.asarray, places(11, 12)))).sum()


def random_direction(name):
    """A random change of one kind of control alone, a tenth of its size."""
    change = {each: np.zeros_like(values) for each, values in START.items()}
    change[name] += 0.1 * np.abs(START[name]).max() * RANDOM.normal(size=START[name].shape)
    return change


@quick_jit
def differential(given, changes):
    """The value, its derivatives along many changes at once, and its gradient."""
    value, along = jax.linearize(functional, given)
    return value, jax.vmap(along)(changes), jax.linear_transpose(along, given)(1.0)[0]


def test_derivatives_match_central_differences():
    changes = jax.tree.map(lambda *each: np.stack(each), *map(random_direction, START))
    _, forward, gradient = differential(START, changes)
    step = 1e-5
    for k, name in enumerate(START):
        ahead, behind = (
            differential({each: START[each] + by * changes[each][k] for each in START}, changes)[0]
            for by in (step, -step)
        )
        difference = float(ahead - behind) / (2 * step)
        assert float(forward[k]) == pytest.approx(difference, rel=1e-6), name
        reverse = sum(np.vdot(gradient[each], changes[each][k]) for each in START)
        assert reverse == pytest.approx(difference, rel=1e-6), name
