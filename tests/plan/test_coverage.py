import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, MultiPolygon, box

from fdjax.errors import InputError
from fdjax.plan.coverage import coverage
from fdjax.plan.stadium import stadium_chord
from fdjax.plan.toolpath import Build, Layer, Road

PLATE = box(0, 0, 20, 10)


def covered(*roads, **options):
    return coverage(Build((Layer(0.2, 0.2, roads, PLATE),)), **options) * PLATE.area


def capsule(length, width):
    return length * width + np.pi / 4 * width**2


def test_parallel_roads():
    roads = [Road([(2, y), (18, y)], 0.4) for y in (2, 4, 6)]
    assert covered(*roads) == pytest.approx(3 * capsule(16, 0.4), rel=1e-3)
    steep = [Road([(x, 1), (x + 3, 9)], 0.4) for x in (2, 4, 6)]
    assert covered(*steep) == pytest.approx(3 * capsule(np.hypot(3, 8), 0.4), rel=1e-3)


def test_crossing_and_overlapping_roads_count_once():
    first, second = Road([(2, 5), (18, 5)], 0.4), Road([(9, 1), (9, 9)], 0.6)
    cross = capsule(16, 0.4) + capsule(8, 0.6) - 0.4 * 0.6
    assert covered(first, second) == pytest.approx(cross, rel=1e-3)
    assert covered(first, first) == pytest.approx(covered(first), rel=1e-12)
    overlap = Road([(2, 5.2), (18, 5.2)], 0.4)
    corners = 2 * (0.2**2 * np.arccos(0.5) - 0.1 * np.sqrt(0.03))
    expected = 2 * capsule(16, 0.4) - 16 * 0.2 - corners
    assert covered(first, overlap) == pytest.approx(expected, rel=1e-3)


def test_closed_road_is_a_frame():
    frame = Road([(2, 2), (12, 2), (12, 8), (2, 8)], 0.5, closed=True)
    expected = 32 * 0.5 - (1 - np.pi / 4) * 0.25
    assert covered(frame) == pytest.approx(expected, rel=1e-3)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_agrees_with_the_union_of_buffers(seed):
    rng = np.random.default_rng(seed)
    roads = [Road(rng.uniform(1, 9, (5, 2)), width) for width in rng.uniform(0.3, 0.8, 4)]
    beads = [LineString(road.xy).buffer(road.width[0] / 2, quad_segs=64) for road in roads]
    # Four tangled roads are few to average over: finer scan lines than the default.
    assert covered(*roads, resolution=0.01) == pytest.approx(
        shapely.union_all(beads).area, rel=1e-3
    )


def test_mean_over_layers_is_weighted_by_height():
    road = Road([(2, 5), (18, 5)], 0.4)
    build = Build((Layer(0.2, 0.2, (road,), PLATE), Layer(0.5, 0.3, (), PLATE)))
    assert coverage(build) == pytest.approx(0.4 * capsule(16, 0.4) / 200, rel=1e-3)
    with pytest.raises(InputError, match="no outline"):
        coverage(Build((Layer(0.2, 0.2, (road,)),)))
    with pytest.raises(InputError, match="resolution"):
        covered(road, resolution=-1)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_chord_is_where_the_distance_is_the_radius(seed):
    rng = np.random.default_rng(seed)
    p, a, b = rng.uniform(-1, 1, (3, 2))
    angle = rng.uniform(0, 2 * np.pi)
    d = np.array([np.cos(angle), np.sin(angle)])
    low, high = stadium_chord(p, d, a, b, 0.3)
    bead = LineString([a, b])
    if low > high:
        assert bead.distance(LineString([p - 9 * d, p + 9 * d])) >= 0.3
    else:
        for t in (low, high):
            assert bead.distance(shapely.Point(p + t * d)) == pytest.approx(0.3)
        assert bead.distance(shapely.Point(p + (low + high) / 2 * d)) <= 0.3


def test_room_of_several_polygons_adds_up():
    pair = MultiPolygon([box(0, 0, 10, 10), box(15, 0, 20, 10)])
    roads = (Road([(2, 5), (8, 5)], 0.4), Road([(16, 5), (19, 5)], 0.4))
    share = coverage(Build((Layer(0.2, 0.2, roads, pair),)))
    assert share == pytest.approx((capsule(6, 0.4) + capsule(3, 0.4)) / 150, rel=2e-3)
