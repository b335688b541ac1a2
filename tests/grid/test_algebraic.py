"""Algebraic maps: they keep to their sides, and known cases."""

import numpy as np
import pytest
from grid_samples import chevron, circle, evaluate, places, quick_jit, transfinite
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.grid.algebraic import Cartesian, Spacings, Transfinite, TwoBoundary
from fdjax.grid.base import Sides, tangents
from fdjax.grid.spacing import DensitySpacing, RobertsSpacing
from fdjax.part.curve import arc
from fdjax.part.patch import cosine_top, rectangle
from fdjax.units import MICROSTEP

XI, ETA = places(9, 7)
densities = st.lists(st.floats(-2, 2), min_size=6, max_size=6).map(np.array)
betas = st.floats(1.01, 3).map(np.asarray)
PATCHES = {"cosine": cosine_top(), "chevron": chevron(), "circle": circle()}


@quick_jit
def spacings(densities, beta):
    """Four different spacings: three by density, the left one by eq. (1)."""
    return Spacings(*map(DensitySpacing.of, densities), RobertsSpacing(beta, 0.0))


@quick_jit
def spaced(along, xi, eta):
    return along.bottom(xi), along.top(xi), along.left(eta), along.right(eta)


@pytest.mark.parametrize("name", PATCHES)
@given(densities=st.tuples(densities, densities, densities), beta=betas)
@settings(max_examples=5, deadline=None)
def test_transfinite_keeps_to_its_four_sides(name, densities, beta):
    sides, along = Sides.of(PATCHES[name]), spacings(densities, beta)
    xy = np.asarray(evaluate(Transfinite(sides, along), XI, ETA))
    bottom, top, left, right = (np.ravel(s) for s in spaced(along, XI, ETA))
    for got, side, s in (
        (xy[:, 0], sides.bottom, bottom),
        (xy[:, -1], sides.top, top),
        (xy[0], sides.left, left),
        (xy[-1], sides.right, right),
    ):
        np.testing.assert_allclose(got, side(s), atol=1e-12)


@given(densities=st.tuples(densities, densities, densities), beta=betas)
@settings(max_examples=5, deadline=None)
def test_two_boundary_keeps_to_its_curves_and_is_straight_between(densities, beta):
    sides, along = Sides.of(PATCHES["cosine"]), spacings(densities, beta)
    grid = TwoBoundary(sides.bottom, sides.top, along.bottom, along.top, along.left)
    xy = np.asarray(evaluate(grid, XI, ETA))
    bottom, top, blend, _ = (np.asarray(s) for s in spaced(along, XI, ETA))
    np.testing.assert_allclose(xy[:, 0], sides.bottom(bottom[:, 0]), atol=1e-12)
    np.testing.assert_allclose(xy[:, -1], sides.top(top[:, 0]), atol=1e-12)
    share, low, high = blend[..., None], xy[:, :1], xy[:, -1:]
    np.testing.assert_allclose(xy, (1 - share) * low + share * high, atol=1e-12)


@given(densities=st.tuples(densities, densities, densities), beta=betas)
@settings(max_examples=5, deadline=None)
def test_cartesian_is_the_product_of_its_spacings(densities, beta):
    along = spacings(densities, beta)
    low, high = np.array([1.0, 2.0]), np.array([4.0, 4.0])
    xy = evaluate(Cartesian(low, high, along.bottom, along.left), XI, ETA)
    x, _, y, _ = spaced(along, XI, ETA)
    product = np.stack(np.broadcast_arrays(1 + 3 * np.asarray(x), 2 + 2 * np.asarray(y)), -1)
    np.testing.assert_allclose(xy, product, atol=1e-13)
    # The same from four sides.
    sides = Sides.of(rectangle(3, 2, origin=(1, 2)))
    around = Spacings(along.bottom, along.left, along.bottom, along.left)
    np.testing.assert_allclose(evaluate(Transfinite(sides, around), XI, ETA), xy, atol=1e-12)


def test_transfinite_of_the_cosine_domain_is_equation_2():
    # Straight vertical lines, y in equal shares of the height at x.
    xy = transfinite(cosine_top(), (51, 31)) / MICROSTEP
    xi, eta = places(51, 31)
    y = (3000 - 1000 * np.cos(2 * np.pi * xi)) * eta
    np.testing.assert_allclose(xy[..., 0], 100 + 3000 * xi + 0 * eta, atol=1e-8)
    np.testing.assert_allclose(xy[..., 1], y, atol=1e-4)


def test_two_boundary_interpolation_of_a_circle():
    # Figure 4: two half circles; eta = const are half ellipses, J vanishes where they meet.
    low, high = arc((-1, 0), (0, -1), (1, 0)), arc((-1, 0), (0, 1), (1, 0))
    xi, eta = places(41, 9)
    xy, along = quick_jit(tangents)(TwoBoundary(low, high), xi, eta)
    np.testing.assert_allclose(xy[..., 0], -np.cos(np.pi * xi) + 0 * eta, atol=1e-8)
    np.testing.assert_allclose(xy[..., 1], (2 * eta - 1) * np.sin(np.pi * xi), atol=1e-8)
    exact = 2 * np.pi * np.sin(np.pi * xi) ** 2 + 0 * eta
    np.testing.assert_allclose(along.jacobian, exact, atol=1e-5)


def test_transfinite_interpolation_of_a_circle():
    # Figure 5: unfolded, worst at the four corners, where the sides run on into each other.
    sides = Sides.of(PATCHES["circle"])
    _, along = quick_jit(tangents)(Transfinite(sides), *places(33, 33))
    jacobian = np.array(along.jacobian)
    np.testing.assert_allclose(jacobian, jacobian[::-1].T, atol=1e-5)
    np.testing.assert_allclose(jacobian[[0, 0, -1, -1], [0, -1, 0, -1]], 0, atol=1e-4)
    jacobian[[0, 0, -1, -1], [0, -1, 0, -1]] = 1
    assert jacobian.min() > 0
