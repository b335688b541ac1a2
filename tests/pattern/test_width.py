"""Road width over the unit square: within the machine's range, whatever the controls."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.pattern.width import SplineWidth, UniformWidth, free_of, within

PLACES = jnp.linspace(0, 1, 9)[:, None], jnp.linspace(0, 1, 7)[None]


@settings(max_examples=30, deadline=None)
@given(share=st.floats(0.002, 0.998))
def test_the_free_number_of_a_width_gives_it_back(share):
    low, high = 0.3, 0.8
    value = low + share * (high - low)
    assert float(within(jnp.asarray(free_of(value, low, high)), low, high)) == pytest.approx(value)


@pytest.mark.parametrize(("given", "share"), [(0.1, 1e-3), (0.3, 1e-3), (0.8, 0.999), (2, 0.999)])
def test_a_width_at_the_end_of_the_range_can_still_be_moved(given, share):
    free = jnp.asarray(free_of(given, 0.3, 0.8))
    assert float(within(free, 0.3, 0.8)) == pytest.approx(0.3 + 0.5 * share)
    assert float(jax.grad(within)(free, 0.3, 0.8)) > 1e-4


def test_one_width_is_the_same_everywhere():
    np.testing.assert_array_equal(UniformWidth(0.45)(*PLACES), np.full((9, 7), 0.45))


def test_equal_coefficients_are_one_width():
    field = SplineWidth(jnp.full((5, 4), free_of(0.45, 0.3, 0.8)), 0.3, 0.8)
    np.testing.assert_allclose(eqx.filter_jit(field)(*PLACES), np.full((9, 7), 0.45), rtol=1e-12)


def test_a_field_varies_but_never_leaves_the_range():
    wild = 50 * np.random.default_rng(0).normal(size=(5, 4))
    width = eqx.filter_jit(SplineWidth(jnp.asarray(wild), 0.3, 0.8))(*PLACES)
    assert 0.3 <= float(width.min()) < 0.35
    assert 0.75 < float(width.max()) <= 0.8
