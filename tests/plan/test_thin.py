import numpy as np
import pytest
from isolines import isolines
from shapely import box

from fdjax.plan.lines import lay_lines
from fdjax.road.stroke import Lines

PLATE = box(0, 0, 40, 30)


def upright(places, **options):
    xy = [np.array([(x, 0.0), (x, 30.0)]) for x in places]
    lines = Lines("xi", 0, np.arange(len(xy)), xy, [np.array([0.4])] * len(xy))
    return lay_lines(lines, PLATE, lift_length=4, **options)


def places(laid):
    return sorted({x for road in laid.roads for x in road.xy[:, 0].round(6).tolist()})


def test_every_second_line_ends_and_then_three_of_four():
    assert places(upright(1 + 0.3 * np.arange(9))) == pytest.approx(1 + 0.6 * np.arange(5))
    assert places(upright(1 + 0.15 * np.arange(9))) == pytest.approx(1 + 0.6 * np.arange(3))


def test_what_stays_is_joined_back_and_forth():
    laid = upright(1 + 0.3 * np.arange(9))
    assert len(laid.roads) == 1
    assert sum(road.length for road in laid.left_out) == pytest.approx(4 * 29.6)


def test_least_spacing_is_the_roads_width_or_as_given():
    wide = 1 + 0.5 * np.arange(5)
    assert upright(wide).left_out == ()
    assert len(upright(wide, least_spacing=0.6).left_out) == 2
    assert upright(wide, least_spacing=0.5).left_out == ()


def test_a_fan_ends_lines_where_they_are_too_near():
    lines = isolines(lambda x, y: (y - 15) / (0.2 + 0.02 * x), PLATE.bounds)
    laid = lay_lines(lines, PLATE, lift_length=4, tolerance=2e-3)
    assert laid.left_out
    # Spacing is 0.4 mm at x = 10 on the axis; a line of level 1 goes no further.
    inner = [road.path for road in laid.left_out if np.abs(road.path[:, 1] - 15).max() < 0.5]
    assert max(path[:, 0].max() for path in inner) == pytest.approx(10, abs=0.5)
