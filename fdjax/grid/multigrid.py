"""Multigrid for the elliptic grid equations and for their linearisation, forward and transposed.

Full approximation scheme (Brandt, Math. Comp. 31, 1977): zebra line relaxation once along eta
before and twice along xi after each coarse correction, and a start from the coarsest lattice
upwards. Everything is per index step of its own lattice; a residual changes by the product of the
steps' ratios, squared, from lattice to lattice.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fdjax.grid import block_tridiagonal
from fdjax.grid.operators import (
    AbstractLinear,
    AbstractOperator,
    GridEquations,
    Transposed,
    stencil,
)
from fdjax.grid.transfer import (
    Pair,
    each,
    halved,
    interior,
    planes,
    points,
    prolonged,
    restricted,
    restricted_residual,
    walled,
)

Shape = tuple[int, int]

_COARSEST = 17
_SWEEPS_TO_START = 20
_STEPWISE = 2
"""So many lattices are halved once, coarser ones twice: more bring nothing but time to compile."""

_MANY = 5
"""Lattices from which on it is worth the time that the second one, too, visits the next twice."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Level:
    """An operator on one lattice of a hierarchy."""

    operator: AbstractOperator
    shape: Shape = field(metadata={"static": True})

    def solved(self, u: Pair, f: Pair | None, fresh: Any) -> Pair:
        """u after many relaxations, for the coarsest lattice."""
        enough = max(self.shape) ** 2 // 33
        sweeps = jnp.where(fresh, max(_SWEEPS_TO_START, enough), enough)

        def sweep(_: Any, u: Pair) -> Pair:
            return self.operator.relaxed(self.operator.relaxed(u, f, 0), f, 1)

        return jax.lax.fori_loop(0, sweeps, sweep, u)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Eliminated:
    """The coarsest lattice of a linear hierarchy, eliminated once for all visits."""

    factors: block_tridiagonal.Factors
    shape: Shape = field(metadata={"static": True})
    transposed: bool = field(metadata={"static": True})

    def solved(self, u: Pair, f: Pair, fresh: Any) -> Pair:
        """The solution, whatever u."""
        solve = block_tridiagonal.solve_transposed if self.transposed else block_tridiagonal.solve
        return planes(walled(solve(self.factors, points(f)[1:-1, 1:-1])))


def _lattices(shape: Shape, last: Callable[[Shape], bool]) -> list[Shape]:
    """The lattices of a hierarchy, finest first, down to the last."""
    shapes = [shape]
    while not last(shape):
        for _ in range(1 if len(shapes) <= _STEPWISE else 2):
            shape = shape if last(shape) else halved(shape)
        if shape == shapes[-1]:
            break
        shapes.append(shape)
    return shapes


def _hierarchy(operator: Any, shapes: Sequence[Shape]) -> list[Any]:
    levels = [Level(operator, shapes[0])]
    for shape in shapes[1:]:
        finer = levels[-1]
        levels.append(Level(finer.operator.coarser(finer.shape, shape), shape))
    return levels


def hierarchy(equations: GridEquations, shape: Shape) -> list[Level]:
    """The equations on all lattices, finest first; the finest has that shape."""
    return _hierarchy(equations, _lattices(shape, lambda shape: max(shape) <= _COARSEST))


def cycles(
    levels: Sequence[Any],
    u: Pair,
    f: Pair | None,
    *,
    count: int = 1,
    visits: tuple[int, ...] | None = None,
    fresh: Any = False,
) -> Pair:
    """u after `count` multigrid cycles for N(u) = f, or = 0 without f.

    - `levels`: a hierarchy, finest first.
    - `visits`: how often a lattice visits the next coarser one in a cycle, finest first, 1 below;
      by default twice from the finest, and in large hierarchies from the second.
    - `fresh`: whether to begin with a solution on the next coarser lattice, found in the same way:
      a full-multigrid start, for f = 0 only. May be traced.

    For linear operators coarse changes start from zero. All visits of a lattice share one loop, so
    that each is compiled once.
    """
    level, *rest = levels
    if not rest:
        return level.solved(u, f, fresh)
    if visits is None:
        visits = (2, 2) if len(levels) >= _MANY else (2,)
    operator, shape, coarse_shape = level.operator, level.shape, rest[0].shape

    def visit(number: Any, u: Pair) -> Pair:
        starting = number == 0
        u = operator.relaxed(u, f, 1)
        residual = each(lambda v: restricted_residual(v, coarse_shape), operator.residual(u, f))
        if isinstance(operator, AbstractLinear):
            coarse, goal = each(jnp.zeros_like, residual), each(jnp.negative, residual)
        else:
            coarse = each(lambda v: restricted(v, coarse_shape), u)
            own = rest[0].operator.residual(coarse)
            goal = each(lambda n, r: jnp.where(starting, 0.0, n - r), own, residual)
        found = cycles(rest, coarse, goal, count=(*visits, 1)[0], visits=visits[1:], fresh=starting)
        change = each(lambda new, old: prolonged(new - old, shape), found, coarse)
        u = each(lambda v, d: v + interior(d), u, change)
        return operator.relaxed(u, f, 0, sweeps=2)

    return jax.lax.fori_loop(jnp.where(fresh, 0, 1), 1 + count, visit, u)


def linear_levels(operator: AbstractLinear) -> list[Any]:
    """A hierarchy in single precision, of which the coarsest lattice is eliminated.

    It is the finest that is eliminated in about the time that one relaxation of the finest takes.
    """
    ni, nj = operator.terms[0].shape
    shapes = _lattices((ni, nj), lambda shape: shape[0] * shape[1] ** 3 <= 20 * ni * nj)
    *levels, last = _hierarchy(jax.tree.map(lambda u: u.astype(jnp.float32), operator), shapes)
    factors = block_tridiagonal.factor(stencil(last.operator.terms))
    return [*levels, Eliminated(factors, last.shape, isinstance(operator, Transposed))]


class _Search(NamedTuple):
    """State of `solve_linear`: directions, their images and the squares of the images' lengths.

    `size` is the length of the residual.
    """

    x: Pair
    residual: Pair
    directions: tuple[Array, Array]
    images: tuple[Array, Array]
    squares: Array
    steps: Array
    size: Array


def solve_linear(
    operator: AbstractLinear,
    levels: Sequence[Any],
    rhs: Pair,
    *,
    tolerance: float = 1e-11,
    directions: int = 6,
    limit: int = 60,
) -> Pair:
    """Solution of a linear system by generalised conjugate residuals, a cycle each direction.

    GCR (Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20, 1983), truncated to the last
    `directions`. Cycles over the operator's `linear_levels` only suggest directions: in single
    precision, at half the memory traffic, as many steps are needed as in double. Stops when the
    residual is `tolerance` of the right side; where `limit` cycles do not bring it below the root
    of that, the result is NaN.
    """
    zero = each(jnp.zeros_like, rhs)
    size = jnp.sqrt(_inner(rhs, rhs))
    past = each(lambda u: jnp.zeros((directions, *u.shape)), rhs)

    def unfinished(state: _Search) -> Array:
        return (state.size > tolerance * size) & (state.steps < limit)

    def step(state: _Search) -> _Search:
        goal = each(lambda u: (u / state.size).astype(jnp.float32), state.residual)
        way = cycles(levels, each(jnp.zeros_like, goal), goal, visits=(2,))
        way = each(lambda u: u.astype(rhs[0].dtype), way)
        image = operator.residual(way)
        shares = each(lambda old, new: jnp.einsum("kij,ij->k", old, new), state.images, image)
        share = (shares[0] + shares[1]) / state.squares

        def less(new: Array, old: Array) -> Array:
            return new - jnp.einsum("k,kij->ij", share, old)

        image, way = each(less, image, state.images), each(less, way, state.directions)
        square = _inner(image, image)
        square = jnp.where(square > 0, square, 1.0)
        length = _inner(image, state.residual) / square
        x = each(lambda u, d: u + length * d, state.x, way)
        residual = each(lambda u, d: u - length * d, state.residual, image)
        place = state.steps % directions
        return _Search(
            x,
            residual,
            each(lambda old, new: old.at[place].set(new), state.directions, way),
            each(lambda old, new: old.at[place].set(new), state.images, image),
            state.squares.at[place].set(square),
            state.steps + 1,
            jnp.sqrt(_inner(residual, residual)),
        )

    state = _Search(zero, rhs, past, past, jnp.ones(directions), jnp.asarray(0), size)
    found = jax.lax.while_loop(unfinished, step, state)
    failed = found.size > tolerance**0.5 * size
    return each(lambda u: jnp.where(failed, jnp.nan, u), found.x)


def _inner(u: Pair, v: Pair) -> Float[Array, ""]:
    return (u[0] * v[0]).sum() + (u[1] * v[1]).sum()
