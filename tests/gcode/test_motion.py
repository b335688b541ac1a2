"""The time of moves: against formulas, properties that must hold, and another program's numbers."""

import dataclasses
import math
import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fdjax.formats import profile
from fdjax.gcode.motion import MotionTime
from fdjax.machine.program import Program
from fdjax.machine.survey import survey
from fdjax.moves import Move

MARLIN = profile.load("marlin-0.4")


def path(*points, speed=50.0):
    """Moves from one point (x, y) to the next."""
    places = [(float(x), float(y), 0.0) for x, y in points]
    return [Move(a, b, speed) for a, b in pairwise(places)]


def seconds(moves, acceleration=1000.0, corner_speed=0.0):
    time = MotionTime(acceleration, corner_speed)
    for move in moves:
        time.add(move)
    time.flush()
    return time.seconds


def test_a_long_move_is_a_trapezoid():
    """Length / speed, and half the time of each ramp on top: speed / acceleration."""
    assert seconds(path((0, 0), (100, 0))) == pytest.approx(100 / 50 + 50 / 1000)


def test_a_short_move_is_a_triangle():
    """It speeds up over half its length: 2 sqrt(length / acceleration)."""
    assert seconds(path((0, 0), (0.9, 0))) == pytest.approx(2 * math.sqrt(0.9 / 1000))


def test_it_starts_and_stops_at_the_corner_speed():
    assert seconds(path((0, 0), (100, 0)), corner_speed=8) == pytest.approx(2 + 42**2 / 50 / 1000)
    assert seconds(path((0, 0), (100, 0)), corner_speed=80) == pytest.approx(2)


def test_collinear_moves_are_one_move():
    whole = seconds(path((0, 0), (30, 40)))
    assert seconds(path((0, 0), (3, 4), (3.3, 4.4), (30, 40))) == pytest.approx(whole)


def test_a_right_angle_is_taken_at_the_corner_speed_over_root_two():
    corner = 8 / math.sqrt(2)
    ramps = 42**2 / 2 + (50 - corner) ** 2 / 2  # of one leg, over speed x acceleration
    legs = path((0, 0), (100, 0), (100, 100))
    assert seconds(legs, corner_speed=8) == pytest.approx(2 * (2 + ramps / 50 / 1000))


def test_it_stops_at_a_reversal():
    back = path((0, 0), (100, 0), (0, 0))
    assert seconds(back) == pytest.approx(2 * seconds(path((0, 0), (100, 0))))


def test_a_change_of_speed_is_made_within_the_faster_move():
    moves = [*path((0, 0), (50, 0), speed=20), *path((50, 0), (150, 0), speed=40)]
    ramps = (20 / 2) + (20**2 / 40 / 2) + (40 / 2)
    assert seconds(moves) == pytest.approx(50 / 20 + 100 / 40 + ramps / 1000)


def test_short_moves_ahead_slow_it_down_in_time():
    """The backward pass: a stop after many short collinear moves is that of one long move."""
    points = [(50, 0), *((50 + k / 100, 0) for k in range(1, 101))]
    assert seconds(path((0, 0), *points)) == pytest.approx(seconds(path((0, 0), (51, 0))))


def test_waits_stop_the_head():
    first, second = path((0, 0), (100, 0), (200, 0))
    wait = Move(first.end, first.end, 0.0, seconds=1.5)
    assert seconds([first, wait, second]) == pytest.approx(2 * seconds([first]) + 1.5)


def test_filament_alone_goes_from_stop_to_stop():
    here = (0.0, 0.0, 0.0)
    assert seconds([Move(here, here, 40.0, -2.0, 10 / 40)]) == pytest.approx(10 / 40 + 40 / 1000)
    assert seconds([Move(here, here, 40.0, 2.0, 0.9 / 40)]) == pytest.approx(2 * math.sqrt(9e-4))


def test_moves_without_length_take_no_time():
    assert seconds(path((1, 1), (1, 1))) == 0
    one, other = path((0, 0), (50, 0), (100, 0))
    still = Move(one.end, one.end, 50.0)
    assert seconds([one, still, other]) == pytest.approx(seconds([one, other]))


_place = st.tuples(st.integers(0, 50), st.integers(0, 50))
_walk = st.lists(_place, min_size=2, max_size=30)
_speeds = st.floats(1, 200)


@given(points=_walk, speed=_speeds, acceleration=st.floats(100, 5000), corner=st.floats(0, 20))
def test_never_faster_than_length_over_speed_nor_slower_than_stopping(
    points, speed, acceleration, corner
):
    moves = path(*points, speed=speed)
    time = seconds(moves, acceleration, corner)
    assert time >= sum(move.length for move in moves) / speed * (1 - 1e-9)
    stopping = sum(seconds([move], acceleration, 0.0) for move in moves)
    assert time <= stopping * (1 + 1e-9) + 1e-12


@given(points=_walk, speed=_speeds, parts=st.integers(2, 7), corner=st.floats(0.5, 20))
def test_splitting_straight_moves_changes_nothing(points, speed, parts, corner):
    split = [points[0]]
    for (a, b), (c, d) in pairwise(points):
        split += [(a + (c - a) * k / parts, b + (d - b) * k / parts) for k in range(1, parts)] + [
            (c, d)
        ]
    whole = seconds(path(*points, speed=speed), 1000, corner)
    assert seconds(path(*split, speed=speed), 1000, corner) == pytest.approx(whole, rel=1e-6)


def test_the_window_does_not_show():
    """Long plans are those of their stretches between stops."""
    random.seed(1)
    points = [(random.uniform(0, 9), random.uniform(0, 9)) for _ in range(5000)]
    moves = path(*points)
    time = MotionTime(1000.0, 8.0)
    marks = []
    for k, move in enumerate(moves):
        if k % 700 == 0:
            time.mark()
            marks.append(k)
        time.add(move)
    time.flush()
    assert time.marks[0] == 0
    for k, at in zip(marks, time.marks, strict=True):
        # A plan that ends there stops there, which takes no more than a stop and a start longer.
        assert at == pytest.approx(seconds(moves[:k], 1000.0, 8.0), abs=0.1)
    assert time.marks == sorted(time.marks)


def gcode(*lines):
    return "\n".join(["G21", "G90", "M83", "G28", "M109 S200", "G0 Z0.2 F600", *lines, ""])


def circles():
    for radius in (80, 40, 20):
        count = int(4 * math.pi * radius)  # of half a millimetre
        yield f"G0 X{110 + radius} Y110 F7200"
        yield "G1 F2400"
        for k in range(1, count + 1):
            a = 2 * math.pi * k / count
            yield f"G1 X{110 + radius * math.cos(a):.3f} Y{110 + radius * math.sin(a):.3f} E.02"


def raster(length):
    for k in range(200):
        ends = (20, 20 + length) if k % 2 else (20 + length, 20)
        yield f"G1 X{ends[0]} Y{20 + k / 2} E0.02 F2400"
        yield f"G1 X{ends[1]} Y{20 + k / 2} E1"


def roads():
    """Travel with retraction between short roads."""
    for k in range(200):
        x, y = math.cos(0.7 * k), math.sin(0.7 * k)
        yield "G1 E-0.8 F2400"
        yield f"G0 X{110 + 80 * x:.3f} Y{110 + 80 * y:.3f} F7200"
        yield "G1 E0.8 F2400"
        yield f"G1 X{110 + 60 * x:.3f} Y{110 + 60 * y:.3f} E1 F2400"


@pytest.mark.parametrize(
    "lines",
    [circles(), raster(180), raster(10), roads()],
    ids=["circles", "long", "short", "roads"],
)
def test_agrees_with_printrun(tmp_path, lines):
    """Its estimate has no look-ahead, and 2000 mm/s^2."""
    gcoder = pytest.importorskip("printrun.gcoder")
    file = tmp_path / "part.gcode"
    file.write_text(gcode(*lines))
    stream = dataclasses.replace(MARLIN.stream, acceleration=2000.0, corner_speed=8.0)
    ours = survey(Program(file, dataclasses.replace(MARLIN, stream=stream))).seconds
    with file.open() as text:
        theirs = sum(layer.duration for layer in gcoder.GCode(text).all_layers)
    assert ours == pytest.approx(theirs, rel=0.1)


def test_roads_travel_and_filament_have_accelerations_of_their_own():
    """100 mm at 50 mm/s from stop to stop: 2 s, and 50 mm/s / acceleration."""
    for volume, letter in ((1.0, "P"), (0.0, "T")):
        time = MotionTime(acceleration=1000.0, corner_speed=0.0)
        time.accelerate({letter: 100.0})
        time.add(Move((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), 50.0, volume))
        time.flush()
        time.add(Move((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), 50.0, 1.0 - volume))
        time.flush()
        assert time.seconds == pytest.approx(2.5 + 2.05)
    time = MotionTime(acceleration=1000.0, corner_speed=0.0)
    time.accelerate({"R": 100.0})
    time.add(Move((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 50.0, 1.0, seconds=2.0))
    assert time.seconds == pytest.approx(2.5)
