"""Solvers of the elliptic grid equations: values that are passed in, one interface.

A solver takes the starting lattice, whose boundary nodes stay, and the controls, and returns the
lattice with a `Report`. How it gets there does not matter to the derivative, which `elliptic`
takes from the equations themselves.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from fdjax.grid import batches, block_tridiagonal, multigrid, operators, winslow
from fdjax.grid.operators import GridEquations
from fdjax.grid.seam import OPEN, Seam
from fdjax.grid.transfer import Pair, each, planes, points, walled
from fdjax.grid.winslow import ControlFunctions

CONVERGED, STALLED, TOO_LONG = 0, 1, 2
REASONS = (
    "converged",
    "no step of any length lowers the correction any more",
    "as many iterations as are allowed",
)
"""Why a solver stopped, by `Report.reason`."""

HISTORY = 64
"""Iterations that a report remembers."""


class Report(NamedTuple):
    """How a solve went.

    - `correction`: mean Gauss-Seidel correction at the end over that of the starting lattice, or,
      where the start was warm, over that of the transfinite lattice.
    - `folded`: whether a cell of the result has a corner that is not convex: a grid may converge
      to a folded one.
    - `reason`: index into `REASONS`.
    - `history`: the correction before and after each of the first iterations, then NaN.
    """

    iterations: Int[Array, ""]
    correction: Float[Array, ""]
    converged: Bool[Array, ""]
    folded: Bool[Array, ""]
    reason: Int[Array, ""]
    history: Float[Array, " HISTORY"]

    @classmethod
    def of(
        cls,
        r: Float[Array, "ni nj 2"],
        progress: "_Progress",
        unit: Array,
        goal: Array,
        limit: int,
    ) -> "Report":
        size, steps, _, history = progress
        first = jnp.where(unit > 0, unit, 1.0)
        converged = size <= goal
        reason = jnp.where(steps >= limit, TOO_LONG, STALLED)
        reason = jnp.where(converged, CONVERGED, reason)
        return cls(
            steps,
            size / first,
            converged,
            operators.folded(planes(r)),
            reason,
            history / first,
        )


class _Progress(NamedTuple):
    """Mean correction now, mm; iterations; whether none helps any more; corrections so far."""

    size: Float[Array, "*lanes"]
    steps: Int[Array, "*lanes"]
    stuck: Bool[Array, "*lanes"]
    history: Float[Array, "HISTORY ..."]

    @classmethod
    def begun(cls, size: Float[Array, ""]) -> "_Progress":
        history = jnp.full(HISTORY, jnp.nan).at[0].set(size)
        return cls(size, jnp.asarray(0), jnp.asarray(False), history)

    def after(self, size: Float[Array, ""], stuck: Array | bool = False) -> "_Progress":
        steps = self.steps + 1
        here = jnp.arange(HISTORY).reshape(-1, *[1] * steps.ndim) == steps
        history = jnp.where(here, size, self.history)
        return _Progress(size, steps, jnp.asarray(stuck), history)

    def unfinished(self, goal: Array, limit: int) -> Bool[Array, "*lanes"]:
        return (self.size > goal) & (self.steps < limit) & ~self.stuck


class AbstractSolver(ABC):
    """Static, hashable settings and the method that uses them.

    - `tolerance`: what the mean correction has to come down to, of that of the starting lattice.
    - `seam`: how lattices are sewn to themselves.
    """

    tolerance: float

    @property
    def seam(self) -> Seam:
        return OPEN

    @abstractmethod
    def solve(
        self,
        start: Float[Array, "ni nj 2"],
        controls: ControlFunctions,
        warm: Bool[Array, ""] | bool = False,
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        """The solved lattice and how it went.

        `warm`: whether the start is near the solution, and is to be made use of. `tolerance` then
        is of the mean correction of the transfinite lattice, which a cold start would have.
        """


def _measured(
    start: Float[Array, "ni nj 2"],
    controls: ControlFunctions,
    tolerance: float,
    warm: Bool[Array, ""] | bool,
    seam: Seam = OPEN,
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Mean correction of the start, the one that `tolerance` is of, and the one to reach, mm.

    The last is as asked, but not below what rounding leaves.
    """
    equations = operators.equations_of(controls)
    first = unit = seam.mean_correction(equations, planes(start))
    if warm is not False:
        cold = seam.mean_correction(equations, planes(seam.cold(start)))
        unit = jnp.where(warm, cold, first)
    least = 8 * jnp.finfo(start.dtype).eps * jnp.abs(start).max()
    return first, unit, jnp.maximum(tolerance * unit, least)


@dataclass(frozen=True)
class Newton(AbstractSolver):
    """Newton's method with exact elimination and a step that is cut back.

    A step is halved until it lowers the mean correction and, once the lattice is unfolded, keeps
    it so. Stops when the mean correction is below `tolerance` times that of the starting lattice,
    or as small as rounding lets it be. From an unfolded start, where controls are so strong that
    the solution itself is folded, it stops short of it: unfolded and unconverged.

    - `closed`, `tail`: as of `Seam`.
    """

    tolerance: float = 1e-10
    max_steps: int = 40
    halvings: int = 12
    closed: bool = False
    tail: int = 0

    @property
    def seam(self) -> Seam:
        return Seam(self.closed, self.tail)

    def solve(
        self,
        start: Float[Array, "ni nj 2"],
        controls: ControlFunctions,
        warm: Bool[Array, ""] | bool = False,
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        seam = self.seam
        first, unit, goal = _measured(start, controls, self.tolerance, warm, seam)
        equations = operators.equations_of(controls)

        def step(state: tuple) -> tuple:
            r, progress = state
            rhs = seam.free(planes(-walled(winslow.residual(r, controls))))
            terms = operators.derivative(planes(r), equations)
            factors = seam.factor(operators.stencil(terms))
            change = block_tridiagonal.solve(factors, points(rhs)[1:-1, 1:-1])
            trial = seam.whole(r + walled(change))
            cut, size, better = _cut_back(
                planes(r),
                planes(trial),
                progress.size,
                equations,
                self.halvings,
                seam=seam,
            )
            return points(cut), progress.after(size, ~better)

        r, progress = _iterate(step, start, first, goal, self.max_steps)
        return r, Report.of(points(seam.own(planes(r))), progress, unit, goal, self.max_steps)


def _iterate(
    step: Callable[[tuple], tuple], start: Any, first: Array, goal: Array, limit: int
) -> tuple[Any, "_Progress"]:
    """Steps from a lattice, however it is kept, until `goal` mm, `limit` steps or no way on."""
    return jax.lax.while_loop(
        lambda state: state[1].unfinished(goal, limit), step, (start, _Progress.begun(first))
    )


class _Trial(NamedTuple):
    """A share of the way to a new lattice, and how good the lattice there is."""

    share: Array
    size: Float[Array, "*lanes"]
    folded: Bool[Array, "*lanes"]


def _cut_back(
    u: Pair,
    trial: Pair,
    size: Float[Array, "*lanes"],
    equations: GridEquations,
    halvings: int,
    *,
    or_whole: bool = False,
    seam: Seam = OPEN,
) -> tuple[Pair, Float[Array, "*lanes"], Bool[Array, "*lanes"]]:
    """The longest of the steps 1, 1/2, 1/4 ... from u to `trial` that is good, if any is.

    A good step lowers the mean correction `size` and keeps an unfolded lattice unfolded; with
    `or_whole`, where none is good, the whole one is taken if it lowers `size` at least. Returns
    the lattice, its mean correction, and whether a step was taken.
    """
    keep_unfolded = ~seam.folded(u)

    def at(share: Array) -> Pair:
        return each(
            lambda old, new: jnp.where(share == 1, new, old + share * (new - old)), u, trial
        )

    def judged(share: Array) -> _Trial:
        there = at(share)
        return _Trial(share, seam.mean_correction(equations, there), seam.folded(there))

    def good(state: _Trial) -> Array:
        return (state.size < size) & ~(keep_unfolded & state.folded)

    def too_long(state: _Trial) -> Array:
        return ~good(state) & (state.share > 0.5**halvings)

    def shorter(state: tuple[_Trial, _Trial]) -> tuple[_Trial, _Trial]:
        found, whole = state
        found = judged(jnp.where(too_long(found), found.share / 2, found.share))
        return found, jax.tree.map(
            lambda new, old: jnp.where(found.share == 1, new, old), found, whole
        )

    untried = _Trial(2 * jnp.ones_like(size), jnp.full_like(size, jnp.inf), size < jnp.inf)
    found, whole = jax.lax.while_loop(
        lambda state: too_long(state[0]).any(), shorter, (untried, untried)
    )
    taken = good(found)
    if or_whole:
        forward = ~taken & (whole.size < size)
        found = jax.tree.map(lambda one, other: jnp.where(forward, one, other), whole, found)
        taken = taken | forward
    u = each(lambda old, new: jnp.where(taken, new, old), u, at(found.share))
    return u, jnp.where(taken, found.size, size), taken


IN_A_ROUND = 5
"""Cycles of a batch until its lattices are sorted anew: fewer than most need in all."""


@dataclass(frozen=True)
class Multigrid(AbstractSolver):
    """Full multigrid, line-relaxed: `fdjax.grid.multigrid`; the solver of choice for any size.

    The first iteration is a full-multigrid start, unless the start is warm; the others are cycles,
    each cut back like a Newton step where it folds the lattice or does not help; where all shorter
    ones fold too, the whole one is taken, and later ones may unfold it again. Stops when the mean
    correction is below `tolerance` times that of the starting lattice, or as small as rounding lets
    it be. `vmap` solves several lattices side by side: `fdjax.grid.batches`.
    """

    tolerance: float = 1e-10
    max_cycles: int = 60
    halvings: int = 3

    def solve(
        self,
        start: Float[Array, "ni nj 2"],
        controls: ControlFunctions,
        warm: Bool[Array, ""] | bool = False,
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        return batches.batched(self._alone, self._together)(start, controls, jnp.asarray(warm))

    def _alone(
        self, start: Float[Array, "ni nj 2"], controls: ControlFunctions, warm: Bool[Array, ""]
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        first, unit, goal = _measured(start, controls, self.tolerance, warm)
        step = self._stepping(controls, (start.shape[0], start.shape[1]), warm)
        found, progress = _iterate(step, planes(start), first, goal, self.max_cycles)
        r = points(found)
        return r, Report.of(r, progress, unit, goal, self.max_cycles)

    def _stepping(
        self, controls: ControlFunctions, shape: tuple[int, int], warm: Array
    ) -> Callable[[tuple[Pair, "_Progress"]], tuple[Pair, "_Progress"]]:
        """One cycle and what has become of the correction, also for lanes in step."""
        equations = operators.equations_of(controls)
        levels = multigrid.hierarchy(equations, shape)

        def step(state: tuple[Pair, _Progress]) -> tuple[Pair, _Progress]:
            u, progress = state
            fresh = (progress.steps.max() == 0) & ~warm
            trial = multigrid.cycles(levels, u, None, fresh=fresh)
            # Where every step folds, the whole one is taken: later ones may unfold it again.
            u, size, better = _cut_back(
                u, trial, progress.size, equations, self.halvings, or_whole=True
            )
            return u, progress.after(size, ~better & ~fresh)

        return step

    def _together(
        self,
        starts: Float[Array, "many ni nj 2"],
        controls: ControlFunctions,
        warm: Bool[Array, " many"],
    ) -> tuple[Float[Array, "many ni nj 2"], Report]:
        """All solved in lanes; a full-multigrid start for all where one is not warm."""
        ni, nj = starts.shape[1:3]
        first, unit, goal = jax.vmap(_measured, in_axes=(0, 0, None, 0))(
            starts, controls, self.tolerance, warm
        )

        def active(goal: Array, progress: _Progress) -> Array:
            return progress.unfinished(goal, self.max_cycles)

        def left(problems: tuple, states: tuple) -> Array:
            goal, progress = problems[1], states[1]
            return jnp.where(active(goal, progress), progress.size / goal, 0.0)

        def advance(problems: tuple, states: tuple) -> tuple:
            controls, goal = problems
            step = self._stepping(controls, (ni, nj), warm.all())

            def of_those_active(state: tuple) -> tuple:
                moving = active(goal, state[1])
                return jax.tree.map(
                    lambda new, old: jnp.where(moving, new, old), step(state), state
                )

            def cycle(state: tuple) -> tuple:
                return state[0] + 1, of_those_active(state[1])

            return jax.lax.while_loop(
                lambda state: (state[0] < IN_A_ROUND) & active(goal, state[1][1]).any(),
                cycle,
                (jnp.asarray(0), states),
            )[1]

        begun = planes(starts), jax.vmap(_Progress.begun)(first)
        found, progress = batches.in_lanes(advance, (controls, goal), begun, left, nodes=ni * nj)
        r = points(found)
        of = partial(Report.of, limit=self.max_cycles)
        return r, jax.vmap(of)(r, progress, unit, goal)


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
        self,
        start: Float[Array, "ni nj 2"],
        controls: ControlFunctions,
        warm: Bool[Array, ""] | bool = False,
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        ni, nj = start.shape[:2]
        first, unit, goal = _measured(start, controls, self.tolerance, warm)
        controls = ControlFunctions(*(jnp.broadcast_to(f, (ni - 2, nj - 2)) for f in controls))

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

        def step(state: tuple) -> tuple:
            r, progress = state
            count = (ni - 2) * (nj - 2)
            r, met = jax.lax.fori_loop(0, count, relax_node, (r, jnp.zeros((), r.dtype)))
            return r, progress.after(met / count)

        r, progress = _iterate(step, start, first, goal, self.max_sweeps)
        return r, Report.of(r, progress, unit, goal, self.max_sweeps)
