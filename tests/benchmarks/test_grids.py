"""Elliptic grids: how long they take (`pytest -m benchmark tests/benchmarks`), what is compiled."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grids import SOLVER, compilations, compiled, constant, many, transfinite, weighted, weights

from fdjax.grid.base import Sides
from fdjax.grid.elliptic import Elliptic, solve
from fdjax.grid.solvers import Multigrid, Newton
from fdjax.part.patch import cosine_top


def run(benchmark, function, *arguments):
    """Times a function that is compiled before."""
    program, _ = compiled(function, *arguments)
    jax.block_until_ready(program(*arguments))
    return benchmark(lambda: jax.block_until_ready(program(*arguments)))


@pytest.mark.benchmark
@pytest.mark.parametrize(
    "shape", [(51, 31), (257, 257)], ids=lambda shape: f"{shape[0]}x{shape[1]}"
)
def test_one_grid(benchmark, shape):
    _, report = run(benchmark, SOLVER.solve, transfinite(*shape), constant(*shape))
    assert report.converged


@pytest.mark.benchmark
def test_value_and_gradient(benchmark):
    side = 129
    function = jax.value_and_grad(weighted, argnums=(0, 1))
    problem = transfinite(side, side), constant(side, side, 0.03, -0.03), weights(side)
    _, slopes = run(benchmark, function, *problem)
    assert all(np.isfinite(slope).all() for slope in jax.tree.leaves(slopes))


@pytest.mark.benchmark
def test_many_grids(benchmark):
    _, report = run(benchmark, jax.vmap(SOLVER.solve), *many(32, 51))
    assert report.converged.all()


# --- what is compiled ---


@pytest.mark.parametrize("solver", [Newton(), Multigrid()], ids=["newton", "multigrid"])
def test_other_values_of_the_same_shapes_compile_once(solver):
    shape = (9, 8)
    run_once = jax.jit(lambda start, controls: solve(solver, start, controls))
    problems = [
        (scale * transfinite(*shape), constant(*shape, pull, -pull))
        for scale, pull in ((1.0, 0.0), (0.7, 0.03), (1.3, -0.05))
    ]
    before = compilations()
    found = [run_once(*problem)[0] for problem in problems]
    assert compilations() == before + 1
    assert all(np.isfinite(lattice).all() for lattice in jax.device_get(found))
    other = transfinite(8, 9), constant(8, 9)
    before = compilations()
    run_once(*other)
    assert compilations() == before + 1


def test_other_outlines_and_neighbours_compile_once():
    sides = Sides.of(cosine_top())

    def layer(taller):
        def moved(side):
            return replace(side, coefficients=side.coefficients * np.array([1.0, 1.0 + taller]))

        return Elliptic(Sides(*map(moved, sides)), phi=jnp.asarray(taller), nodes=(9, 8))

    step = eqx.filter_jit(lambda grid, start: grid.solve(start)[0])
    layers = [layer(taller) for taller in (0.0, 0.1, 0.2, 0.3)]
    nodes = transfinite(9, 8)
    before = compilations()
    for each in layers:
        nodes = step(each, nodes)
    assert compilations() == before + 1
