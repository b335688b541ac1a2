import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon, box

from fdjax.errors import InputError
from fdjax.plan.check import check
from fdjax.plan.cut import cut_lines
from fdjax.plan.join import FURTHER
from fdjax.plan.lines import lay_lines
from fdjax.plan.room import Room
from fdjax.plan.toolpath import Build, Layer
from fdjax.road.stroke import Lines

PLATE = box(0, 0, 40, 30)
ONE_HOLE = PLATE.difference(Point(12, 15).buffer(5, quad_segs=32))
TWO_HOLES = ONE_HOLE.difference(Point(28, 14).buffer(4, quad_segs=32))


def upright(count, *, points=40, bend=0.0, noise=0.0, seed=0):
    """Lines from y = 0 to y = 30, the first and last on the walls of roads 0.4 wide."""
    eta = np.linspace(0, 1, points)
    rng = np.random.default_rng(seed)
    lines = []
    for x in np.linspace(0.2, 39.8, count):
        wave = bend * np.sin(np.pi * x / 40) * np.sin(2 * np.pi * eta)
        lines.append(np.stack([x + wave + noise * rng.uniform(-1, 1, points), 30 * eta], 1))
    return lines


def laid(lines, outline, *, width=0.4, parity=0, family="xi", **options):
    """Roads of lines that lie from left to right and run upwards, numbered in that order."""
    each = width if isinstance(width, list) else [width] * len(lines)
    arrays = [np.asarray(line, float) for line in lines]
    widths = [np.broadcast_to(w, (len(xy) - 1,)) for w, xy in zip(each, arrays, strict=True)]
    strokes = Lines(family, parity, np.arange(len(lines)), arrays, widths, press=0.25)
    return lay_lines(strokes, outline, **{"longest_join": 60, **options}).roads


def clearance(roads, outline):
    return min(outline.boundary.distance(LineString(road.path)) for road in roads)


def errors(roads, outline):
    found = check(Build((Layer(0.2, 0.2, tuple(roads), outline),)))
    return [str(finding) for finding in found if finding.severity == "error"]


@pytest.mark.parametrize("parity", [0, 1])
@pytest.mark.parametrize("count", [1, 2, 5, 12])
def test_rectangle_is_one_serpentine(count, parity):
    lines = [np.array([(x, 0.0), (x, 30.0)]) for x in np.linspace(0.2, 39.8, count)]
    roads = laid(lines, PLATE, width=0.4, lift_length=1, parity=parity, family="xi")
    assert len(roads) == 1
    length = count * 29.6 + (39.6 if count > 1 else 0)
    assert roads[0].length == pytest.approx(length, abs=1e-9)
    assert roads[0].family == "xi"
    if count > 1:
        turn = roads[0].xy[1:3, 1] if roads[0].xy[0, 0] < 1 else roads[0].xy[-3:-1, 1]
        assert turn == pytest.approx(29.8 if parity == 0 else 0.2)


@settings(max_examples=25, deadline=None)
@given(
    count=st.integers(4, 50),
    points=st.sampled_from([20, 60]),
    bend=st.floats(0, 1),
    noise=st.sampled_from([0, 1e-6, 1e-4, 1e-2]),
    holes=st.integers(0, 2),
    parity=st.integers(0, 1),
    seed=st.integers(0, 99),
)
def test_every_piece_is_laid_once_without_crossing(count, points, bend, noise, holes, parity, seed):
    outline = (PLATE, ONE_HOLE, TWO_HOLES)[holes]
    lines = upright(count, points=points, bend=bend, noise=noise, seed=seed)
    roads = laid(lines, outline, width=0.4, lift_length=3, parity=parity)
    assert 1 <= len(roads) <= 1 + holes
    assert clearance(roads, outline) > 0.2 - 1e-3
    assert errors(roads, outline) == []

    widths = [np.full(points - 1, 0.4)] * count
    walls = Room.of(outline).walls(0.4, 0.25)
    pieces = cut_lines(lines, widths, walls)
    assert {piece.line for piece in pieces} == set(range(count))
    whole = shapely.union_all([LineString(road.path) for road in roads])
    along = shapely.union_all([LineString(piece.xy) for piece in pieces])
    # Lines end early only where a join would run back along them at a small angle.
    assert along.difference(whole.buffer(1e-6)).length < 0.02 * along.length
    # What is laid beside the pieces lies on the walls, or leads to them from there.
    rings = shapely.union_all([LineString(wall.xy) for wall in walls.rings])
    joins = whole.difference(along.buffer(1e-6))
    assert joins.difference(rings.buffer(0.4)).length == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("offset", [-0.05, -1e-2, -1e-6, -1e-12, 0, 1e-12, 1e-6])
def test_line_along_the_wall_stays_whole(offset):
    lines = upright(4)
    lines[0][:, 0] = 0.2 + offset
    lines[-1][:, 0] = 39.8 - offset
    roads = laid(lines, PLATE, width=0.4, lift_length=1)
    assert len(roads) == 1
    assert clearance(roads, PLATE) >= 0.2 - 1e-9
    assert roads[0].length == pytest.approx(4 * 29.6 + 39.6, abs=1e-4)


def test_line_in_the_margin_is_left_out():
    lines = upright(4)
    lines[0][:, 0] = 0.05
    (road,) = laid(lines, PLATE, width=0.4, lift_length=1)
    assert road.length == pytest.approx(3 * 29.6 + 2 * 39.6 / 3, abs=1e-9)


def test_widths_follow_the_line_through_cut_and_press():
    lines = upright(2, points=301)
    widths = [np.linspace(0.3, 0.4, 300), np.linspace(0.4, 0.3, 300)]
    lines[0][:, 0] -= 1e-3
    (road,) = laid(lines, PLATE, width=widths, lift_length=1)
    assert len(road.width) == len(road.xy) - 1
    uneven = laid([lines[0], lines[1][::3]], PLATE, width=[widths[0], 0.3], lift_length=1)
    assert set(uneven[0].width) > {0.3}
    middle = (road.path[1:] + road.path[:-1]) / 2
    left = middle[:, 0] < 1
    assert road.width[left] == pytest.approx(0.3 + 0.1 * middle[left, 1] / 30, abs=1e-3)
    turn = (middle[:, 0] > 1) & (middle[:, 0] < 39)
    assert road.width[turn] == pytest.approx((widths[0][-3] + widths[1][-3]) / 2, abs=1e-3)


def test_join_only_where_shorter_than_lifting():
    # Along the notches it is 1.8 + 8 + 4.4 + 8 + 1.8 = 24 mm, straight across 8 mm.
    notched = PLATE.difference(box(18, 22, 22, 31)).difference(box(18, -1, 22, 8))
    lines = [np.array([(x, 0.0), (x, 30.0)]) for x in (16, 24)]
    # By half as much again, for here that saves all travel.
    assert len(laid(lines, notched, width=0.4, lift_length=15.9 / FURTHER)) == 2
    (road,) = laid(lines, notched, width=0.4, lift_length=16.1 / FURTHER)
    assert road.length == pytest.approx(2 * 29.6 + 24)
    assert len(laid(lines, notched, width=0.4, lift_length=20, longest_join=23.9 / FURTHER)) == 2
    assert clearance([road], notched) > 0.2 - 1e-9


def test_join_does_not_run_back_along_its_line():
    notched = PLATE.difference(box(18, 27, 22, 31)).difference(box(18, -1, 22, 3))
    lines = [np.array([(x, 0.0), (x, 30.0)]) for x in (17.8, 22.2)]
    assert len(laid(lines, notched, width=0.4, lift_length=20)) == 2


def test_same_line_is_joined_round_a_small_hole():
    small = PLATE.difference(Point(20, 15).buffer(0.8, quad_segs=16))
    lines = [np.array([(x, 0.0), (x, 30.0)]) for x in (16, 20, 24)]
    roads = laid(lines, small, width=0.4, lift_length=2)
    assert len(roads) == 1
    assert errors(roads, small) == []
    assert len(laid(lines, small, width=0.4, lift_length=0)) == 2


def test_outline_that_falls_apart_gives_roads_in_each_part():
    waist = PLATE.difference(box(15, -1, 25, 14.9)).difference(box(15, 15.1, 25, 31))
    roads = laid(upright(20), waist, width=0.4, lift_length=3)
    assert len(roads) == 2
    assert clearance(roads, waist) > 0.2 - 1e-9


def test_roads_start_near_the_given_point():
    starts = [(0, 0), (40, 0), (0, 30), (40, 30)]
    for start in starts:
        road = laid(upright(9), PLATE, width=0.4, lift_length=1, start=start)[0]
        ends = np.hypot(*(road.path[[0, -1]] - start).T)
        assert ends[0] <= ends[1]


def test_bad_input_is_one_line():
    xy, width = np.array([(1.0, 0), (1, 30)]), np.array([0.4])
    bow = Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
    for lines, outline, text in [
        (Lines("xi", 0, np.arange(2), [xy], [width]), PLATE, "1 of them, 1 widths and 2 levels"),
        (Lines("xi", 0, np.arange(1), [xy], [-width]), PLATE, "positive width"),
        (Lines("xi", 0, np.arange(1), [xy[:1]], [width[:0]]), PLATE, "line 0"),
        (Lines("xi", 0, np.arange(1), [xy], [width * 200]), PLATE, "nowhere wide enough"),
        (Lines("xi", 0, np.arange(1), [xy], [width]), bow, "cross"),
    ]:
        with pytest.raises(InputError, match=text):
            lay_lines(lines, outline, lift_length=1)


def test_no_lines_are_no_roads():
    none = Lines("xi", 0, np.arange(0), [], [])
    assert lay_lines(none, PLATE, lift_length=1).roads == ()
