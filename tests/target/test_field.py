"""Which functions take z, and what Target, its check and a comparison make of it."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapely import box

from fdjax.errors import InputError
from fdjax.part.part import Part
from fdjax.target.expression import Expression
from fdjax.target.field import field_of
from fdjax.target.raster import Raster
from fdjax.target.target import Target, expression


@pytest.mark.parametrize(
    ("function", "takes", "varies"),
    [
        (lambda x, y: x, False, False),
        (lambda x, y, z: z, True, True),
        (lambda x, y, z=0.0: x, True, True),
        (lambda x, y, xp=np: x, False, False),
        (lambda x, y, *more: x, False, False),
        (np.hypot, False, False),
        (jax.jit(lambda x, y, z: z), True, True),
        (functools.partial(lambda a, x, y: a, 1.0), False, False),
        (Raster(np.ones((2, 2)), (0, 0, 1, 1)), False, False),
        (Expression("x"), True, False),
        (Expression("max(0.1, z)"), True, True),
        (expression("x"), True, False),
        (expression("z"), True, True),
    ],
)
def test_the_signature_says_whether_z_counts(function, takes, varies):
    field = field_of(function)
    assert (field.takes_z, field.varies_in_z) == (takes, varies)
    assert np.isfinite(field(0.25, 0.5, 0.75))


def test_z_is_in_the_unit_of_the_formula_and_0_where_not_given():
    target = expression("0.2 + z/2 + x/100", unit="in")
    assert float(target(25.4, 0.0, 12.7)) == pytest.approx(0.2 + 0.25 + 0.01)
    assert float(target(25.4, 0.0)) == pytest.approx(0.21)
    assert float(target.solid(0.0, 0.0, 25.4)) == pytest.approx(0.3)
    assert target(np.zeros((3, 1)), 0.0, np.zeros(4)).shape == (3, 4)
    slope = jax.grad(lambda z: target(1.0, 2.0, z))(jnp.asarray(3.0))
    assert float(slope) == pytest.approx(0.5 / 25.4)


def test_check_looks_at_the_layers_middles():
    part = Part.plate(box(0, 0, 8, 4), layers=10, height=0.2)
    expression("z/1.9").check(part)
    with pytest.raises(InputError, match=r"is 1\.05556 at \(.*, 1\.9\) mm"):
        expression("z/1.8").check(part)
    with pytest.raises(InputError, match=r"is -0\.1 at \(.*, 0\.1\) mm"):
        Target(lambda x, y, z: z - 0.2).check(part)


def test_check_looks_at_each_layer_within_its_own_region():
    part = Part.stack([box(0, 0, 8, 4), box(0, 0, 2, 4)], 1.0)
    expression("where(z > 1, x/2, 0.5)").check(part)
    with pytest.raises(InputError, match=r"is 4 at \(8, .*, 0\.5\) mm"):
        expression("where(z < 1, x/2, 0.5)").check(part)
    with pytest.raises(InputError, match=r"at \(8, \d\.?\d*\) mm"):
        expression("x/4").check(part)


def test_check_of_many_layers_looks_at_the_first_and_the_last():
    part = Part.plate(box(0, 0, 8, 4), layers=333, height=0.1)
    for text in ("where(z < 0.1, 2, 0.5)", "where(z > 33.2, 2, 0.5)"):
        with pytest.raises(InputError, match="is 2 at"):
            expression(text).check(part, samples=20)
