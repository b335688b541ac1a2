from time import process_time

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.plan.near import Near
from fdjax.plan.order import order_roads, reversed_road
from fdjax.plan.simplify import simplify_road
from fdjax.plan.toolpath import Layer, Road


def test_shuffled_dashes_come_back_in_sequence():
    dashes = [Road([(k, 0), (k + 0.8, 0)], 0.4) for k in range(12)]
    shuffled = [dashes[k] for k in np.random.default_rng(3).permutation(12)]
    ordered = order_roads(shuffled, start=(-1, 0))
    assert [road.xy[0, 0] for road in ordered] == list(range(12))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(2, 12))
def test_order_keeps_every_road_and_the_travel_small(seed, count):
    rng = np.random.default_rng(seed)
    roads = [Road(rng.uniform(0, 10, (2, 2)), rng.uniform(0.3, 0.5)) for _ in range(count)]
    ordered = order_roads(roads, start=roads[0].xy[0])
    assert sorted(road.length for road in ordered) == sorted(road.length for road in roads)
    as_given = Layer(0.2, 0.2, tuple(roads)).travel
    assert Layer(0.2, 0.2, tuple(ordered)).travel <= as_given + 1e-9


def test_many_roads_travel_less_than_to_the_nearest_each_time():
    rng = np.random.default_rng(1)
    middle = rng.uniform(0, 80, (300, 1, 2))
    roads = [Road(xy, 0.4) for xy in middle + rng.normal(0, 3, (300, 2, 2))]
    ordered = order_roads(roads)
    again = order_roads(roads)
    assert [road.xy.tolist() for road in ordered] == [road.xy.tolist() for road in again]
    assert sorted(road.length for road in ordered) == sorted(road.length for road in roads)
    # A nearest end each time gives 1100 mm.
    assert Layer(0.2, 0.2, tuple(ordered)).travel < 900


def test_the_time_for_many_roads_grows_with_their_number():
    def seconds(side):
        at = np.stack(np.meshgrid(*[np.arange(side)] * 2), -1).reshape(-1, 1, 2)
        roads = [Road(xy, 0.4) for xy in at + np.array([(0.1, 0.3), (0.7, 0.6)])]
        begun = process_time()
        ordered = order_roads(roads)
        spent = process_time() - begun
        travel = Layer(0.2, 0.2, tuple(ordered)).travel
        # From an end to that of the next dash are .5 mm at best.
        assert travel < 0.8 * side**2
        return spent

    seconds(10)
    # Nine times as many: by their square that would be 81 times as long.
    assert seconds(150) < 30 * seconds(50)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(2, 4))
def test_a_free_start_is_the_best_of_all_ends(seed, count):
    rng = np.random.default_rng(seed)
    roads = [Road(xy, 0.4) for xy in rng.uniform(0, 10, (count, 2, 2))]

    def travel(order):
        return Layer(0.2, 0.2, tuple(order)).travel

    from_ends = [order_roads(roads, start=end) for road in roads for end in road.path]
    assert travel(order_roads(roads)) <= min(map(travel, from_ends)) + 1e-9


def test_reversed_road_lays_the_same():
    for closed in (False, True):
        width = [0.3, 0.4, 0.5] if closed else [0.3, 0.4]
        for section in (None, [0.01 * each for each in range(1, 1 + len(width))]):
            road = Road([(0, 0), (2, 0), (2, 1)], width, closed=closed, section=section)
            back = reversed_road(road)
            assert back.path.tolist() == road.path[::-1].tolist()
            assert back.segment_volumes(0.2).tolist() == road.segment_volumes(0.2)[::-1].tolist()


def test_no_roads():
    assert order_roads([]) == []


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), closed=st.booleans())
def test_simplified_road_keeps_widths_and_place(seed, closed):
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    xy = 10 * np.stack([np.cos(angle), np.sin(angle)], 1)
    width = np.repeat(rng.uniform(0.3, 0.5, 12), 5)
    road = Road(xy, width if closed else width[:-1], closed=closed)
    simple = simplify_road(road, tolerance=0.2)
    assert len(simple.xy) < len(road.xy)
    assert set(simple.width) == set(road.width)
    for value in set(road.width):
        long, short = (r.segment_lengths[r.width == value].sum() for r in (road, simple))
        assert abs(long - short) < 0.03 * long
    assert simple.closed == closed
    assert set(map(tuple, simple.xy)) <= set(map(tuple, road.xy))


def test_simplify_keeps_every_change_of_width():
    road = Road([(k, 0) for k in range(7)], [0.3, 0.3, 0.4, 0.4, 0.4, 0.3])
    simple = simplify_road(road)
    assert simple.xy[:, 0].tolist() == [0, 2, 5, 6]
    assert simple.width.tolist() == [0.3, 0.4, 0.3]


def test_near_is_the_same_with_and_without_a_tree():
    rng = np.random.default_rng(5)
    points, places = rng.uniform(0, 9, (150, 2)), rng.uniform(0, 9, (7, 2))
    beyond = np.concatenate([points, rng.uniform(90, 99, (150, 2))])
    for count in (1, 4):
        few, many = Near(points).query(places, count), Near(beyond).query(places, count)
        assert few[0].shape == few[1].shape == (7, count)
        np.testing.assert_allclose(few[0], many[0])
        np.testing.assert_array_equal(few[1], many[1])
