"""Gradients of the design objective, forward and reverse, against central differences.

Every kind of continuous control, both objectives. The points lie away from the kinks there are:
no limit begins or ceases to be broken within a step (checked), no road is as narrow as its layer
is high (the section's kink; the range begins above), and there are no holes, whose edges fade
linearly and so bend once a sample. The windows' edges are smooth.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fdjax.grid.base import Sides
from fdjax.grid.solvers import Newton
from fdjax.limits import Limits
from fdjax.optimise.objective import Objective
from fdjax.part.part import Part
from fdjax.part.patch import cosine_top, rectangle
from fdjax.pattern.grid_controls import Controls
from fdjax.pattern.grid_lines import GridLines
from fdjax.road.porosity import Samples
from fdjax.road.stacking import Stacking
from fdjax.road.window import SoftWindows

STEP = 1e-3
"""With Richardson's extrapolation its error, of order h^4, is below that of rounding."""

LIMITS = Limits(road_width=(0.3, 0.8), least_spacing=0.8, longest_span=4.6, least_road=3.0)

quick_jit = partial(
    jax.jit,
    compiler_options={
        "xla_backend_optimization_level": 0,
        "xla_llvm_disable_expensive_passes": True,
    },
)


def target(x, y, z=0.0):
    return 0.75 - 0.002 * x + 0.001 * y + 0.02 * jnp.sin(x / 9)


def problem(kind, patch, controls):
    """Values of both objectives at controls, and which limits are broken there."""
    places = Samples.between(np.linspace(0, 1, 11))
    pattern = GridLines(
        sides=Sides.of(patch),
        comb=(jnp.asarray(41.0), jnp.asarray(37.0)),
        width=0.4,
        width_range=LIMITS.road_width,
        height=0.2,
        first=controls,
        samples=(places, places),
        kind=kind,
        stacking=Stacking("alternate-staggered", 2, 4),
        nodes=(13, 11),
        solver=Newton(1e-13),
    )
    part = Part.plate(patch, layers=4, height=0.2)
    windows = SoftWindows.over(part, lambda x, y, z: 1 - np.asarray(target(x, y)), 8.0, flat=True)

    def values(controls):
        totals = []
        for each in (windows, None):
            residuals, made = Objective(pattern, each, target, LIMITS, 1e-2)(controls)
            totals.append(sum((part**2).sum() for part in jax.tree.leaves(residuals)) / 2)
        return jnp.stack(totals), (jnp.concatenate(list(residuals.penalties.values())) > 0, made)

    return values


def random_controls(rng, **shapes):
    return Controls(
        **{name: jnp.asarray(0.3 * rng.normal(size=shape)) for name, shape in shapes.items()}
    )


CASES = {
    "elliptic": (cosine_top, {"spacing": (4, 6), "phi": (5, 4), "psi": (4, 5), "width": ()}),
    "stretched": (lambda: rectangle(90, 60), {"stretching": (2,), "width": (4, 5)}),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """The controls, and a function (controls, way, weights) compiled once for all ways.

    It gives both objectives, their slopes along the way, the gradient of their weighted sum and
    the broken limits. The slopes come from the forward derivative, the gradient from its transpose.
    """
    patch, shapes = CASES[request.param]
    controls = random_controls(np.random.default_rng(7), **shapes)
    values = problem(request.param, patch(), controls)

    def everything(controls, way, weights):
        value, forward, aux = jax.linearize(values, controls, has_aux=True)
        (gradient,) = jax.linear_transpose(forward, controls)(weights)
        return value, forward(way), gradient, aux

    compiled = quick_jit(everything).lower(controls, controls, jnp.ones(2)).compile()
    return controls, compiled


def ways(controls):
    """A random way of length one for each control alone, and one for all together."""
    rng = np.random.default_rng(11)
    still = jax.tree.map(jnp.zeros_like, controls)
    names = [name for name in vars(controls) if getattr(controls, name) is not None]
    random = {name: rng.normal(size=getattr(controls, name).shape) for name in names}
    for chosen in [*([name] for name in names), names]:
        length = np.sqrt(sum((random[name] ** 2).sum() for name in chosen))
        way = still
        for name in chosen:
            value = jnp.asarray(random[name] / length)
            way = eqx.tree_at(lambda c, name=name: getattr(c, name), way, value)
        yield chosen, way


def dot(a, b):
    return sum(float((x * y).sum()) for x, y in zip(*map(jax.tree.leaves, (a, b)), strict=True))


def test_forward_and_reverse_agree_with_central_differences(case):
    controls, compiled = case
    weights = jnp.array([0.7, 1.3])
    broken, made = compiled(controls, controls, weights)[-1]
    assert bool(made)
    # Some barriers push here, others do not.
    assert 0 < int(broken.sum()) < broken.size

    for chosen, way in ways(controls):

        def value(step, way=way):
            there = jax.tree.map(lambda c, w: c + step * w, controls, way)
            value, _, _, (still_broken, _) = compiled(there, way, weights)
            assert bool((still_broken == broken).all())
            return np.asarray(value)

        def central(step, value=value):
            return (value(step) - value(-step)) / (2 * step)

        slope = (4 * central(STEP / 2) - central(STEP)) / 3
        _, forward, gradient, _ = compiled(controls, way, weights)
        # The gradient's norm in the controls that move.
        moved = [getattr(gradient, name) for name in chosen]
        norm = np.sqrt(dot(moved, moved))
        assert norm > 0
        np.testing.assert_allclose(forward, slope, rtol=0, atol=1e-6 * norm, err_msg=str(chosen))
        assert dot(gradient, way) == pytest.approx(float(weights @ slope), abs=1e-6 * norm), chosen


def test_each_objective_moves_by_itself(case):
    """Neither is blind to a control: the slopes along a way are not zero, nor alike."""
    controls, compiled = case
    for chosen, way in ways(controls):
        windows, cells = np.asarray(compiled(controls, way, jnp.ones(2))[1])
        assert windows != 0, chosen
        assert cells != 0, chosen
        assert abs(windows - cells) > 1e-6 * abs(windows), chosen
