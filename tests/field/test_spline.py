"""Splines of a box: sums to one, cubics reproduced, slopes as differences say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.errors import InputError
from fdjax.field.spline import Axis, product

PLACES = np.linspace(-3.0, 5.0, 57)


@pytest.mark.parametrize("count", [1, 4, 9, 20])
def test_the_splines_sum_to_one(count):
    np.testing.assert_allclose(Axis(-3.0, 5.0, count).basis(PLACES).sum(1), 1, rtol=1e-14)


@settings(max_examples=30, deadline=None)
@given(count=st.integers(4, 12), powers=st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_cubics_are_fitted_exactly_with_all_their_derivatives(count, powers):
    axis = Axis(-3.0, 5.0, count)
    cubic = np.polynomial.Polynomial(powers)
    coefficients = axis.fit(PLACES) @ cubic(PLACES)
    for order in range(4):
        expected = cubic.deriv(order)(PLACES) if order else cubic(PLACES)
        np.testing.assert_allclose(axis.basis(PLACES, order) @ coefficients, expected, atol=1e-8)


def test_a_product_is_the_sum_over_all_three_axes():
    rng = np.random.default_rng(0)
    axes = Axis(0, 1, 5), Axis(0, 2, 6), Axis(0, 3, 4)
    coefficients = rng.normal(size=(5, 6, 4))
    bases = [
        axis.basis(np.linspace(axis.low, axis.high, n))
        for axis, n in zip(axes, (3, 4, 2), strict=True)
    ]
    np.testing.assert_allclose(
        product(coefficients, *bases), np.einsum("klm,ik,jl,cm->ijc", coefficients, *bases)
    )


@pytest.mark.parametrize(("low", "high", "count"), [(0, 1, 3), (0, 1, 0), (1, 1, 5), (2, 1, 5)])
def test_what_is_no_axis_is_refused(low, high, count):
    with pytest.raises(InputError):
        Axis(low, high, count)
