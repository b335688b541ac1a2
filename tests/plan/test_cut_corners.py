"""Corners of turn-arounds that are cut for the windows at the walls."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from shapely import LineString, Point, box

from fdjax.plan.corners import _legs, cut_corners
from fdjax.plan.measure import measure
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.road.bead import section_area

SIDE, STEP = 20.0, 2.0
WIDTH, HEIGHT = np.array(0.4), 0.2


def serpentine(inset=0.2, family="xi"):
    """Lines 2 mm apart that turn around at the lower and the upper wall."""
    x = np.arange(inset, SIDE, STEP)
    low, high = inset, SIDE - inset
    ends = [(high, low) if k % 2 else (low, high) for k in range(len(x))]
    points = [(a, b) for a, pair in zip(x, ends, strict=True) for b in pair]
    return Road(np.array(points), WIDTH, family=family)


def plate(*roads, outline=None):
    return Build((Layer(HEIGHT, HEIGHT, roads, outline or box(0, 0, SIDE, SIDE)),))


def solid(share):
    return lambda x, y: 1 - share + 0 * x


def corners_of(road):
    step = np.diff(road.path, axis=0)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0]))))
    return road.path[1:-1][turn > np.deg2rad(80)]


def test_a_cut_saves_two_legs_less_the_third_side():
    road = serpentine()
    # Nothing is asked: all corners are cut as far as they may, 0.45 of the turn-around.
    cut = cut_corners(plate(road), solid(0.0), window=5)
    (after,) = cut.layers[0].roads
    corners = len(road.xy) - 2
    legs = corners * 0.45 * STEP
    assert road.length - after.length == pytest.approx(legs * (2 - np.sqrt(2)))
    assert len(after.xy) == len(road.xy) + corners
    assert not len(corners_of(after))
    assert np.allclose(after.width, WIDTH)


def test_windows_at_the_walls_come_nearer_and_others_stay():
    build = plate(serpentine())
    window = 5.0
    share = section_area(WIDTH, HEIGHT) / STEP / HEIGHT
    cut = cut_corners(build, solid(share), window=window)
    before, after = (measure(each, window=window).solid - share for each in (build, cut))
    walls, inside = [0, -1], slice(1, -1)
    assert np.abs(before[1:-1, walls]).max() > 0.01
    was, now = (np.sqrt((each[1:-1, walls] ** 2).mean()) for each in (before, after))
    assert now < 0.7 * was
    assert np.allclose(after[:, inside], before[:, inside])


def test_what_lacks_material_is_left_as_it_is():
    build = plate(serpentine())
    cut = cut_corners(build, solid(0.9), window=5)
    assert np.array_equal(cut.layers[0].roads[0].xy, build.layers[0].roads[0].xy)


def test_volume_is_not_cut_below_the_least():
    build = plate(serpentine())
    least = 0.99 * build.volume
    assert cut_corners(build, solid(0.0), window=5).volume < 0.97 * build.volume
    assert cut_corners(build, solid(0.0), window=5, least=least).volume == pytest.approx(least)
    same = cut_corners(build, solid(0.0), window=5, least=2 * build.volume)
    assert same.volume == build.volume


def test_a_line_that_goes_aside_and_on_does_not_turn_around():
    aside = Road(np.array([(5.0, 2.0), (5.0, 9.0), (8.0, 9.0), (8.0, 17.0)]), WIDTH, family="xi")
    (after,) = cut_corners(plate(aside), solid(0.0), window=5).layers[0].roads
    assert np.array_equal(after.xy, aside.xy)


def test_no_road_is_cut_below_the_least():
    hook = Road(np.array([(5.0, 5.0), (5.0, 7.0), (7.0, 7.0), (7.0, 5.0)]), WIDTH, family="xi")
    for least, cut in ((4.0, True), (5.9, False)):
        build = cut_corners(plate(hook), solid(0.0), window=5, least_road=least)
        (after,) = build.layers[0].roads
        assert (after.length < hook.length) == cut
        assert after.length >= least


@pytest.mark.parametrize("family", ["", "curve", "raster", "edges"])
def test_other_roads_are_left_as_they_are(family):
    build = plate(serpentine(family=family))
    assert cut_corners(build, solid(0.0), window=5) is build


def test_no_cut_meets_another_road_or_comes_near_it():
    road = serpentine()
    corner = road.xy[5]
    line = Road(corner + np.array([(0.45, -9), (0.45, -0.5)]), WIDTH, family="xi")
    (alone,) = cut_corners(plate(road), solid(0.0), window=5).layers[0].roads
    beside, _ = cut_corners(plate(road, line), solid(0.0), window=5).layers[0].roads
    assert not len(corners_of(alone))
    assert corners_of(beside).tolist() == [corner.tolist()]


def test_no_cut_crosses_a_wall():
    road = serpentine()
    inside = road.xy[5] + (0.4, -0.4)
    outline = box(0, 0, SIDE, SIDE).difference(Point(inside).buffer(0.1))
    (after,) = cut_corners(plate(road, outline=outline), solid(0.0), window=5).layers[0].roads
    assert corners_of(after).tolist() == [road.xy[5].tolist()]


def test_legs_are_those_of_bounded_least_squares():
    random = np.random.default_rng(3)
    build = plate(serpentine())
    place = random.uniform(0, SIDE, (60, 2))
    saved, most = random.uniform(0.01, 0.2, 60), random.uniform(0.2, 1.0, 60)
    rows, over = [], []
    for shift in ((0, 0), (0.5, 0.5), (0.5, 0), (0, 0.5)):
        measured = measure(build, window=5, shift=shift)
        room = measured.area * HEIGHT
        for i, j in np.argwhere(measured.kept):
            low, high = (measured.x[i], measured.y[j]), (measured.x[i + 1], measured.y[j + 1])
            within = ((place >= low) & (place < high)).all(1)
            rows.append(saved * within / np.sqrt(room[i, j]))
            over.append((measured.volume - 0.2 * room)[i, j] / np.sqrt(room[i, j]))
    best = lsq_linear(np.array(rows), np.array(over), (0, most), tol=1e-12)
    leg = _legs(build, solid(0.2), 5.0, place, saved, most)
    assert (leg >= 0).all()
    assert (leg <= most).all()
    cost = 0.5 * ((np.array(rows) @ leg - over) ** 2).sum()
    none = 0.5 * (np.array(over) ** 2).sum()
    assert cost - best.cost < 1e-3 * (none - best.cost)


def test_closed_roads_and_sections_are_kept():
    square = Road([(1, 1), (9, 1), (9, 9), (1, 9)], WIDTH, closed=True, family="xi", section=0.05)
    (after,) = cut_corners(plate(square), solid(0.0), window=5).layers[0].roads
    assert after.closed
    assert np.allclose(after.section, 0.05)
    # The seam is no corner to cut.
    assert after.xy[0].tolist() == [1, 1]
    assert len(after.xy) == 4 + 3


@pytest.mark.parametrize(("gap", "cut"), [(0.19, False), (0.21, True)])
def test_no_bead_reaches_over_the_wall_of_a_hole(gap, cut):
    """A hole beside the middle of where a cut would go; the bead is 0.2 mm wide on each side."""
    road = Road(np.array([(5, 15.0), (5, 0.2), (15, 0.2), (15, 15.0)]), WIDTH, family="xi")
    leg = 0.45 * 10
    across = np.sqrt(0.5)
    hole = Point(np.array([5, 0.2]) + leg / 2 + (gap + 0.5) * across).buffer(0.5, 64)
    build = plate(road, outline=box(0, 0, SIDE, SIDE).difference(hole))
    (after,) = cut_corners(build, solid(0.0), window=5).layers[0].roads
    assert ([5, 0.2] not in after.xy.tolist()) == cut
    wall = build.layers[0].outline.boundary
    assert LineString(after.xy).distance(wall) > 0.2 - 0.003
