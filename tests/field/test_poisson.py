"""Functions with a given Laplacian against known ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fdjax.errors import InputError
from fdjax.field.poisson import Poisson
from fdjax.field.spline import Axis, product

ONE = np.ones((1, 1))


def fitted(function, x, y):
    """Coefficients of a function, the places it was fitted at, and its values there."""
    places = [np.linspace(axis.low, axis.high, 6 * axis.count) for axis in (x, y)]
    values = function(*np.meshgrid(*places, indexing="ij"))
    return (x.fit(places[0]) @ values @ y.fit(places[1]).T)[..., None], places, values


def error(count, function):
    """Largest error of a function got back from its own Laplacian and boundary."""
    x, y = Axis(0, 80, count), Axis(5, 65, count - 2)
    coefficients, places, values = fitted(function, x, y)
    poisson = Poisson.over(x, y)
    again = poisson.coefficients(poisson.data(coefficients))
    got = product(again, x.basis(places[0]), y.basis(places[1]), ONE)[..., 0]
    return np.abs(got - values).max()


def test_the_finer_the_knots_the_nearer_a_function_that_is_no_spline():
    def waves(x, y):
        return np.sin(x / 13) * np.cos(y / 9) + 0.3 * x

    coarse, fine = error(11, waves), error(19, waves)
    # Knots half as far apart: what P is taken from, a cubic spline's bend, is of second order.
    assert np.log2(coarse / fine) > 2
    assert fine < 5e-3


def test_cubics_and_harmonic_cubics_are_exact():
    assert error(8, lambda x, y: (x**3 - 3 * x * y**2) / 1e4 + 2) < 1e-9
    assert error(8, lambda x, y: (x**3 + x * y + y**2) / 1e4) < 1e-9


def test_a_derivative_is_the_solve_itself():
    x, y = Axis(0, 8, 9), Axis(0, 6, 8)
    poisson = jax.tree.map(jnp.asarray, Poisson.over(x, y))
    rng = np.random.default_rng(1)
    data, way = (jnp.asarray(rng.normal(size=(9, 8, 2))) for _ in range(2))
    weight = jnp.asarray(rng.normal(size=(9, 8, 2)))

    def value(data):
        return (weight * jnp.sin(poisson.coefficients(data))).sum()

    step = 1e-5
    slope = (value(data + step * way) - value(data - step * way)) / (2 * step)
    assert float((jax.grad(value)(data) * way).sum()) == pytest.approx(float(slope), rel=1e-6)
    assert float(jax.jvp(value, (data,), (way,))[1]) == pytest.approx(float(slope), rel=1e-6)


def test_too_few_knots_are_refused():
    with pytest.raises(InputError, match="at least 6"):
        Poisson.over(Axis(0, 1, 5), Axis(0, 1, 9))
