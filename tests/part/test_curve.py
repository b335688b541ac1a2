"""Curves: what they pass through, their parameter, and NumPy against JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.errors import InputError
from fdjax.part.curve import Curve, arc, polyline, smooth, spline

S = np.linspace(0, 1, 41)


@st.composite
def walks(draw: st.DrawFn, smallest: int = 2) -> np.ndarray:
    """Points of which no two neighbours are closer than 0.1 mm."""
    steps = draw(
        st.lists(
            st.tuples(st.floats(0.1, 10), st.floats(0, 2 * np.pi)),
            min_size=smallest - 1,
            max_size=12,
        )
    )
    length, angle = np.array(steps).T
    xy = np.cumsum(np.stack([length * np.cos(angle), length * np.sin(angle)], 1), axis=0)
    return np.vstack([[0.0, 0.0], xy])


@given(walks())
@settings(max_examples=25, deadline=None)
def test_polyline_passes_its_points_at_constant_speed(xy: np.ndarray) -> None:
    curve = polyline(xy)
    chords = np.hypot(*np.diff(xy, axis=0).T)
    np.testing.assert_allclose(curve(curve.breaks), xy, atol=1e-12)
    speed = np.hypot(*curve.coefficients[:, 1].T)
    np.testing.assert_allclose(speed, chords.sum(), rtol=1e-9)
    np.testing.assert_allclose(curve.polyline(), xy, atol=1e-12)


@pytest.mark.parametrize("make", [polyline, spline])
@given(xy=walks())
@settings(max_examples=25, deadline=None)
def test_reversed_is_the_same_curve_backwards(make, xy: np.ndarray) -> None:
    curve = make(xy)
    scale = 1 + np.abs(curve.coefficients).max()
    np.testing.assert_allclose(curve.reversed()(1 - S), curve(S), atol=1e-12 * scale)
    np.testing.assert_allclose(curve.reversed().reversed()(S), curve(S), atol=1e-12 * scale)
    np.testing.assert_allclose(curve.reversed().start, curve.end, atol=1e-12 * scale)


@given(walks(smallest=4))
@settings(max_examples=25, deadline=None)
def test_spline_is_smooth_through_its_points(xy: np.ndarray) -> None:
    curve = spline(xy)
    np.testing.assert_allclose(curve(curve.breaks), xy, atol=1e-9)
    h, c = np.diff(curve.breaks)[:-1, None], curve.coefficients
    slope = c[:-1, 1] + h * (2 * c[:-1, 2] + 3 * h * c[:-1, 3])
    bend = 2 * c[:-1, 2] + 6 * h * c[:-1, 3]
    scale = np.abs(c).max()
    np.testing.assert_allclose(slope, c[1:, 1], atol=1e-9 * scale)
    np.testing.assert_allclose(bend, 2 * c[1:, 2], atol=1e-9 * scale)


def test_spline_reproduces_a_cubic() -> None:
    t = np.array([0.0, 0.2, 0.3, 0.7, 0.9, 1.0])
    cubic = lambda s: np.stack([s, 3 * s**3 - 2 * s**2 + s], -1)  # noqa: E731
    np.testing.assert_allclose(spline(cubic(t), t)(S), cubic(S), atol=1e-14)


@given(
    st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    st.floats(0.1, 100),
    st.floats(0, 2 * np.pi),
    st.floats(-6.2, 6.2).filter(lambda sweep: abs(sweep) > 0.1),
    st.floats(0.1, 0.9),
)
@settings(max_examples=50, deadline=None)
def test_arc_stays_on_its_circle_at_constant_speed(centre, radius, begin, sweep, share) -> None:
    on_circle = lambda a: np.array(centre) + radius * np.array([np.cos(a), np.sin(a)])  # noqa: E731
    a, b, c = (on_circle(begin + sweep * part) for part in (0, share, 1))
    curve = arc(a, b, c)
    # the three points are rounded, and fix the circle less well the shorter the arc is
    rounding = 1e-15 * (1 + np.abs(centre).max() / radius)
    slack = 1e-9 + 1e3 * rounding / sweep**2
    exact = np.stack([on_circle(begin + sweep * s) for s in S])
    assert np.abs(np.hypot(*(curve(S) - centre).T) - radius).max() < slack * radius
    np.testing.assert_allclose(curve(S), exact, atol=20 * slack * radius)


def test_chords_leave_a_circle_by_little_and_by_choice() -> None:
    half = arc((10, 0), (0, 10), (-10, 0))
    chord = half.polyline()
    middle = (chord[1:] + chord[:-1]) / 2
    assert 10 - np.hypot(*middle.T).min() < 3e-7 * 20
    assert len(half.polyline(pieces=2)) == 2 * (len(half.breaks) - 1) + 1


@pytest.mark.parametrize(
    "curve",
    [
        polyline([(0, 0), (3, 1), (4, 5)]),
        spline([(0, 0), (3, 1), (4, 5), (2, 7), (0, 6)]),
        arc((1, 0), (0, 1), (-1, 0)),
    ],
)
def test_numpy_and_jax_agree(curve: Curve) -> None:
    on_jax = curve(jnp.asarray(S.reshape(1, -1)))
    assert isinstance(on_jax, jax.Array)
    assert on_jax.shape == (1, len(S), 2)
    np.testing.assert_allclose(on_jax[0], curve(S), atol=1e-12)
    forward = jax.jacfwd(curve)(0.37)
    step = 1e-6
    central = (curve(np.array(0.37 + step)) - curve(np.array(0.37 - step))) / (2 * step)
    np.testing.assert_allclose(forward, central, rtol=1e-6)


@pytest.mark.parametrize(
    ("make", "points", "message"),
    [
        (polyline, [(0, 0)], "n >= 2"),
        (polyline, [(0, 0, 0), (1, 1, 1)], r"shape \(2, 3\)"),
        (polyline, [(0, 0), (1, 2), (1, 2)], r"points 1 and 2 are the same, \(1, 2\)"),
        (spline, [(0, 0), (1, float("nan"))], "point 1 is not finite"),
        (spline, [(0, 0), ("a", 1)], "pairs of numbers"),
    ],
)
def test_bad_points_are_named(make, points, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make(points)


def test_bad_parameters_and_straight_arcs_are_named() -> None:
    with pytest.raises(InputError, match="3 rising parameters"):
        spline([(0, 0), (1, 0), (2, 1)], [0, 0.5, float("nan")])
    with pytest.raises(InputError, match="on one line"):
        arc((0, 0), (1, 1), (2, 2))


@pytest.mark.parametrize("near", [1e-3, 0.05, 0.4])
@pytest.mark.parametrize("direction", [(0, -1), (1, -1), (-1, 0)])
def test_a_spline_that_turns_away_from_its_points_is_refused_with_the_place(near, direction):
    points = np.array([(0, 0), (5, 8), (7, 18), (6, 30), (2, 40)], float)
    twice = np.insert(points, 3, points[2] + near * np.array(direction), axis=0)
    smooth(points)
    if direction == (-1, 0) and near > 0.1:
        return  # a bend, not a loop
    with pytest.raises(InputError, match=r"turns away from its own points at \(.* mm beside it"):
        smooth(twice)


def test_arcs_that_are_none_say_why():
    with pytest.raises(InputError, match=r"arc: ends where it starts, at \(7, 4\); a full circle"):
        arc((7, 4), (1, 4), (7, 4))
    with pytest.raises(InputError, match=r"\(0, 0\), \(3, 0\) and \(6, 0\) lie on one line"):
        arc((0, 0), (3, 0), (6, 0))
