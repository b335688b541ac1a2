"""Lattices, domains and compiled calls that several tests of grids share.

Compiling costs far more than running here, so calls are compiled whole, with few optimisations,
and the tests share few shapes.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from shapely import Polygon

from fdjax.grid import elliptic, operators, transfer, winslow
from fdjax.grid.algebraic import Spacings, Transfinite
from fdjax.grid.base import Sides
from fdjax.grid.winslow import ControlFunctions
from fdjax.part.curve import arc
from fdjax.part.patch import from_curves, from_polygon

SHAPE = (17, 17)

quick_jit = partial(
    jax.jit,
    compiler_options={
        "xla_backend_optimization_level": 0,
        "xla_llvm_disable_expensive_passes": True,
    },
)
solved = quick_jit(elliptic.solve, static_argnums=(0, 3))


@quick_jit
def evaluate(function, *arguments):
    """The value of a map, a spacing or any callable pytree."""
    return function(*arguments)


@quick_jit
def mean_correction(lattice, functions):
    """Mean absolute Gauss-Seidel correction of a coordinate, mm."""
    return jnp.abs(winslow.correction(lattice, functions)).mean()


def linearised(lattice, functions):
    """The linearised equations as blocks."""
    equations = operators.equations_of(functions)
    return operators.stencil(operators.derivative(transfer.planes(lattice), equations))


def places(ni, nj):
    return np.linspace(0, 1, ni)[:, None], np.linspace(0, 1, nj)[None]


def controls(shape, phi=0.0, psi=0.0, p=0.0, q=0.0):
    """Control functions per index step from constants or arrays."""
    inside = (shape[0] - 2, shape[1] - 2)
    return ControlFunctions(
        *(np.broadcast_to(np.asarray(value, float), inside) for value in (phi, psi, p, q))
    )


def random_case(shape, seed):
    """A jittered unit lattice and random control functions."""
    random = np.random.default_rng(seed)
    lattice = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1)
    lattice = lattice + random.uniform(-0.3, 0.3, lattice.shape)
    inside = (shape[0] - 2, shape[1] - 2)
    return lattice, ControlFunctions(*random.normal(size=(4, *inside)))


def transfinite(patch, shape=SHAPE, spacings=None):
    grid = Transfinite(Sides.of(patch), spacings or Spacings())
    return np.array(evaluate(grid, *places(*shape)))


def bumped(lattice, size):
    """The lattice with its interior moved smoothly by up to `size`."""
    xi, eta = places(*lattice.shape[:2])
    bump = xi * (1 - xi) * eta * (1 - eta)
    return lattice + 16 * size * np.stack([bump * np.sin(2 * np.pi * eta), bump], -1)


def stretched(t, phi):
    """Solution of x'' + phi x' = 0 on [0, 1] with x(0) = 0, x(1) = 1."""
    return t if phi == 0 else np.expm1(-phi * t) / np.expm1(-phi)


def circle():
    """The circle of radius 1 cut into four quarters at 45 degrees."""
    h = np.sqrt(0.5)
    a, b, c, d = (-h, -h), (h, -h), (h, h), (-h, h)
    return from_curves(arc(a, (0, -1), b), arc(b, (1, 0), c), arc(d, (0, 1), c), arc(a, (-1, 0), d))


def chevron():
    """A non-convex polygon: its bottom has a peak, its top a valley."""
    ring = [(0, 0), (20, 12), (40, 0), (46, 26), (40, 40), (24, 27), (0, 44), (4, 20)]
    return from_polygon(Polygon(ring), corners=[(0, 0), (40, 0), (40, 40), (0, 44)])


def dense(stencil):
    """The matrix of a nine-point stencil of 2 x 2 blocks, entry by entry."""
    blocks = [[np.asarray(block) for block in row] for row in stencil.blocks]
    ni, nj = blocks[1][1].shape[:2]
    matrix = np.zeros((ni, nj, 2, ni, nj, 2))
    for i, j, di, dj in np.ndindex(ni, nj, 3, 3):
        k, m = i + di - 1, j + dj - 1
        if 0 <= k < ni and 0 <= m < nj:
            matrix[i, j, :, k, m] = blocks[di][dj][i, j]
    return matrix.reshape(2 * ni * nj, 2 * ni * nj)
