"""Continuation in the controls, for those that a solver does not reach from a cold start."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from fdjax.grid.seam import Seam
from fdjax.grid.solvers import HISTORY, AbstractSolver, Report
from fdjax.grid.winslow import ControlFunctions


class _Continued(NamedTuple):
    """State of `Continuation`.

    - `reached`: share of the controls that is solved for, by the lattice `at`; `share`: to be
      tried next, `step` more; `trials`: so far.
    - `found`, `report`: the result so far.
    """

    reached: Float[Array, ""]
    at: Float[Array, "ni nj 2"]
    share: Float[Array, ""]
    step: Float[Array, ""]
    trials: Int[Array, ""]
    found: Float[Array, "ni nj 2"]
    report: Report


@dataclass(frozen=True)
class Continuation(AbstractSolver):
    """Another solver, led step by step to controls that it does not reach from a cold start.

    The first trial is the controls whole: where that converges to an unfolded lattice, no other is
    made. Where it does not, half of them are tried, and so on: after a trial that fails half its
    step, after one that succeeds all that is left, from the lattice found. Gives up at steps below
    2^-`halvings` or after `max_trials`; the first trial's result is then the result. Iterations are
    those of all trials.
    """

    solver: AbstractSolver
    halvings: int = 5
    max_trials: int = 40

    @property
    def tolerance(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.solver.tolerance

    @property
    def seam(self) -> Seam:
        return self.solver.seam

    def solve(
        self,
        start: Float[Array, "ni nj 2"],
        controls: ControlFunctions,
        warm: Bool[Array, ""] | bool = False,
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        least = 0.5**self.halvings

        def trial(state: _Continued) -> _Continued:
            part = jax.tree.map(lambda field: state.share * field, controls)
            r, report = self.solver.solve(state.at, part, warm | (state.reached > 0))
            good = report.converged & ~report.folded
            reached = jnp.where(good, state.share, state.reached)
            step = jnp.where(good, 1 - reached, (state.share - reached) / 2)
            iterations = state.report.iterations + report.iterations
            keep = (state.trials == 0) | (reached == 1)
            found, report = jax.tree.map(
                lambda new, old: jnp.where(keep, new, old),
                (r, report),
                (state.found, state.report),
            )
            return _Continued(
                reached,
                jnp.where(good, r, state.at),
                reached + step,
                step,
                state.trials + 1,
                found,
                report._replace(iterations=iterations),
            )

        zero, none = jnp.zeros(()), jnp.asarray(0)
        unknown = Report(none, zero, none > 0, none > 0, none, jnp.full(HISTORY, jnp.nan))
        state = _Continued(zero, start, zero + 1, zero + 1, none, start, unknown)
        state = jax.lax.while_loop(
            lambda state: (
                (state.reached < 1) & (state.step >= least) & (state.trials < self.max_trials)
            ),
            trial,
            state,
        )
        return state.found, state.report
