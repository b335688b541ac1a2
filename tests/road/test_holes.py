"""Holes: what they take from a deposit, and what the joins along their walls give back."""

import numpy as np
import pytest
import shapely
from deposit_samples import AREA, HEIGHT, WIDTH, deposit, laid, pattern

from fdjax.part.patch import rectangle
from fdjax.plan.measure import measure
from fdjax.road.holes import Holes

pytestmark = pytest.mark.usefixtures("compiled_once")

ROUND = shapely.Point(14, 15).buffer(6, quad_segs=32)
SQUARE = shapely.box(26, 8, 34, 16)
PLATE = rectangle(40, 30, holes=[ROUND, SQUARE])


def holes_of(patch, width=WIDTH, resolution=0.5):
    return Holes.of(patch.outline, width=width, resolution=resolution)


def test_a_plate_without_holes_has_none():
    assert holes_of(rectangle(40, 30)) is None


def test_the_distance_is_signed_and_right_everywhere():
    holes = holes_of(PLATE, resolution=0.25)
    points = np.random.default_rng(0).uniform((0, 0), (40, 30), (500, 2))
    both = ROUND.union(SQUARE)
    inside = shapely.contains_xy(both, *points.T)
    exact = shapely.distance(both.boundary, shapely.points(points)) * np.where(inside, -1, 1)
    np.testing.assert_allclose(holes.distance(*points.T), exact, atol=0.13)


def test_the_walls_lie_half_a_road_off_and_are_whole():
    holes = holes_of(PLATE)
    wall = shapely.points(np.asarray(holes.wall))
    np.testing.assert_allclose(shapely.distance(ROUND.union(SQUARE), wall), WIDTH / 2, rtol=5e-3)
    around = shapely.buffer(ROUND.union(SQUARE), WIDTH / 2).boundary.length
    assert float(holes.step.sum()) == pytest.approx(around)


@pytest.mark.parametrize("lines", [(20, 15), (40, 30)])
def test_what_a_plate_with_holes_takes_is_what_its_roads_take(lines):
    plan = pattern(PLATE, lines, 5, holes=holes_of(PLATE))
    whole = deposit(pattern(PLATE, lines, 5))[1].sum()
    taken = whole - deposit(plan)[1].sum()
    build = laid(plan, PLATE.outline)
    assert taken == pytest.approx(whole - build.volume / len(build.layers), rel=0.08)


def test_nothing_lies_deep_in_a_hole_and_windows_beside_it_are_right():
    holes = holes_of(PLATE)
    plan = pattern(PLATE, (40, 30), 5, holes=holes)
    points, volume = deposit(plan)
    deep = ROUND.union(SQUARE).buffer(WIDTH / 2 - holes.fade / 2 - 0.2)
    assert not volume[shapely.contains_xy(deep, *points.T)].any()
    build = laid(plan, PLATE.outline)
    measurement = measure(build, window=5.0)
    got = np.histogram2d(*points.T, bins=(measurement.x, measurement.y), weights=volume)[0]
    share = got / (measurement.area * HEIGHT + 1e-300)
    error = (share - measurement.solid)[measurement.kept]
    assert np.sqrt(np.nanmean(error**2)) < 0.02


def test_joins_are_on_the_layers_that_have_them_alone():
    holes = holes_of(PLATE)
    full = deposit(pattern(PLATE, (20, 15), both=True, holes=holes))[1]
    half = deposit(pattern(PLATE, (20, 15), holes=holes))[1]
    np.testing.assert_allclose(half, full / 2)
    assert full.shape[0] > len(holes.step)
    assert full[-len(holes.step) :].sum() <= AREA * 2 * float(holes.step.sum())
