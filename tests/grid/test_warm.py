"""Warm starts: from a neighbouring layer's lattice to the same grid, in fewer iterations."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import places, quick_jit, transfinite

from fdjax.errors import InputError
from fdjax.grid.algebraic import between_walls
from fdjax.grid.base import Sides
from fdjax.grid.continuation import Continuation
from fdjax.grid.elliptic import Elliptic
from fdjax.grid.solvers import SOR, Multigrid, Newton
from fdjax.part.patch import cosine_top

NODES = (33, 25)
SIDES = Sides.of(cosine_top())
SOLVERS = {
    "newton": Newton(1e-10),
    "multigrid": Multigrid(1e-10),
    "continuation": Continuation(Newton(1e-10)),
    "sor": SOR(tolerance=1e-10),
}


def layer(taller, solver=SOLVERS["newton"]):
    """The domain of eq. (8), taller by a share."""

    def moved(side):
        return replace(side, coefficients=side.coefficients * jnp.array([1.0, 1.0 + taller]))

    return Elliptic(Sides(*map(moved, SIDES)), phi=1.5, psi=-0.9, nodes=NODES, solver=solver)


@quick_jit
def cold_solve(grid):
    return grid.solve()


@quick_jit
def warm_solve(grid, start):
    return grid.solve(start)


def test_the_lattice_between_walls_is_transfinite_interpolation():
    lattice = transfinite(cosine_top(), (9, 7))
    spoilt = lattice.copy()
    spoilt[1:-1, 1:-1] = 0
    np.testing.assert_allclose(between_walls(jnp.asarray(spoilt)), lattice, atol=1e-12)
    xi, eta = places(9, 7)
    bilinear = np.stack([2 * xi - eta + 3 * xi * eta, 1 + xi + eta], -1)
    np.testing.assert_allclose(between_walls(jnp.asarray(bilinear)), bilinear, atol=1e-14)


@pytest.mark.parametrize("name", SOLVERS)
def test_a_neighbour_s_lattice_saves_iterations_and_changes_nothing(name):
    solver = SOLVERS[name]
    before, _ = cold_solve(layer(0.0, solver))
    saved = []
    for taller in (1e-3, 1e-2):
        grid = layer(taller, solver)
        cold, expected = cold_solve(grid)
        warm, report = warm_solve(grid, before)
        assert expected.converged
        assert report.converged
        # The same goal in millimetres, whatever the start.
        assert report.correction <= 1e-10
        assert report.history[0] == pytest.approx(taller, rel=0.5)
        np.testing.assert_allclose(warm, cold, atol=1e-6)
        np.testing.assert_array_equal(warm[:, [0, -1]], cold[:, [0, -1]])
        saved.append(int(expected.iterations - report.iterations))
    print(name, "saved of", int(expected.iterations), saved)
    assert saved[0] >= saved[1] >= 1


def test_the_same_grid_again_takes_no_iteration():
    grid = layer(0.0, Multigrid(1e-10))
    before, _ = cold_solve(grid)
    again, report = warm_solve(grid, before)
    assert report.iterations == 0
    assert report.converged
    np.testing.assert_allclose(again, before, atol=1e-11)


def test_the_derivative_is_that_of_a_cold_start():
    before = cold_solve(layer(0.0))[0]
    weight = np.random.default_rng(2).normal(size=before.shape)

    @quick_jit
    def slopes(taller):
        def of(start):
            return jax.grad(lambda t: (weight * layer(t).solve(start)[0]).sum())(taller)

        return of(None), of(before)

    cold, warm = slopes(0.01)
    assert float(warm) == pytest.approx(float(cold), rel=1e-6)


def test_a_start_of_another_shape_is_refused():
    with pytest.raises(InputError, match=r"start has shape \(9, 7, 2\); the nodes have \(33, 25"):
        layer(0.0).solve(jnp.zeros((9, 7, 2)))


def test_a_map_takes_a_start_too():
    before, _ = cold_solve(layer(0.0))

    @quick_jit
    def corner(start):
        grid, report = layer(0.01).map(start)
        return grid(jnp.ones(()), jnp.ones(())), report

    at, report = corner(before)
    np.testing.assert_allclose(at, layer(0.01).sides.top(jnp.ones(())), atol=1e-9)
    assert report.converged
