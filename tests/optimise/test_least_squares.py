"""The optimiser on problems small enough to know the answer of."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from fdjax.errors import InputError
from fdjax.optimise import least_squares
from fdjax.optimise.least_squares import FEW, optimise
from fdjax.optimise.objective import Residuals

pytestmark = pytest.mark.usefixtures("compiled_once")


class Line(eqx.Module):
    """Least squares of a line through points, with a barrier that keeps the slope low."""

    x: Array
    y: Array
    highest: float = 1e9

    def __call__(self, controls):
        error = (controls[0] + controls[1] * self.x - self.y) / jnp.sqrt(self.x.size)
        barrier = jax.nn.relu(controls[1:] - self.highest)
        return Residuals(error, 0.0 * controls, barrier), jnp.asarray(True)


class Valley(eqx.Module):
    """Rosenbrock's valley, which cannot be made where the first control is beyond a wall.

    At this size the first damping is neither light nor heavy.
    """

    wall: float

    def __call__(self, controls):
        a, b = controls
        error = jnp.stack([1 - a, 10 * (b - a**2)]) * SIZE
        return Residuals(error, jnp.zeros(1), jnp.zeros(1)), a < self.wall


SIZE = 1e-3
X = jnp.linspace(-1, 1, 9)
Y = 0.4 + 1.5 * X + 0.1 * jnp.cos(9 * X)


def test_least_squares_are_found_and_the_error_is_their_rms():
    found = optimise(Line(X, Y), jnp.zeros(2))
    expected, rest, *_ = np.linalg.lstsq(np.stack([np.ones(9), X], 1), Y, rcond=None)
    np.testing.assert_allclose(found.controls, expected, atol=1e-4)
    assert found.error == pytest.approx(np.sqrt(rest[0] / 9), rel=1e-6)
    assert found.penalty == 0
    assert found.converged
    assert found.steps < 30


def test_a_limit_in_the_way_shows_as_a_penalty():
    found = optimise(Line(X, Y, highest=1.0), jnp.zeros(2))
    assert 1.0 < found.controls[1] < 1.4
    assert found.penalty == pytest.approx(float(found.controls[1]) - 1, rel=1e-6)


def test_progress_tells_of_improvements_alone():
    seen = []
    found = optimise(Valley(9.0), jnp.array([-0.5, 0.8]), steps=60, progress=seen.append)
    np.testing.assert_allclose(found.controls, [1, 1], atol=2e-3)
    assert [each.step for each in seen] == sorted({each.step for each in seen})
    assert (np.diff([each.objective for each in seen]) < 0).all()
    assert (np.diff([each.seconds for each in seen]) >= 0).all()
    assert seen[-1].error == pytest.approx(found.error)


def test_a_trial_that_cannot_be_made_is_not_taken():
    found = optimise(Valley(0.5), jnp.array([-0.5, 0.8]), steps=60)
    assert float(found.controls[0]) < 0.5
    started = Valley(9.0)(jnp.array([-0.5, 0.8]))[0].error
    assert found.error < 0.5 * float(jnp.sqrt((started**2).sum()))


def test_it_stops_when_told():
    found = optimise(Valley(9.0), jnp.array([-0.5, 0.8]), steps=3)
    assert found.steps == 3
    assert not found.converged


def test_without_a_step_the_start_is_judged():
    controls = jnp.array([-0.5, 0.8])
    found = optimise(Valley(9.0), controls, steps=0)
    assert (found.steps, found.converged) == (0, False)
    np.testing.assert_array_equal(found.controls, controls)
    assert found.error == pytest.approx(np.hypot(1.5, 10 * (0.8 - 0.25)) * SIZE)


def test_patience_ends_what_gains_nothing_any_more():
    hurried = optimise(Valley(9.0), jnp.array([-0.5, 0.8]), steps=60, patience=0.9)
    assert hurried.converged
    assert hurried.steps < 20


def test_float64_is_asked_for():
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(InputError, match="float64"):
            optimise(Line(X, Y), jnp.zeros(2))
    finally:
        jax.config.update("jax_enable_x64", True)


# --- many controls ---


class Steps(eqx.Module):
    """A pattern that steps half as far as it is told."""

    def scale(self, step):
        return step / 2


class Chain(eqx.Module):
    """Numbers that are to be near their goals, and to differ little from their neighbours."""

    goal: Array
    pattern: Steps = Steps()

    def __call__(self, controls):
        error = SIZE * jnp.concatenate([controls - self.goal, jnp.sin(controls)])
        return Residuals(error, SIZE * jnp.diff(controls), jnp.zeros(1)), jnp.asarray(True)


def chain(count):
    return Chain(jnp.cos(jnp.arange(count) / 9.0)), jnp.full(count, 0.3, jnp.float64)


class Nowhere(Chain):
    """A chain whose residuals are no numbers."""

    def __call__(self, controls):
        residuals, made = super().__call__(controls)
        return residuals._replace(error=residuals.error * jnp.nan), made


def test_many_controls_that_no_step_helps_are_given_back_unconverged():
    objective, controls = chain(FEW + 1)
    lost = optimise(Nowhere(objective.goal), controls, steps=20)
    assert not lost.converged
    np.testing.assert_array_equal(lost.controls, controls)


def test_few_and_many_controls_find_the_same():
    few, many = (optimise(*chain(n), steps=60, patience=1e-6) for n in (FEW, FEW + 1))
    assert many.controls.shape == (FEW + 1,)
    assert many.error == pytest.approx(few.error, rel=0.01)
    # Away from the end that is longer by one, they are the same numbers.
    np.testing.assert_allclose(many.controls[: FEW - 30], few.controls[: FEW - 30], atol=5e-3)


def test_controls_of_a_weak_type_are_numbers_like_others():
    objective, _ = chain(FEW + 1)
    found = optimise(objective, jnp.full(FEW + 1, 0.3), steps=3)
    assert found.error < 1.0


def test_a_step_of_many_controls_holds_no_jacobian(monkeypatch):
    """Seen in the compiled step that `optimise` takes itself."""
    lowered = {}

    def seen(*given):
        lowered[given[0].size] = eqx.filter_jit(step.__wrapped__).lower(*given).as_text()
        return step(*given)

    step = least_squares._step
    monkeypatch.setattr(least_squares, "_step", seen)

    def largest(count):
        optimise(*chain(count), steps=1)
        shapes = re.findall(r"tensor<((?:\d+x)+)f64>", lowered[count])
        return max(np.prod([int(n) for n in shape.split("x") if n]) for shape in shapes)

    assert largest(40) >= 40 * 80
    # Three residuals a control: vectors of them all are the largest there is.
    assert largest(2000) < 4 * 2000
