"""Moving the controls until the porosity is met: Levenberg-Marquardt, step by step."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from fdjax.design.objective import Objective, Residuals
from fdjax.precision import require_float64

SCALE = 3e3
"""Residuals are multiplied by this, so that the solver's first damping is a light one."""


class Progress(NamedTuple):
    """One improvement: step number, RMS error of porosity, root of the objective, seconds."""

    step: int
    error: float
    objective: float
    seconds: float


class Outcome(NamedTuple):
    """What an optimisation came to.

    - `controls`: the best found; `error`: RMS error of porosity in the model there.
    - `steps`: evaluations; `converged`: whether it stopped because nothing moved any more.
    - `penalty`: root of the penalties' sum of squares, 0 where all limits are kept.
    - `seconds`: the first step's compiling included.
    """

    controls: Any
    error: float
    penalty: float
    steps: int
    converged: bool
    seconds: float


_SOLVER = optx.LevenbergMarquardt(rtol=1e-4, atol=1e-4)


@eqx.filter_jit
def _residuals(controls: Any, objective: Objective) -> tuple[Residuals, Residuals]:
    residuals, made = objective(controls)
    # A trial that could not be made is answered with a large error: its step is not accepted.
    scaled = jax.tree.map(lambda r: jnp.where(made, SCALE * r, 1e3), residuals)
    return scaled, residuals


@eqx.filter_jit
def _start(controls: Any, objective: Objective) -> Any:
    residuals, aux = eqx.filter_eval_shape(_residuals, controls, objective)
    return _SOLVER.init(_residuals, controls, objective, {}, residuals, aux, frozenset())


@eqx.filter_jit
def _step(controls: Any, objective: Objective, state: Any) -> tuple[Any, Any, Any, Any]:
    controls, state, _ = _SOLVER.step(_residuals, controls, objective, {}, state, frozenset())
    done, _ = _SOLVER.terminate(_residuals, controls, objective, {}, state, frozenset())
    return controls, state, _sizes(state.aux), done


def _sizes(residuals: Residuals) -> list[Any]:
    return [jnp.sqrt((part**2).sum()) for part in residuals]


def optimise(
    objective: Objective,
    controls: Any,
    *,
    steps: int = 40,
    patience: float = 0.05,
    progress: Callable[[Progress], None] | None = None,
) -> Outcome:
    """Minimise the objective from these controls with optimistix's Levenberg-Marquardt.

    Stops after `steps` evaluations, when nothing moves any more, or when four steps in a row
    together gain less than `patience` of the objective. `progress` is called after each step that
    was an improvement. Requires float64.
    """
    require_float64()
    # Without weak types one compiled step serves every call.
    controls = jax.tree.map(lambda values: jnp.array(values, dtype=jnp.float64), controls)
    began, history = time.perf_counter(), []
    if steps < 1:
        error, _, penalty = _sizes(_residuals(controls, objective)[1])
        spent = time.perf_counter() - began
        return Outcome(controls, float(error), float(penalty), 0, False, spent)
    state, done, error, penalty = _start(controls, objective), False, 0.0, 0.0
    for count in range(1, steps + 1):
        controls, state, sizes, done = _step(controls, objective, state)
        error, roughness, penalty = (float(size) for size in sizes)
        value = float(np.sqrt(error**2 + roughness**2 + penalty**2))
        if progress and value < min(history, default=np.inf):
            progress(Progress(count, error, value, time.perf_counter() - began))
        history.append(value)
        stalled = len(history) > 4 and value > (1 - patience) * history[-5]
        if done or stalled:
            # Where nothing was ever gained the trials failed: that is no convergence.
            done = bool(done) or value < history[0]
            break
    return Outcome(controls, error, penalty, len(history), bool(done), time.perf_counter() - began)
