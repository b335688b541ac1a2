"""Outlines cut open to their hole: the four sides of a C."""

import numpy as np
import pytest
import shapely
from shapely import Polygon, affinity, box

from fdjax.errors import InputError
from fdjax.part.contour import circle
from fdjax.part.slit import Slit

SQUARE = Polygon(box(0, 0, 80, 80).exterior, [circle((40, 40), 11).exterior])
BENT = Polygon(
    [(0, 0), (60, 0), (60, 60), (40, 60), (40, 20), (0, 20)],
    [list(circle((8, 10), 4).exterior.coords)],
)


def test_the_sides_chain_and_hold_the_part_between_them():
    slit = Slit.of(SQUARE, "it", (80, 40), steps=48)
    for one, other in (
        (slit.bottom.start, slit.left.start),
        (slit.bottom.end, slit.right.start),
        (slit.top.start, slit.left.end),
        (slit.top.end, slit.right.end),
    ):
        np.testing.assert_allclose(one, other, atol=1e-9)
    np.testing.assert_allclose(slit.bottom.end, [80, 80], atol=1e-9)
    np.testing.assert_allclose(slit.top.end, [80, 0], atol=1e-9)
    around = [
        slit.bottom.polyline(),
        slit.right.polyline(),
        slit.top.polyline()[::-1],
        slit.left.polyline()[::-1],
    ]
    # Once round, the cut there and back, is the outline less the hole.
    x, y = np.concatenate([part[:-1] for part in around]).T
    area = (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2
    assert area == pytest.approx(SQUARE.area, rel=1e-9)


def test_both_sides_of_the_cut_are_one_and_the_hole_lies_between():
    slit = Slit.of(SQUARE, "it", (80, 40), steps=48)
    assert slit.tail * 48 == round(slit.tail * 48)
    run = np.linspace(0, slit.tail, 9)
    np.testing.assert_allclose(slit.left(run), slit.left(1 - run), atol=1e-9)
    np.testing.assert_allclose(slit.left(np.array(slit.tail)), [51, 40], atol=1e-3)
    hole = slit.left(np.linspace(slit.tail, 1 - slit.tail, 33))
    np.testing.assert_allclose(np.hypot(*(hole - 40).T), 11, atol=0.02)
    assert shapely.LinearRing(hole).is_ccw


def test_lines_from_the_cut_keep_their_distance_on_the_outline():
    slit = Slit.of(SQUARE, "it", (80, 40), steps=48)
    np.testing.assert_allclose(slit.right(np.array(slit.tail)), [51, 80], atol=1e-3)
    np.testing.assert_allclose(slit.right(np.array(1 - slit.tail)), [51, 0], atol=1e-3)


def test_by_default_the_cut_is_the_shortest():
    part = Polygon(box(0, 0, 80, 80).exterior, [circle((52, 30), 11).exterior])
    slit = Slit.of(part, "it")
    np.testing.assert_allclose(slit.left.start, [80, 30], atol=0.3)
    turned = Slit.of(affinity.rotate(part, 90, origin=(40, 40)), "it")
    np.testing.assert_allclose(turned.left.start, [50, 80], atol=0.3)
    assert turned.tail == slit.tail


def test_of_equally_short_cuts_it_is_the_middle_one_and_lines_keep_clear_of_the_hole():
    part = Polygon(box(0, 0, 80, 70).exterior, [box(30, 20, 50, 50).exterior])
    slit = Slit.of(part, "it")
    np.testing.assert_allclose(slit.left.start, [40, 70], atol=0.1)
    tail = slit.left(np.array(slit.tail))
    np.testing.assert_allclose(tail, [40, 50], atol=0.1)
    for eta in (slit.tail, 1 - slit.tail):
        x, y = slit.right(np.array(eta)) - tail
        assert y > 0.29 * abs(x)


def test_a_cut_to_a_corner_ends_on_the_sides_beside_it():
    slit = Slit.of(SQUARE, "it", (80, 80))
    np.testing.assert_allclose(slit.bottom.end, [0, 80], atol=1e-9)
    np.testing.assert_allclose(slit.top.end, [80, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("polygon", "place", "error"),
    [
        (box(0, 0, 80, 80), None, "has 0 holes; it needs an outline with exactly one"),
        (
            Polygon(
                box(0, 0, 80, 80).exterior,
                [circle((20, 20), 5).exterior, circle((60, 60), 5).exterior],
            ),
            None,
            "has 2 holes",
        ),
        (SQUARE, (85, 40), r"cut: \(85, 40\) is 5 mm off the outline.*nearest at \(80, 40\)"),
        (SQUARE, (60, 40), r"cut: \(60, 40\) is 20 mm off"),
        (BENT, (50, 60), r"cut: from \(50, 60\) .* leaves the part"),
    ],
)
def test_what_cannot_be_cut_is_said_in_one_line(polygon, place, error):
    with pytest.raises(InputError, match=error) as raised:
        Slit.of(polygon, "it", place)
    assert "\n" not in str(raised.value)
