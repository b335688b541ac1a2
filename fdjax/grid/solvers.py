"""Solvers of the elliptic grid equations: values that are passed in, one interface.

A solver takes the starting lattice, whose boundary nodes stay, and the controls, and returns the
lattice with a `Report`. How it gets there does not matter to the derivative, which `elliptic`
takes from the equations themselves.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from fdjax.grid import block_tridiagonal, winslow
from fdjax.grid.winslow import ControlFunctions


class Report(NamedTuple):
    """How a solve went.

    - `correction`: mean Gauss-Seidel correction at the end over that of the starting lattice.
    - `folded`: whether a cell of the result has a corner that is not convex.
    """

    iterations: Int[Array, ""]
    correction: Float[Array, ""]
    converged: Bool[Array, ""]
    folded: Bool[Array, ""]


class AbstractSolver(ABC):
    """Static, hashable settings and the method that uses them."""

    @abstractmethod
    def solve(
        self, start: Float[Array, "ni nj 2"], controls: ControlFunctions
    ) -> tuple[Float[Array, "ni nj 2"], Report]: ...


def _goal(start: Float[Array, "ni nj 2"], first: Float[Array, ""], tolerance: float) -> Array:
    """The mean correction to reach, mm: as asked, but not below what rounding leaves."""
    return jnp.maximum(tolerance * first, 8 * jnp.finfo(start.dtype).eps * jnp.abs(start).max())


def _folded(r: Float[Array, "ni nj 2"]) -> Bool[Array, ""]:
    return winslow.corner_jacobians(r).min() <= 0


@dataclass(frozen=True)
class Newton(AbstractSolver):
    """Newton's method with exact elimination and a step that is cut back.

    A step is halved until it lowers the mean correction and, once the lattice is unfolded, keeps
    it so. Stops when the mean correction is below `tolerance` times that of the starting lattice,
    or as small as rounding lets it be. From an unfolded start, where controls are so strong that
    the solution itself is folded, it stops short of it: unfolded and unconverged.
    """

    tolerance: float = 1e-10
    max_steps: int = 40
    halvings: int = 12

    def solve(
        self, start: Float[Array, "ni nj 2"], controls: ControlFunctions
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        first = winslow.mean_correction(start, controls)
        goal = _goal(start, first, self.tolerance)

        def unfinished(state: tuple) -> Array:
            _, size, steps, stuck = state
            return (size > goal) & (steps < self.max_steps) & ~stuck

        def step(state: tuple) -> tuple:
            r, size, steps, _ = state
            rhs = -winslow.residual(r, controls)
            change = block_tridiagonal.solve(
                block_tridiagonal.factor(winslow.linearise(r, controls)), rhs
            )
            change = jnp.pad(change, ((1, 1), (1, 1), (0, 0)))
            keep_unfolded = ~_folded(r)

            def good(trial: tuple) -> Array:
                _, r_new, size_new = trial
                return (size_new < size) & ~(keep_unfolded & _folded(r_new))

            def refused(trial: tuple) -> Array:
                return ~good(trial) & (trial[0] > 0.5**self.halvings)

            def shorter(trial: tuple) -> tuple:
                share = trial[0] / 2
                r_new = r + share * change
                return share, r_new, winslow.mean_correction(r_new, controls)

            trial = jax.lax.while_loop(
                refused, shorter, shorter((jnp.asarray(2.0, r.dtype), r, size))
            )
            better, (_, r_new, size_new) = good(trial), trial
            r, size = jnp.where(better, r_new, r), jnp.where(better, size_new, size)
            return r, size, steps + 1, ~better

        state = (start, first, jnp.asarray(0), jnp.asarray(False))
        r, size, steps, _ = jax.lax.while_loop(unfinished, step, state)
        scale = jnp.where(first > 0, first, 1.0)
        return r, Report(steps, size / scale, size <= goal, _folded(r))


@dataclass(frozen=True)
class SOR(AbstractSolver):
    """The paper's own solver, eq. (6): lexicographic point successive over-relaxation.

    Sweeps run with rising xi within rising eta and use new values at once. Stops when the mean
    Gauss-Seidel correction met during a sweep is at most `tolerance` times that on the starting
    lattice (the paper: w = 1.8, 0.1 %), or as small as rounding lets it be. A small correction is
    not a small error: see `figure6` among the examples.
    """

    omega: float = 1.8
    tolerance: float = 1e-3
    max_sweeps: int = 100_000

    def solve(
        self, start: Float[Array, "ni nj 2"], controls: ControlFunctions
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        ni, nj = start.shape[:2]
        first = winslow.mean_correction(start, controls)
        goal = _goal(start, first, self.tolerance)

        def relax_node(k: Array, state: tuple) -> tuple:
            r, met = state
            i, j = k % (ni - 2), k // (ni - 2)
            around = jax.lax.dynamic_slice(r, (i, j, jnp.zeros_like(i)), (3, 3, 2))
            here = ControlFunctions(*(jax.lax.dynamic_slice(f, (i, j), (1, 1)) for f in controls))
            change = winslow.correction(around, here)
            r = jax.lax.dynamic_update_slice(
                r, around[1:2, 1:2] + self.omega * change, (i + 1, j + 1, jnp.zeros_like(i))
            )
            return r, met + jnp.abs(change).mean()

        def sweep(state: tuple) -> tuple:
            r, _, sweeps = state
            count = (ni - 2) * (nj - 2)
            r, met = jax.lax.fori_loop(0, count, relax_node, (r, jnp.zeros((), r.dtype)))
            return r, met / count, sweeps + 1

        def unfinished(state: tuple) -> Array:
            _, size, sweeps = state
            return (size > goal) & (sweeps < self.max_sweeps)

        r, size, sweeps = jax.lax.while_loop(unfinished, sweep, (start, first, jnp.asarray(0)))
        scale = jnp.where(first > 0, first, 1.0)
        return r, Report(sweeps, size / scale, size <= goal, _folded(r))
