"""Block elimination against dense linear algebra."""

import jax
import numpy as np
import pytest
from grid_samples import dense, linearised, quick_jit, random_case

from fdjax.grid import block_tridiagonal


@quick_jit
def solutions(lattice, functions, rhs):
    stencil = linearised(lattice, functions)
    factors = block_tridiagonal.factor(stencil)
    several = jax.vmap(lambda b: block_tridiagonal.solve(factors, b))(rhs)
    return stencil, several, block_tridiagonal.solve_transposed(factors, rhs[0])


@pytest.mark.parametrize("shape", [(8, 5), (4, 9)])
def test_solutions_match_dense_ones(shape):
    rhs = np.random.default_rng(2).normal(size=(3, shape[0] - 2, shape[1] - 2, 2))
    stencil, several, transposed = solutions(*random_case(shape, 1), rhs)
    matrix, flat = dense(stencil), rhs.reshape(3, -1)
    scale = np.linalg.cond(matrix) * 1e-14
    for got, expected in (
        (several, np.linalg.solve(matrix, flat.T).T.reshape(rhs.shape)),
        (transposed, np.linalg.solve(matrix.T, flat[0]).reshape(rhs[0].shape)),
    ):
        np.testing.assert_allclose(got, expected, atol=scale * np.abs(expected).max())
