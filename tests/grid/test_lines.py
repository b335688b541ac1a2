"""Line systems: each way to eliminate them against NumPy; controls that are scalars."""

import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import controls, quick_jit, transfinite

from fdjax.grid import operators, winslow
from fdjax.grid.solvers import SOR, Multigrid, Newton
from fdjax.grid.winslow import ControlFunctions
from fdjax.part.patch import cosine_top

WAYS = (operators._overwritten, lambda s: operators._solved_one_by_one(s, 0))


@pytest.mark.parametrize("way", WAYS)
def test_every_way_eliminates_all_lines(way):
    random = np.random.default_rng(3)
    lower, upper = random.uniform(0.2, 1.0, (2, 9, 4))
    diagonal = lower + upper + random.uniform(0.1, 1.0, (9, 4))
    x, y = random.normal(size=(2, 9, 4))
    change = way(operators._Lines(*map(jnp.asarray, (lower, diagonal, upper)), (x, y)))
    for line in range(4):
        matrix = np.diag(diagonal[:, line])
        matrix -= np.diag(lower[1:, line], -1) + np.diag(upper[:-1, line], 1)
        for got, rhs in zip(change, (x, y), strict=True):
            np.testing.assert_allclose(got[:, line], np.linalg.solve(matrix, rhs[:, line]))


@pytest.mark.parametrize("solver", [Newton(1e-9), Multigrid(1e-9), SOR(tolerance=1e-9)])
def test_a_scalar_is_a_control_that_is_the_same_everywhere(solver):
    shape = (21, 17)
    start = jnp.asarray(transfinite(cosine_top(), shape))
    values = (0.03, -0.02, 1e-4, -2e-4)
    scalars = ControlFunctions(*map(jnp.asarray, values))
    solve = quick_jit(solver.solve)
    np.testing.assert_allclose(
        solve(start, scalars)[0], solve(start, controls(shape, *values))[0], atol=1e-9
    )
    np.testing.assert_allclose(
        winslow.residual(start, scalars), winslow.residual(start, controls(shape, *values))
    )
