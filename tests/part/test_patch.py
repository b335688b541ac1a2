"""Patches: how they are made, what they enclose, and every fault named."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LinearRing, Polygon

from fdjax.errors import InputError
from fdjax.part.contour import circle, contour
from fdjax.part.curve import Curve, arc, polyline
from fdjax.part.patch import Patch, cosine_top, from_curves, from_polygon, rectangle
from fdjax.units import MICROSTEP

INSOLE = Path(__file__).parents[2] / "examples" / "insole.geojson"
BOTTOM, RIGHT = polyline([(0, 0), (4, 0)]), polyline([(4, 0), (4, 3)])
TOP, LEFT = polyline([(0, 3), (4, 3)]), polyline([(0, 0), (0, 3)])


def disc_sides(radius: float) -> list[Curve]:
    angle = np.pi / 4 * np.arange(-3, 6)
    xy = radius * np.stack([np.cos(angle), np.sin(angle)], 1)
    return [arc(*xy[k : k + 3]) for k in range(0, 8, 2)]


def test_rectangle_has_its_exact_corners_and_holes() -> None:
    plate = rectangle(
        80, 60, origin=(5, 7), holes=[circle((30, 30), 10), [(60, 20), (70, 20), (65, 30)]]
    )
    np.testing.assert_array_equal(plate.corners, [(5, 7), (85, 7), (85, 67), (5, 67)])
    assert plate.outline.area == pytest.approx(4800 - 100 * np.pi - 50, rel=1e-12)
    assert all(isinstance(hole, LinearRing) for hole in plate.holes)


def test_cosine_top_encloses_the_area_of_its_formula() -> None:
    outline = cosine_top().outline
    assert outline.area == pytest.approx(9e6 * MICROSTEP**2, rel=1e-9)
    x = np.linspace(100, 3100, 777)
    y = 3000 - 1000 * np.cos(2 * np.pi * (x - 100) / 3000)
    top = cosine_top().top((x - 100) / 3000)
    np.testing.assert_allclose(top / MICROSTEP, np.stack([x, y], 1), atol=1e-4)


def test_four_arcs_make_a_disc_with_its_area() -> None:
    disc = from_curves(*disc_sides(10))
    assert disc.outline.area == pytest.approx(100 * np.pi, rel=1e-6)
    assert disc.outline.exterior.is_ccw


@given(st.lists(st.booleans(), min_size=4, max_size=4))
@settings(max_examples=16, deadline=None)
def test_curves_chain_in_either_direction(flips) -> None:
    sides = [side.reversed() if flip else side
             for side, flip in zip(disc_sides(2), flips, strict=True)]  # fmt: skip
    patch = from_curves(*sides, holes=[circle((0, 0), 1)])
    np.testing.assert_allclose(
        patch.corners, np.sqrt(2) * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]), atol=1e-12
    )
    assert patch.outline.area == pytest.approx(3 * np.pi, rel=1e-6)


@given(
    st.lists(st.floats(3, 20), min_size=8, max_size=24),
    st.floats(0, 6),
)
@settings(max_examples=30, deadline=None)
def test_sides_of_a_polygon_chain_to_its_outline(radius, begin) -> None:
    n = len(radius)
    angle = begin + 2 * np.pi * np.arange(n) / n
    xy = np.array(radius)[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
    polygon = contour(xy, holes=[circle((0, 0), 1)])
    patch = from_polygon(polygon, corners=xy[np.arange(4) * n // 4])
    np.testing.assert_allclose(patch.corners, xy[np.arange(4) * n // 4], atol=1e-12)
    assert len(patch.outline.exterior.coords) == n + 1
    assert patch.outline.symmetric_difference(polygon).area < 1e-9
    assert len(patch.holes) == 1


def test_polygon_sides_run_at_constant_speed() -> None:
    patch = from_polygon(Polygon([(0, 0), (1, 0), (4, 0), (4, 3), (0, 3)]))
    np.testing.assert_allclose(patch.bottom(np.array([0, 0.5, 1])), [(0, 0), (2, 0), (4, 0)])
    np.testing.assert_allclose(patch.left(np.array(1 / 3)), (0, 1), atol=1e-12)


def test_smooth_sides_pass_the_points_and_come_closer_to_a_circle() -> None:
    angle = 2 * np.pi * np.arange(32) / 32
    xy = 10 * np.stack([np.cos(angle), np.sin(angle)], 1)
    corners = xy[[20, 28, 4, 12]]
    rough = from_polygon(Polygon(xy), corners=corners)
    smooth = from_polygon(Polygon(xy), corners=corners, smooth=True)
    disc = 100 * np.pi
    assert abs(smooth.outline.area / disc - 1) < 0.02 * abs(rough.outline.area / disc - 1)
    np.testing.assert_allclose(smooth.corners, corners, atol=1e-12)


def test_the_insole_is_one_and_gets_sensible_sides() -> None:
    polygon = contour(INSOLE)
    named = json.loads(INSOLE.read_text())["properties"]["corners"]
    width, length = np.ptp(np.asarray(polygon.exterior.coords), axis=0)
    assert (width, length) == (pytest.approx(73, abs=2), pytest.approx(205, abs=1))
    for patch in (from_polygon(polygon, corners=named), from_polygon(polygon)):
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = patch.corners
        assert max(y0, y1) < 15
        assert min(y2, y3) > 185
        assert min(x1 - x0, x2 - x3) > 30
    smooth = from_polygon(polygon, smooth=True).outline
    assert smooth.symmetric_difference(polygon).area < 2e-3 * polygon.area


def crossing() -> Patch:
    return Patch(BOTTOM, RIGHT, polyline([(0, 3), (2, -1), (4, 3)]), LEFT)


def gap() -> Patch:
    return Patch(BOTTOM, RIGHT, polyline([(0, 3), (4, 3.5)]), LEFT)


def exchanged() -> Patch:
    return from_curves(BOTTOM, LEFT, TOP, RIGHT)


def backwards() -> Patch:
    return Patch(BOTTOM, RIGHT, TOP.reversed(), LEFT)


def hole_outside() -> Patch:
    return replace(rectangle(4, 3), holes=(LinearRing([(3, 1), (5, 1), (5, 2)]),))


def two_holes_overlap() -> Patch:
    return rectangle(40, 30, holes=[circle((10, 10), 5), circle((18, 10), 5)])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (crossing, r"outline: crosses itself at \(\S+, 0\)"),
        (gap, r"right ends at \(4, 3\), but top ends at \(4, 3.5\), 0.5 mm apart"),
        (exchanged, "run clockwise from .* left and right exchanged"),
        (backwards, "does not close: right ends"),
        (hole_outside, "hole 1: touches or leaves the outline"),
        (two_holes_overlap, "holes 1 and 2 touch or overlap"),
        (lambda: rectangle(0, 3), "both must be positive"),
        (lambda: rectangle(float("nan"), 3), "both must be positive"),
        (lambda: from_polygon(Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])), "crosses itself at"),
        (lambda: from_polygon(Polygon()), "outline"),
    ],
)
def test_bad_patches_are_named_in_one_line(make, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
