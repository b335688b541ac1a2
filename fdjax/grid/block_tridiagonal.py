"""Direct solution of nine-point systems line by line: block-tridiagonal elimination.

The unknowns of one grid line form a block, so a lattice of n lines of m nodes costs O(n m^3)
operations and O(n m^2) memory: exact and robust up to a few hundred nodes a side.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import lu_factor, lu_solve
from jaxtyping import Array, Float

from fdjax.grid.operators import Stencil


class Factors(NamedTuple):
    """An eliminated system, good for any number of right sides and for its transpose."""

    lu: Float[Array, "n m m"]
    pivots: Array
    lower: Float[Array, "n m m"]
    upper: Float[Array, "n m m"]


def _lines(stencil: Stencil, closed: bool, tail: int) -> tuple[Array, Array, Array]:
    """Lower, diagonal and upper blocks, shape (i, 2 j, 2 j): each couples whole lines."""

    def block(row: tuple[Array, ...]) -> Array:
        below, on, above = row
        i, j = on.shape[:2]
        dense = jnp.zeros((i, j, 2, j, 2), on.dtype)
        at = jnp.arange(j)
        # Advanced indices apart put the indexed axis first, hence the swaps.
        dense = dense.at[:, at, :, at].set(on.swapaxes(0, 1))
        dense = dense.at[:, at[1:], :, at[:-1]].set(below[:, 1:].swapaxes(0, 1))
        dense = dense.at[:, at[:-1], :, at[1:]].set(above[:, :-1].swapaxes(0, 1))
        if closed:
            dense = dense.at[:, 0, :, -1].set(below[:, 0]).at[:, -1, :, 0].set(above[:, -1])
        return dense.reshape(i, 2 * j, 2 * j)

    lower, diagonal, upper = (block(row) for row in stencil.blocks)
    if tail:
        n = len(diagonal[0])
        turned = lower[0].reshape(n, -1, 2)[:, ::-1].reshape(n, n)
        upper = upper.at[0].add(turned)
        wall = slice(2 * (tail - 1), n - 2 * (tail - 1))
        upper = upper.at[0, wall].set(0.0)
        diagonal = diagonal.at[0, wall].set(jnp.eye(n)[wall])
    return lower, diagonal, upper


def factor(stencil: Stencil, *, closed: bool = False, tail: int = 0) -> Factors:
    """Eliminate the system of `stencil`; the lines run along the second axis.

    `closed`: the last node of a line is the neighbour of its first, as on a ring. `tail`: before
    the first line lies the second one turned round, as on a C-grid, see `Seam`; nodes of the first
    line on the hole's wall do not change.
    """
    lower, diagonal, upper = _lines(stencil, closed, tail)

    def step(above: Array, blocks: tuple[Array, Array, Array]) -> tuple[Array, tuple]:
        low, diag, up = blocks
        lu, pivots = lu_factor(diag - low @ above)
        reduced = lu_solve((lu, pivots), up)
        return reduced, (lu, pivots, reduced)

    _, (lu, pivots, reduced) = jax.lax.scan(
        step, jnp.zeros_like(upper[0]), (lower, diagonal, upper)
    )
    return Factors(lu, pivots, lower, reduced)


def solve(factors: Factors, rhs: Float[Array, "i j 2"]) -> Float[Array, "i j 2"]:
    """Solution of the system for one right side; linear in it."""
    lu, pivots, lower, upper = factors
    b = rhs.reshape(rhs.shape[0], -1)

    def down(y: Array, line: tuple) -> tuple[Array, Array]:
        lu, pivots, low, b = line
        y = lu_solve((lu, pivots), b - low @ y)
        return y, y

    def up(x: Array, line: tuple) -> tuple[Array, Array]:
        reduced, y = line
        x = y - reduced @ x
        return x, x

    _, y = jax.lax.scan(down, jnp.zeros_like(b[0]), (lu, pivots, lower, b))
    _, x = jax.lax.scan(up, jnp.zeros_like(b[0]), (upper, y), reverse=True)
    return x.reshape(rhs.shape)


def solve_transposed(factors: Factors, rhs: Float[Array, "i j 2"]) -> Float[Array, "i j 2"]:
    """Solution of the transposed system for one right side."""
    lu, pivots, lower, upper = factors
    b = rhs.reshape(rhs.shape[0], -1)

    def down(carry: Array, line: tuple) -> tuple[Array, Array]:
        reduced, b = line
        z = b - carry
        return reduced.T @ z, z

    def up(carry: Array, line: tuple) -> tuple[Array, Array]:
        lu, pivots, low, z = line
        x = lu_solve((lu, pivots), z - carry, trans=1)
        return low.T @ x, x

    _, z = jax.lax.scan(down, jnp.zeros_like(b[0]), (upper, b))
    _, x = jax.lax.scan(up, jnp.zeros_like(b[0]), (lu, pivots, lower, z), reverse=True)
    return x.reshape(rhs.shape)
