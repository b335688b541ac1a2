"""The cut of an outline into four sides: named corners and the rule."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely import LinearRing, Polygon, affinity, box

from fdjax.errors import InputError
from fdjax.part.contour import circle
from fdjax.part.corners import four_sides

SQUARE = box(0, 0, 10, 10).exterior


def ring_of(points) -> LinearRing:
    return LinearRing(points)


def corners_of(sides: list[np.ndarray]) -> np.ndarray:
    return np.stack([side[0] for side in sides])


@st.composite
def stars(draw: st.DrawFn) -> np.ndarray:
    """The points of a star-shaped polygon, counter-clockwise."""
    radius = np.array(draw(st.lists(st.floats(2, 20), min_size=8, max_size=30)))
    angle = draw(st.floats(0, 6)) + 2 * np.pi * np.arange(len(radius)) / len(radius)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)


def around(sides: list[np.ndarray]) -> np.ndarray:
    for side, after in zip(sides, sides[1:] + sides[:1], strict=True):
        np.testing.assert_array_equal(side[-1], after[0])
    return np.vstack([side[:-1] for side in sides])


@given(stars(), st.lists(st.floats(0.02, 0.98), min_size=4, max_size=4), st.integers(0, 40))
@settings(max_examples=40, deadline=None)
def test_named_corners_anywhere_cut_the_outline_and_keep_it(xy, shares, first) -> None:
    n = len(xy)
    edges = (first + n * np.arange(4) // 4) % n
    corners = xy[edges] + np.array(shares)[:, None] * (xy[(edges + 1) % n] - xy[edges])
    sides = four_sides(ring_of(xy), corners)
    np.testing.assert_allclose(corners_of(sides), corners, atol=1e-9)
    points = around(sides)
    assert len(points) == n + 4
    rolled = [p for p in points if np.hypot(*(xy - p).T).min() < 1e-12]
    np.testing.assert_array_equal(rolled, np.roll(xy, -(edges[0] + 1), axis=0))


@given(stars())
@settings(max_examples=40, deadline=None)
def test_the_rule_gives_sides_that_make_up_the_outline(xy) -> None:
    try:
        sides = four_sides(ring_of(xy))
    except InputError as error:
        assert "no four different corners" in str(error)  # noqa: PT017
        return
    assert Polygon(around(sides)).symmetric_difference(Polygon(xy)).area < 1e-9


@pytest.mark.parametrize("angle", [0, 20, -33])
@given(st.integers(0, 11), st.floats(-50, 50))
@example(0, -7.28125)  # its hull is collinear up to rounding only
@settings(max_examples=10, deadline=None)
def test_a_rectangle_gets_its_own_corners_wherever_its_points_begin(angle, shift, x0) -> None:
    corners = np.array([(x0, 3), (x0 + 8, 3), (x0 + 8, 9), (x0, 9)])
    edge = [a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)
            for t in (0, 0.3, 0.6)]  # fmt: skip
    turned = affinity.rotate(LinearRing(np.roll(edge, shift, axis=0)), angle, origin=(x0, 3))
    exact = affinity.rotate(LinearRing(corners), angle, origin=(x0, 3)).coords[:-1]
    np.testing.assert_array_equal(corners_of(four_sides(turned)), exact)


@pytest.mark.parametrize(
    ("points", "corners"),
    [
        ([(0, 0), (10, 0), (8, 5), (2, 5)], [(0, 0), (10, 0), (8, 5), (2, 5)]),
        ([(0, -1), (1, 0), (0, 1), (-1, 0)], [(0, -1), (1, 0), (0, 1), (-1, 0)]),
        ([(0, 0), (10, 0), (0, 10)], [(0, 0), (10, 0), (5, 5), (0, 10)]),
        (
            [(0, 0), (10, 0), (10, 3), (3, 3), (3, 10), (0, 10)],
            [(0, 0), (10, 0), (10, 3), (0, 10)],
        ),
    ],
    ids=["trapezoid", "diamond", "triangle", "L"],
)
def test_the_rule_on_plain_shapes(points, corners) -> None:
    np.testing.assert_allclose(corners_of(four_sides(ring_of(points))), corners, atol=1e-12)


def test_ties_are_broken_the_same_way_at_every_corner() -> None:
    angle = np.pi / 8 + np.arange(8) * np.pi / 4
    octagon = ring_of(np.stack([np.cos(angle), np.sin(angle)], 1))
    corners = corners_of(four_sides(octagon))
    quarter = np.stack([-corners[:, 1], corners[:, 0]], 1)
    np.testing.assert_allclose(np.roll(corners, -1, axis=0), quarter, atol=1e-12)
    lengths = [LinearRing(octagon).length / 4] * 4
    sides = four_sides(octagon)
    np.testing.assert_allclose([np.hypot(*np.diff(s, axis=0).T).sum() for s in sides], lengths)


def test_a_disc_is_cut_into_quarters() -> None:
    corners = corners_of(four_sides(circle((0, 0), np.sqrt(2)).exterior))
    np.testing.assert_allclose(corners, [(-1, -1), (1, -1), (1, 1), (-1, 1)], atol=1e-3)


def test_a_corner_near_a_point_of_the_outline_is_that_point() -> None:
    sides = four_sides(SQUARE, [(0, 0.0004), (10, 0), (10.0005, 10.0005), (5, 10)])
    np.testing.assert_array_equal(corners_of(sides), [(0, 0), (10, 0), (10, 10), (5, 10)])
    assert [len(side) for side in sides] == [2, 2, 2, 3]


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([(0, 0), (10, 0), (10, 10)], "3 points are named; four"),
        ([(0, 0), (10, 0), (9, 8), (0, 10)], r"corner 3 at \(9, 8\) is 1 mm off .* \(10, 8\)"),
        ([(0, 0), (0, 10), (10, 10), (10, 0)], "corners 1, 4, 3, 2"),
        ([(0, 0), (10, 10), (10, 0), (0, 10)], "corners 1, 3, 2, 4"),
        ([(0, 0), (10, 0), (10, 0.0001), (0, 10)], "same place"),
        ([(0, 0), (10, 0), (10, float("nan")), (0, 10)], "corners: point 2 is not finite"),
    ],
)
def test_bad_corners_are_named(corners, message: str) -> None:
    with pytest.raises(InputError, match=message):
        four_sides(SQUARE, corners)
