"""Moving the controls until the porosity is met: least squares, step by step.

Few controls are moved by Levenberg and Marquardt's method with a condensed Jacobian. With many no
Jacobian is formed: each step solves the linearised problem by conjugate gradients, with products
of the linearised residuals and of their transpose.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from fdjax.optimise.objective import Objective
from fdjax.precision import require_float64
from fdjax.programs import program

FEW = 300
"""More controls than this are many."""

SCALE = 3e3
"""Residuals are multiplied by this, so that the solver's first damping is a light one."""

REJECTIONS = 8
"""Trials in a row that may fail; the damping grows fourfold with each."""

STEPS, PATIENCE = {False: 60, True: 150}, {False: 0.1, True: 0.05}
"""For few controls and for many."""


class Progress(NamedTuple):
    """One improvement: step number, RMS error of porosity, root of the objective, seconds."""

    step: int
    error: float
    objective: float
    seconds: float


class Outcome(NamedTuple):
    """What an optimisation came to.

    - `controls`: the best found; `error`: RMS error of porosity in the model there; `objective`:
      root of the objective.
    - `steps`: evaluations; `converged`: whether it stopped because nothing moved any more.
    - `penalty`: root of the penalties' sum of squares, 0 where all limits are kept.
    - `seconds`: the first step's compiling included.
    """

    controls: Any
    error: float
    objective: float
    penalty: float
    steps: int
    converged: bool
    seconds: float


class _Problem(eqx.Module):
    """An objective over free numbers: controls as those at `origin` or, of many, scaled steps from
    there.
    """

    objective: Objective
    origin: Any
    many: bool = eqx.field(static=True)

    def controls(self, free: Array) -> Any:
        given = ravel_pytree(self.origin)[1](free)
        if not self.many:
            return given
        step = self.objective.pattern.scale(given)
        return jax.tree.map(jnp.add, self.origin, step)

    def residuals(self, free: Array) -> tuple[list[Array], Array]:
        """Scaled residuals at the free numbers, in parts, and the size of each kind of residual."""
        residuals, made = self.objective(self.controls(free))
        # A trial that could not be made is answered with a large error: its step is not accepted.
        # All of one type: a constant that a term gives would else be of a weak one.
        parts = [jnp.ravel(jnp.asarray(each, jnp.float64)) for each in jax.tree.leaves(residuals)]
        scaled = [jnp.where(made, SCALE * part, 1e3) for part in parts]
        return scaled, jnp.stack([jnp.sqrt(_squares(kind)) for kind in residuals])


def _squares(parts: Any) -> Array:
    return sum(((part**2).sum() for part in jax.tree.leaves(parts)), jnp.zeros(()))


# --- few controls ---


@eqx.filter_jit
def _condensed(free: Array, problem: _Problem) -> tuple[Array, Array, Array]:
    """As many residuals as there are free numbers and one, with their Jacobian, and the sizes.

    Least squares know residuals r and their Jacobian J only by r'r, J'r and J'J: those of the
    triangular root of [J r]'[J r] are the same, and it is a hundredth of the size.
    """

    def parts(free: Array) -> tuple[list[Array], tuple[list[Array], Array]]:
        residuals, sizes = problem.residuals(free)
        return residuals, (residuals, sizes)

    jacobian, (residuals, sizes) = jax.jacfwd(parts, has_aux=True)(free)
    none = jnp.zeros(())
    square = sum((each.T @ each for each in jacobian), none)
    edge = sum((part @ each for part, each in zip(residuals, jacobian, strict=True)), none)
    gram = jnp.block([[square, edge[:, None]], [edge, _squares(residuals)]])
    # Controls may leave all residuals alone; what rounding makes of that must not be negative.
    least = 1e-14 * jnp.trace(gram) * jnp.eye(len(gram))
    root = jnp.linalg.cholesky(gram + least, upper=True)
    return root[:, -1], root[:, :-1], sizes


def _few(free: Array, problem: _Problem) -> tuple[Array, Array]:
    """The residuals of `_condensed`, and the sizes; derived by its Jacobian."""

    @jax.custom_jvp
    def values(free: Array) -> tuple[Array, Array]:
        residuals, _, sizes = _condensed(free, problem)
        return residuals, sizes

    @values.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        residuals, jacobian, sizes = _condensed(primals[0], problem)
        return (residuals, sizes), (jacobian @ tangents[0], jnp.zeros_like(sizes))

    return values(free)


# --- many controls ---


# A program of its own: start and step, in which it stands several times, trace it once.
@eqx.filter_jit
def _many(free: Array, problem: _Problem) -> tuple[list[Array], Array]:
    return problem.residuals(free)


_DIRECTIONS = 30
"""Steps of conjugate gradients in each step: the damping of the steps needs no more."""

_FIRST_STEP = 1e-2
"""The first damping is one over this: a full step from straight lines is never accepted."""


def _way(many: bool) -> tuple[Callable[..., Any], Any]:
    """Residuals and solver, for few controls and for many."""
    # Loaded only where a step is traced: a program that was kept needs neither.
    import lineax as lx
    import optimistix as optx

    if not many:
        return _few, optx.LevenbergMarquardt(rtol=1e-4, atol=1e-4)
    # As many steps as given: a tolerance would be asked of each number by itself.
    steps = lx.CG(rtol=0.0, atol=0.0, max_steps=_DIRECTIONS, stabilise_every=None)
    return _many, optx.LevenbergMarquardt(rtol=1e-4, atol=1e-4, linear_solver=lx.Normal(steps))


def _begun(free: Array, problem: _Problem) -> Any:
    """The solver's state before the first step."""
    function, solver = _way(problem.many)
    residuals, sizes = eqx.filter_eval_shape(function, free, problem)
    state = solver.init(function, free, problem, {}, residuals, sizes, frozenset())
    if problem.many:
        first = jnp.asarray(_FIRST_STEP)
        state = eqx.tree_at(lambda s: s.search_state.step_size, state, first)
    return state


@program
def _start(free: Array, problem: _Problem) -> list[Array]:
    """The numbers of the solver's state: what else belongs to it is known only as it is traced."""
    return jax.tree.leaves(eqx.filter(_begun(free, problem), eqx.is_array))


@program
def _step(
    free: Array, problem: _Problem, numbers: list[Array]
) -> tuple[Array, list[Array], Array, Array]:
    """One evaluation: where to look next, the state there, sizes here, whether all is done."""
    function, solver = _way(problem.many)
    leaves, structure = jax.tree.flatten(eqx.filter_eval_shape(_begun, free, problem))
    rest = iter(numbers)
    known = [next(rest) if isinstance(each, jax.ShapeDtypeStruct) else each for each in leaves]
    state = jax.tree.unflatten(structure, known)
    free, state, _ = solver.step(function, free, problem, {}, state, frozenset())
    done, _ = solver.terminate(function, free, problem, {}, state, frozenset())
    return free, jax.tree.leaves(eqx.filter(state, eqx.is_array)), state.aux, done


@program
def _looked_at(free: Array, problem: _Problem) -> Array:
    return problem.residuals(free)[1]


@program
def _controls(free: Array, problem: _Problem) -> Any:
    return problem.controls(free)


def optimise(
    objective: Objective,
    controls: Any,
    *,
    steps: int | None = None,
    patience: float | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Outcome:
    """Minimise the objective from these controls with optimistix's Levenberg-Marquardt.

    Stops after `steps` evaluations, when nothing moves any more, when four improvements together
    gain less than `patience` of the objective, or when `REJECTIONS` trials in a row gain nothing.
    With many controls it then begins anew with the first damping, as long as that gains as much.
    By default `STEPS` and `PATIENCE`, which are larger where an evaluation costs little.
    `progress` is called after each improvement. Requires float64.
    """
    require_float64()
    began, gained = time.perf_counter(), []
    controls = jax.tree.map(lambda value: jnp.asarray(value, jnp.float64), controls)
    free, _ = ravel_pytree(controls)
    many = free.size > FEW
    steps = STEPS[many] if steps is None else steps
    patience = PATIENCE[many] if patience is None else patience
    problem = _Problem(objective, controls, many)
    free = jax.device_put(np.zeros(free.size)) if many else free
    if steps < 1:
        found = _found(_looked_at(free, problem))
        return Outcome(controls, *found, 0, False, time.perf_counter() - began)
    numbers = _start(free, problem)
    done, stopped, count, rejected, begun = False, False, 0, 0, np.inf
    error, value, penalty = 0.0, 0.0, 0.0
    while not done and count < steps:
        free, numbers, sizes, stopped = _step(free, problem, numbers)
        count += 1
        error, value, penalty = _found(sizes)
        if value < min(gained, default=np.inf):
            gained.append(value)
            rejected = 0
            if progress:
                progress(Progress(count, error, value, time.perf_counter() - began))
        else:
            rejected += 1
        stalled = len(gained) > 4 and value > (1 - patience) * gained[-5]
        if stalled and many and min(gained) < (1 - patience) * begun:
            # The damping that grew on the way here may be more than is needed from here on.
            begun, rejected = min(gained), 0
            gained = [begun]
            numbers = _start(free, problem)
            continue
        done = bool(stopped) or stalled or rejected == REJECTIONS
    # Where nothing was ever gained the trials failed: that is no convergence.
    converged = done and (bool(stopped) or len(gained) > 1)
    spent = time.perf_counter() - began
    return Outcome(_controls(free, problem), error, value, penalty, count, converged, spent)


def _found(of_kinds: Array) -> tuple[float, float, float]:
    """Error, root of the objective and penalty, from the size of each kind of residual."""
    sizes = np.asarray(of_kinds)
    return float(sizes[0]), float(np.sqrt((sizes**2).sum())), float(sizes[2])
