from dataclasses import replace

import numpy as np
import pytest
from shapely import MultiPolygon, Point, box

from fdjax.errors import InputError
from fdjax.limits import Limits
from fdjax.plan.check import check
from fdjax.plan.lines import lay_lines
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.road.stroke import Lines

PLATE = box(0, 0, 20, 20)
LIMITS = Limits(
    road_width=(0.3, 0.6),
    layer_height=(0.1, 0.3),
    least_spacing=0.4,
    longest_span=3,
    least_road=5,
    bed=(100, 100, 50),
)


def family(name, count=21, *, start=0.2, stop=19.8):
    lines = [np.array([(x, 0.0), (x, 20.0)]) for x in np.linspace(start, stop, count)]
    lines = lines if name == "xi" else [line[:, ::-1] for line in lines]
    widths = [np.array([0.4])] * count
    strokes = Lines(name, 0, np.arange(count), lines, widths)
    return lay_lines(strokes, PLATE, lift_length=2).roads


def one(*roads, outline=PLATE, height=0.2):
    return Build((Layer(height, height, tuple(roads), outline),))


def kinds(build, limits=LIMITS, **options):
    return {(f.kind, f.severity): f for f in check(build, limits, **options)}


def test_good_plan_is_silent():
    layers = [
        Layer(0.2 * (k + 1), 0.2, family(name), PLATE)
        for k, name in enumerate(["xi", "eta", "xi", "eta"])
    ]
    assert check(Build(tuple(layers)), LIMITS) == ()
    assert check(Build(()), LIMITS) == ()


def test_crossing_roads():
    build = one(Road([(2, 5), (18, 5)], 0.4), Road([(5, 2), (5, 18)], 0.4))
    (finding,) = check(build, LIMITS)
    assert (finding.kind, finding.severity, finding.layer) == ("crossing", "error", 0)
    assert finding.xy == pytest.approx((5, 5))
    assert "error: crossing, layer 0 at (5.000, 5.000)" in str(finding)


def test_a_road_that_is_cut_beside_a_node_is_whole_there():
    across = Road([(5, 2), (10, 10), (15, 18)], 0.4, family="drawn")
    first = Road([(2, 10), (10, 10), (10.1, 10.1)], 0.4, family="drawn")
    second = Road([(10.1, 10.1), (10.2, 10.2), (16, 11)], 0.4, family="drawn")
    assert ("spacing", "error") not in kinds(one(across, first, second))
    # Beside no node they are as near as before.
    aside = Road([(5, 2), (9.9, 10.1), (15, 18)], 0.4, family="drawn")
    before = Road([(2, 10), (9.7, 10), (10.1, 10.3)], 0.4, family="drawn")
    after = Road([(10.1, 10.3), (16, 11)], 0.4, family="drawn")
    assert ("spacing", "error") in kinds(one(aside, after, before))


def test_road_that_crosses_itself_or_runs_through_a_vertex():
    loop = Road([(2, 2), (15, 2), (15, 10), (8, 10), (8, 1)], 0.4)
    assert kinds(one(loop))[("crossing", "error")].xy == pytest.approx((8, 2))
    through = one(Road([(2, 5), (5, 5), (18, 5)], 0.4), Road([(5, 2), (5, 5), (5, 18)], 0.4))
    assert kinds(through)[("crossing", "error")].count == 1


def test_closed_road_does_not_cross_itself():
    assert check(one(Road([(2, 2), (15, 2), (15, 15), (2, 15)], 0.4, closed=True)), LIMITS) == ()


def test_both_families_on_one_layer_are_counted_as_nodes():
    roads = [Road([(2, y), (18, y)], 0.4, family="eta") for y in (5, 10, 15)]
    roads += [Road([(x, 2), (x, 18)], 0.4, family="xi") for x in (4, 9)]
    roads += [Road([(11, 2), (16, 18)], 0.4, family="xi")]
    found = check(one(*roads), LIMITS, both_families=True)
    assert [(f.kind, f.severity, f.count) for f in found] == [("nodes", "warning", 9)]
    sine = 16 / np.hypot(5, 16)
    assert found[0].value == pytest.approx((6 + 3 / sine) * 0.4**2 * 0.2)
    assert kinds(one(*roads))[("crossing", "error")].count == 9
    same = one(*(Road(road.xy, 0.4, family="xi") for road in roads))
    assert kinds(same, both_families=True)[("crossing", "error")].count == 9


def test_width_height_length_and_bed():
    found = kinds(one(Road([(2, 2), (10, 2), (18, 2)], [0.4, 0.7])))
    assert found[("width", "error")].xy == (10, 2)
    assert ("layer height", "error") in kinds(one(Road([(2, 2), (18, 2)], 0.4), height=0.35))
    found = kinds(one(Road([(2, 2), (4, 2)], 0.4), Road([(2, 4), (18, 4)], 0.4)))
    assert found[("short road", "error")].count == 1
    road = Road([(2, 2), (18, 2)], 0.4)
    assert kinds(one(road).replace(origin=(82.1, 0))).keys() == {("bed", "error")}
    assert kinds(one(road).replace(origin=(81.7, 0))) == {}
    assert kinds(one(road).replace(origin=(-2.0, 0))).keys() == {("bed", "error")}
    centred = replace(LIMITS, bed_origin=(-50.0, -40.0))
    assert kinds(one(road).replace(origin=(-50, -40)), centred) == {}
    assert kinds(one(road).replace(origin=(-50, -43)), centred).keys() == {("bed", "error")}
    high = Build((Layer(50.1, 0.2, (road,), PLATE),))
    assert ("bed", "error") in kinds(high)


def test_spacing_warns_and_then_forbids():
    def pair(gap):
        return one(Road([(2, 5), (18, 5)], 0.4), Road([(2, 5 + gap), (18, 5 + gap)], 0.4))

    assert kinds(pair(0.4)) == {}
    warning = kinds(pair(0.3))[("spacing", "warning")]
    assert warning.value == pytest.approx(0.3)
    assert ("spacing", "error") in kinds(pair(0.15))
    wide = Limits(least_spacing=1.0)
    assert ("spacing", "warning") in kinds(pair(0.6), wide)
    assert kinds(pair(0.6), Limits()) == {}
    other = one(Road([(2, 5), (18, 5)], 0.4, family="xi"), Road([(2, 5.3), (18, 5.3)], 0.4))
    assert kinds(other) == {}


def test_tight_serpentine_is_found_and_a_turn_is_not():
    tight = Road([(2, 2), (2, 18), (2.3, 18), (2.3, 2)], 0.4)
    assert ("spacing", "warning") in kinds(one(tight))
    corner = Road([(2, 2), (2, 18), (2.1, 18), (18, 18)], 0.4)
    assert kinds(one(corner)) == {}
    split = one(Road([(2, 2), (10, 2)], 0.4), Road([(10, 2), (10.1, 2), (18, 2)], 0.4))
    assert kinds(split) == {}


def test_span_over_nothing():
    lower = Layer(0.2, 0.2, family("eta", 3), PLATE)
    upper = Layer(0.4, 0.2, family("xi"), PLATE)
    found = kinds(Build((lower, upper)))[("span", "warning")]
    assert found.layer == 1
    assert found.value == pytest.approx(9.8 - 0.4, abs=1e-6)
    assert found.xy is not None
    assert found.xy[1] in (pytest.approx(5.1), pytest.approx(14.9))
    # The same roads again lie on themselves; over a layer without roads all is a span.
    assert kinds(Build((lower, Layer(0.4, 0.2, lower.roads, PLATE)))) == {}
    empty = Build((Layer(0.2, 0.2, (), PLATE), upper))
    assert kinds(empty)[("span", "warning")].value == pytest.approx(upper.roads[0].length)


def test_road_ends_in_the_air():
    lower = Layer(0.2, 0.2, (Road([(10, 2), (10, 18)], 0.4),), PLATE)
    upper = Layer(0.4, 0.2, (Road([(2, 8), (11, 8)], 0.4),), PLATE)
    assert kinds(Build((lower, upper)))[("span", "warning")].value == pytest.approx(7.8)


def test_outside_the_outline():
    holed = PLATE.difference(Point(10, 10).buffer(3))
    assert kinds(one(Road([(2, 0.19), (18, 0.19)], 0.4)).replace(origin=(9, 9))) == {}
    edge = kinds(one(Road([(2, 0.1), (18, 0.1)], 0.4)))[("outline", "error")]
    assert edge.value == pytest.approx(0.1)
    through = kinds(one(Road([(2, 10), (18, 10)], 0.4), outline=holed))
    assert ("outline", "error") in through
    away = kinds(one(Road([(2, 25), (18, 25)], 0.4)))[("outline", "error")]
    assert away.value == pytest.approx(5.2)
    assert kinds(one(Road([(2, 5), (18, 5)], 0.4), outline=None)) == {}


def test_sharp_corner():
    sharp = Road([(2, 2), (18, 2), (2, 6)], 0.4)
    found = kinds(one(sharp))[("corner", "warning")]
    assert found.xy == (18, 2)
    assert found.value == pytest.approx(np.degrees(np.arctan2(4, 16)))
    assert kinds(one(Road([(10, 2), (17, 6), (10, 10)], 0.4))) == {}


def test_limits_are_checked():
    for options in (
        {"road_width": (0.5, 0.4)},
        {"bed": (100, 0, 100)},
        {"longest_span": 0},
        {"least_road": -1},
        {"least_spacing": float("nan")},
    ):
        with pytest.raises(InputError, match="mm"):
            Limits(**options)


def test_roads_of_several_polygons_stay_in_their_own():
    pair = MultiPolygon([box(0, 0, 20, 8), box(0, 10, 20, 20)])
    good = (Road([(1, 4), (19, 4)], 0.4), Road([(1, 12), (19, 12)], 0.4))
    assert check(one(*good, outline=pair), LIMITS) == ()
    across = Road([(5, 5), (5, 11)], 0.4)
    finding = kinds(one(*good, across, outline=pair))[("outline", "error")]
    assert (finding.count, finding.xy) == (1, pytest.approx((5, 8)))
    between = Road([(1, 9), (19, 9)], 0.4)
    assert kinds(one(between, outline=pair))[("outline", "error")].value == pytest.approx(1.2)
