"""Multigrid for the elliptic grid equations and for their linearisation, forward and transposed.

Full approximation scheme (Brandt, Math. Comp. 31, 1977): zebra line relaxation twice along xi
before and once along eta after each coarse correction, and a start from the coarsest lattice
upwards. Everything is per index step of its own lattice; a residual changes by the product of the
steps' ratios, squared, from lattice to lattice.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fdjax.grid.operators import (
    GridEquations,
    Linearised,
    Transposed,
    derivative,
)
from fdjax.grid.transfer import (
    Pair,
    Plane,
    coarser,
    each,
    interior,
    prolonged,
    restricted,
    restricted_residual,
)

_COARSEST = 17
_MOST_LATTICES = 7
"""Coarser and more lattices bring nothing but time to compile: sweeps solve the last one."""
_SWEEPS_TO_START = 20


def _shape(u: Plane) -> tuple[int, int]:
    return u.shape[0], u.shape[1]


def _depth(shape: tuple[int, int], most: int = _MOST_LATTICES) -> int:
    coarse = coarser(shape[0]), coarser(shape[1])
    last = most == 1 or max(shape) <= _COARSEST or coarse == shape
    return 1 if last else 1 + _depth(coarse, most - 1)


def hierarchy(equations: GridEquations, shape: tuple[int, int]) -> list[GridEquations]:
    """The equations on all lattices, finest first; the finest has that shape."""
    levels = [equations]
    for _ in range(_depth(shape) - 1):
        levels.append(levels[-1].coarser(shape))
        shape = coarser(shape[0]), coarser(shape[1])
    return levels


def cycles(
    levels: Any,
    u: Pair,
    f: Pair | None,
    *,
    count: int = 1,
    visits: tuple[int, ...] = (2,),
    fresh: Any = False,
    linear: bool = False,
) -> Pair:
    """u after `count` multigrid cycles for N(u) = f, or = 0 without f.

    - `levels`: the operators on all lattices, finest first.
    - `fresh`: whether to begin with a solution on the next coarser lattice, found in the same way:
      a full-multigrid start, for f = 0 only. May be traced.
    - `linear`: for linear operators: coarse changes start from zero.
    - `visits`: how often a lattice visits the next coarser one in a cycle, finest first, 1 below:
      the coarsest ones cost more time than they bring.

    All visits of a lattice share one loop, so that each is compiled once.
    """
    operator, *rest = levels
    if not rest:
        enough = max(_shape(u[0])) ** 2 // 33
        sweeps = jnp.where(fresh, max(_SWEEPS_TO_START, enough), enough)
        return jax.lax.fori_loop(
            0, sweeps, lambda _, u: operator.relaxed(operator.relaxed(u, f, 0), f, 1), u
        )

    def visit(number: Any, u: Pair) -> Pair:
        starting = number == 0
        u = operator.relaxed(u, f, 0, sweeps=2)
        residual = each(restricted_residual, operator.residual(u, f))
        if linear:
            coarse, goal = each(jnp.zeros_like, residual), each(jnp.negative, residual)
        else:
            coarse = each(restricted, u)
            own = rest[0].residual(coarse)
            goal = each(lambda n, r: jnp.where(starting, 0.0, n - r), own, residual)
        found = cycles(
            rest,
            coarse,
            goal,
            count=(*visits, 1)[0],
            visits=visits[1:],
            fresh=starting,
            linear=linear,
        )
        change = each(lambda new, old: prolonged(new - old, _shape(u[0])), found, coarse)
        u = each(lambda v, d: v + interior(d), u, change)
        return operator.relaxed(u, f, 1)

    return jax.lax.fori_loop(jnp.where(fresh, 0, 1), 1 + count, visit, u)


def linear_levels(
    r: Pair, equations: GridEquations, operator: type[Linearised] | type[Transposed]
) -> list[Any]:
    """The equations linearised at the lattice r, on all lattices, or their transposes."""
    levels = []
    for level in hierarchy(equations, _shape(r[0])):
        levels.append(operator(derivative(r, level)))
        r = each(restricted, r)
    return levels


class _Search(NamedTuple):
    """State of `solve_linear`: `size` is the residual's, `images` those of the directions."""

    x: Pair
    residual: Pair
    directions: tuple[Array, Array]
    images: tuple[Array, Array]
    steps: Array
    size: Array


def solve_linear(
    levels: Any, rhs: Pair, *, tolerance: float = 1e-11, directions: int = 6, limit: int = 60
) -> Pair:
    """Solution of a linear system by generalised conjugate residuals, a cycle each direction.

    GCR (Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20, 1983), truncated to the last
    `directions`. Cycles only suggest directions: they run in single precision, at half the memory
    traffic, and as many steps are needed as in double. Stops when the residual is `tolerance` of
    the right side; where `limit` cycles do not bring it below the root of that, the result is NaN.
    """
    operator, rough = levels[0], jax.tree.map(lambda u: u.astype(jnp.float32), levels)
    zero = each(jnp.zeros_like, rhs)
    size = _norm(rhs)
    past = each(lambda u: jnp.zeros((directions, *u.shape)), rhs)

    def unfinished(state: _Search) -> Array:
        return (state.size > tolerance * size) & (state.steps < limit)

    def step(state: _Search) -> _Search:
        goal = each(lambda u: (u / state.size).astype(jnp.float32), state.residual)
        way = cycles(rough, each(jnp.zeros_like, goal), goal, linear=True)
        way = each(lambda u: u.astype(rhs[0].dtype), way)
        image = operator.residual(way)
        share = sum(
            (
                jnp.einsum("kij,ij->k", old, new)
                for old, new in zip(state.images, image, strict=True)
            ),
            jnp.zeros(()),
        )
        image = each(
            lambda new, old: new - jnp.einsum("k,kij->ij", share, old), image, state.images
        )
        way = each(
            lambda new, old: new - jnp.einsum("k,kij->ij", share, old), way, state.directions
        )
        length = _norm(image)
        scale = jnp.where(length > 0, 1 / jnp.where(length > 0, length, 1.0), 0.0)
        image, way = each(lambda u: u * scale, image), each(lambda u: u * scale, way)
        step = sum(
            ((a * b).sum() for a, b in zip(image, state.residual, strict=True)), jnp.zeros(())
        )
        x = each(lambda u, d: u + step * d, state.x, way)
        residual = each(lambda u, d: u - step * d, state.residual, image)
        place = state.steps % directions
        return _Search(
            x,
            residual,
            each(lambda old, new: old.at[place].set(new), state.directions, way),
            each(lambda old, new: old.at[place].set(new), state.images, image),
            state.steps + 1,
            _norm(residual),
        )

    found = jax.lax.while_loop(
        unfinished, step, _Search(zero, rhs, past, past, jnp.asarray(0), size)
    )
    failed = found.size > tolerance**0.5 * size
    return each(lambda u: jnp.where(failed, jnp.nan, u), found.x)


def _norm(u: Pair) -> Float[Array, ""]:
    return jnp.sqrt((u[0] ** 2).sum() + (u[1] ** 2).sum())
