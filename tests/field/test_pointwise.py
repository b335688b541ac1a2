"""Functions place by place: the same values and derivatives, with fewer operations."""

import jax
import jax.numpy as jnp
import numpy as np

from fdjax.field.pointwise import place_by_place


def plain(a, b, scale):
    return jnp.sin(a) * b / scale, jnp.sqrt(a * a + b * b + 1) * scale


FAST = place_by_place(plain)
PLACES = tuple(np.random.default_rng(1).uniform(0.5, 2, (3, 4, 5)))


def test_values_and_all_derivatives_are_those_of_the_function() -> None:
    given = PLACES
    changes = tuple(np.random.default_rng(2).normal(size=(3, 4, 5)))
    for one, other in zip(
        jax.tree.leaves(jax.jvp(FAST, given, changes)),
        jax.tree.leaves(jax.jvp(plain, given, changes)),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-14)

    def size(function):
        return lambda *each: sum((part**2).sum() for part in function(*each))

    for one, other in zip(
        jax.grad(size(FAST), (0, 1, 2))(*given), jax.grad(size(plain), (0, 1, 2))(*given),
        strict=True,
    ):  # fmt: skip
        np.testing.assert_allclose(one, other, rtol=1e-13)
    one, other = (jax.hessian(size(each))(given[0], *given[1:]) for each in (FAST, plain))
    np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def test_a_linearised_function_holds_one_slope_for_each_in_and_out() -> None:
    _, change = jax.linearize(FAST, *PLACES)
    names = [eqn.primitive.name for eqn in jax.make_jaxpr(change)(*PLACES).jaxpr.eqns]
    assert names.count("mul") == 6
