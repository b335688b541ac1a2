import dataclasses
import re

import numpy as np
import pytest
from format_samples import builds, pairs, small_build
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, box

from fdjax.errors import InputError
from fdjax.formats import profile, sml
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.road.bead import road_width, section_area
from fdjax.road.stroke import Subdomain
from fdjax.units import MICROSTEP

FDM = profile.load("stratasys-fdm1650")
LAW = FDM.sml.area_per_code
HEIGHT = 0.254


def build_of(*roads, **options):
    return Build((Layer(HEIGHT, HEIGHT, roads),), **options)


def fitted_roads(*roads):
    return sml.fit(build_of(*roads), FDM).layers[0].roads


def codes_of(road, height=HEIGHT):
    return section_area(road.width, height) / LAW


def paths_of(text):
    """Set-up and moves of each continuous path, cut out of the text by a second, naive reader."""
    return re.findall(r">(PD\d[^\n]*)\nBC;\n((?:MA-?\d+,-?\d+;\n)*)EC;", text)


def assert_limits(text):
    for set_up, moves in paths_of(text):
        assert set_up.count("MM") - 1 <= 32
        assert moves.count("MA") <= 200


def assert_same(a, b):
    for planned, found, _ in pairs(a, b):
        np.testing.assert_array_equal(planned.width, found.width)


@pytest.mark.parametrize("turn", range(4))
def test_rounding_turns_no_corner_back_onto_its_road(turn):
    # A corner that comes back a hundredth of a millimetre beside itself: on the grid, upon itself.
    xy = np.array([(800, 0), (800.3, 315), (801.4, 315.1), (796, 315.3), (400, 319)])
    around = np.array([(0, -1), (1, 0)])
    xy = MICROSTEP * (xy @ np.linalg.matrix_power(around, turn) + 2000)
    (road,) = fitted_roads(Road(xy, 0.4 + 0.05 * np.arange(4)))
    steps = np.rint(np.diff(road.path, axis=0) / MICROSTEP)
    straight = steps[:-1, 0] * steps[1:, 1] == steps[:-1, 1] * steps[1:, 0]
    assert not (straight & ((steps[:-1] * steps[1:]).sum(1) < 0)).any()
    assert len(road.width) == len(steps) == 3
    np.testing.assert_allclose(road.path[[0, -1]], xy[[0, -1]], atol=MICROSTEP)


@pytest.mark.parametrize("turn", range(4))
def test_rounding_hooks_no_road_across_itself(turn):
    # A line that meets a wall at a small angle, and goes back along it: a step beside itself.
    hook = np.array([(1.4, -31), (0.3, 0.3), (0.4, -0.6), (1.4, -2.4), (3, -6)])
    around = np.array([(0, -1), (1, 0)])
    corner = np.array([(-2, -16), (-0.1, 1), (0.04, 7), (0.08, 0), (33, 0)])
    for xy in (hook, hook[::-1], hook * (-1, 1), corner, corner[::-1]):
        assert LineString(xy).is_simple
        placed = MICROSTEP * (xy @ np.linalg.matrix_power(around, turn) + 2000)
        (road,) = fitted_roads(Road(placed, 0.4 + 0.05 * np.arange(4)))
        assert LineString(road.path).is_simple
        np.testing.assert_allclose(road.path[[0, -1]], placed[[0, -1]], atol=MICROSTEP)


@settings(max_examples=40, deadline=None)
@given(build=builds())
def test_what_is_written_is_read_back_exactly(build):
    fitted = sml.fit(build, FDM)
    if not any(layer.roads for layer in fitted.layers):
        return
    text = sml.write(build, FDM)
    assert_same(fitted, sml.read(text))
    assert_same(fitted, sml.fit(fitted, FDM))
    assert text == sml.write(fitted, FDM)
    assert_limits(text)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    segments=st.integers(1, 700),
    smooth=st.booleans(),
    closed=st.booleans(),
    step=st.sampled_from([0.03, 0.3, 3.0]),
)
def test_long_graded_roads_come_back_exactly(seed, segments, smooth, closed, step):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(0, step, (segments + 1, 2)), axis=0) + 100
    count = segments + closed
    s = np.linspace(0, 1, count)
    width = 0.7 + 0.3 * np.sin(7 * s) if smooth else rng.uniform(0.4, 1.0, count)
    build = build_of(Road(points, width, closed=closed, family="xi"))
    fitted = sml.fit(build, FDM)
    text = sml.write(build, FDM)
    assert_limits(text)
    assert_same(fitted, sml.read(text))
    assert_same(fitted, sml.fit(fitted, FDM))
    for road, after in zip(fitted.layers[0].roads, fitted.layers[0].roads[1:], strict=False):
        np.testing.assert_array_equal(road.path[-1], after.path[0])


def test_points_are_microsteps_on_the_bed():
    fitted = sml.fit(small_build(), FDM)
    for layer in fitted.layers:
        for road in layer.roads:
            steps = (road.xy + np.asarray(fitted.origin)) / MICROSTEP
            assert np.abs(steps - np.rint(steps)).max() < 1e-6


def test_a_road_of_one_width_has_one_even_code():
    (road,) = fitted_roads(Road([(0, 0), (20, 0), (20, 3), (50, 9)], 0.61))
    (code,) = set(np.rint(codes_of(road)))
    assert code % 2 == 0
    assert abs(codes_of(road)[0] - section_area(0.61, HEIGHT) / LAW) < 2


def test_the_mean_section_is_kept_by_neighbours():
    asked = section_area(0.611, HEIGHT)
    roads = fitted_roads(*(Road([(0, y), (60, y)], 0.611) for y in range(40)))
    found = np.array([section_area(road.width[0], HEIGHT) for road in roads])
    assert 2 <= len(set(np.rint(found / LAW))) <= 2  # two neighbouring codes
    assert abs(found.mean() / asked - 1) < 2 * LAW / asked / 40
    for k in (5, 10, 20):  # and so in every group of neighbours
        groups = np.convolve(found, np.full(k, 1 / k), "valid")
        assert np.abs(groups / asked - 1).max() < 2 * LAW / asked / k


def test_the_mean_section_of_each_subdomain_and_material_is_kept():
    # The same long road and short one on every layer: rounding one down and the other up would
    # keep the mean of both together.
    boxes = [box(0, 0, 120, 10), box(0, 10, 120, 20)]
    some = tuple(Subdomain(each, "raster", 0.0, 0.4, 1.0, 0) for each in boxes)
    middle = section_area(0.4, HEIGHT) / LAW // 2 * 2 + 1
    width = road_width(np.array(middle * LAW), HEIGHT)
    roads = [Road([(5, 5), (105, 5)], width), Road([(5, 15), (105, 15)], width)]
    for two, subdomains in (
        (roads, some),
        ([roads[0], dataclasses.replace(roads[1], material=1)], ()),
    ):
        layers = tuple(Layer(k * HEIGHT, HEIGHT, two, None, 0.0, subdomains) for k in range(1, 11))
        fitted = sml.fit(Build(layers), FDM)
        for number in (0, 1):
            sections = [section_area(layer.roads[number].width, HEIGHT) for layer in fitted.layers]
            assert np.mean(sections) == pytest.approx(middle * LAW)


def test_volume_is_kept_with_graded_widths():
    x = np.linspace(0, 100, 101)
    roads = [
        Road(np.stack([x, np.full(101, y)], 1), 0.4 + 0.005 * x[:-1] + 0.001 * y) for y in range(20)
    ]
    build = build_of(*roads)
    assert sml.fit(build, FDM).volume == pytest.approx(build.volume, rel=3e-5)


def test_codes_follow_a_graded_width_within_two_steps():
    x = np.linspace(0, 100, 101)
    road = Road(np.stack([x, 0 * x], 1), 0.4 + 0.005 * x[:-1])
    fitted = fitted_roads(road)
    codes = np.concatenate([codes_of(piece) for piece in fitted])
    assert np.abs(codes - section_area(road.width, HEIGHT) / LAW).max() < 4


def test_set_up_has_the_shape_of_the_manuals():
    text = sml.write(build_of(Road([(0, 0), (25.4, 0)], 0.5)), FDM)
    code = paths_of(text)[0][0].split("MM6,")[1].split(";")[0]
    assert f">PD0.08,41;MM;MM0,53;MM6,{code};MM-70,175;SR800;AC5;\nBC;\nMA1000,0;\nEC;" in text


def test_outputs_are_cleared_before_travel_only():
    roads = [Road([(0, 0), (9, 0)], 0.5), Road([(9, 0), (9, 9)], 0.5), Road([(0, 5), (5, 5)], 0.5)]
    text = sml.write(build_of(*roads), FDM)
    assert text.count("SR4000;MA") == 2
    assert text.count("CD0;\nPD;MM;\n") == 2  # before the second travel and at the end
    assert len(paths_of(text)) == 3


def test_a_road_shorter_than_its_rollback():
    for length in (1, 2, 5, 60, 75):
        build = build_of(Road([(0, 0), (length * MICROSTEP, 0)], 0.5))
        assert_same(sml.fit(build, FDM), sml.read(sml.write(build, FDM)))


def test_a_road_of_more_than_200_segments_is_cut():
    x = np.linspace(0, 100, 402)
    fitted = fitted_roads(Road(np.stack([x, np.sin(x)], 1), 0.5, closed=False))
    assert [len(road.width) for road in fitted] == [133, 134, 134]
    whole = fitted_roads(Road(np.stack([np.cos(x), np.sin(x)], 1)[:190] * 20, 0.5, closed=True))
    assert [road.closed for road in whole] == [True]


def test_a_road_is_cut_where_no_piece_is_short():
    x = np.concatenate([np.arange(110) * 0.1, 11 + np.arange(110)])
    pieces = fitted_roads(Road(np.stack([x, np.sin(x)], 1), 0.5))
    assert len(pieces) == 2
    assert min(road.length for road in pieces) > 50


def test_a_path_longer_than_the_limit_is_cut():
    zigzag = [(200 * (k % 2), k) for k in range(100)]
    fitted = fitted_roads(Road(zigzag, 0.5))
    assert len(fitted) == 2
    assert max(road.length for road in fitted) <= 524_272 * MICROSTEP


def test_width_changes_beyond_the_largest_count_are_cut():
    zigzag = [(200 * (k % 2), k) for k in range(40)]
    build = build_of(Road(zigzag, np.where(np.arange(39) < 30, 0.5, 0.8)))
    assert len(sml.fit(build, FDM).layers[0].roads) > 1
    assert_same(sml.fit(build, FDM), sml.read(sml.write(build, FDM)))


def test_the_file_can_be_read_without_its_comments():
    build = small_build()
    text = sml.write(build, FDM)
    bare = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    again, fitted = sml.read(bare, machine=FDM), sml.read(text)
    assert again.volume == pytest.approx(fitted.volume)
    assert [layer.z for layer in again.layers] == [layer.z for layer in fitted.layers]
    assert [len(layer.roads) for layer in again.layers] == [3, 3]


def foreign(commands, **options):
    (layer,) = sml.read(commands + "PD;MM;CD0;FH;", machine=FDM, **options).layers
    return layer


def test_commands_in_either_case_over_lines_with_any_separator():
    layer = foreign("az10;>pd.08,41;mm;MM 0 53;MM+006,100;mm-70,175;sr800;ac5;bc;m\na1000+500;EC;")
    (road,) = layer.roads
    np.testing.assert_allclose(road.xy, np.array([(0, 0), (1000, 500)]) * MICROSTEP)
    assert codes_of(road) == pytest.approx(100)
    assert layer.height == pytest.approx(0.254)


def test_outputs_fire_again_on_every_move_until_cleared():
    layer = foreign("AZ10;MM6,100;MA1000,0;MR0,500;VM;MA0,0;MM;MM6,80;BC;MR0,900;MR900,0;EC;")
    assert [len(road.width) for road in layer.roads] == [1, 1, 2]
    assert codes_of(layer.roads[2]) == pytest.approx(80)


def test_a_change_between_points_adds_one():
    layer = foreign("AZ10;MM6,100;MM500,80;MM-200,60;BC;MA1000,0;EC;")
    (road,) = layer.roads
    np.testing.assert_allclose(road.xy[:, 0] / MICROSTEP, [0, 500, 800, 1000])
    assert codes_of(road) == pytest.approx([100, 80, 60])


def test_arcs_about_a_centre():
    layer = foreign("AZ10;MM6,100;MA0,0;MA1000,0;BC;AA0,0,90;AR0,-1000,-90;EC;")
    road = layer.roads[-1]
    np.testing.assert_allclose(road.xy[-1] / MICROSTEP, (1000, 0), atol=1e-6)
    np.testing.assert_allclose(np.hypot(*road.xy.T), 25.4)


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        ("QQ1;", "line 1: unknown command QQ"),
        ("MA1;", "line 1: MA has 1 numbers, not 2"),
        ("MA40000,0;", "line 1: .* out of range"),
        ("hello world;", "line 1: not SML"),
        ("\n\nMM5,300;", "line 3: MM5,300: a flow code"),
        ("BC;BC;", "line 1: BC inside"),
        ("EC;", "line 1: EC without BC"),
        ("MM6,100;" * 33, "more than 32 output changes"),
        ("BC;" + "MR1,0;" * 201, "more than 200 actions"),
        ("MM6,100;BC;" + "MA30000,0;MA-30000,0;" * 5 + "EC;", "microsteps; 524272 can be"),
        ("MA1,1;", "nothing is deposited"),
        ("MM6,100;MA9,9;", "tell no layer height"),
    ],
)
def test_what_cannot_be_read(commands, message):
    with pytest.raises(InputError, match=message):
        foreign(commands)


def test_a_truncated_file_is_refused_wherever_it_is_cut():
    text = sml.write(small_build(), FDM)
    rng = np.random.default_rng(1)
    for cut in rng.integers(0, len(text) - len("# fdjax end\n"), 40):
        with pytest.raises(InputError):
            sml.read(text[:cut])
    with pytest.raises(InputError, match=r"line \d+: .*truncated"):
        sml.read(text[: text.rindex("EC;")])


@pytest.mark.parametrize("text", ["", "G1 X10 Y10\n", "\0\1\2"])
def test_text_that_is_no_sml(text):
    with pytest.raises(InputError, match="SML"):
        sml.read(text)
    with pytest.raises(InputError, match="SML"):
        sml.read(text, machine=FDM)


def test_the_machine_must_be_known():
    text = sml.write(small_build(), dataclasses.replace(FDM, name="mine"))
    with pytest.raises(InputError, match="machine 'mine' is not a bundled one"):
        sml.read(text)
    assert sml.read(text, machine=FDM).layers
    with pytest.raises(InputError, match="reads no SML"):
        sml.read(text, machine=profile.load("marlin-0.4"))


@pytest.mark.parametrize(
    ("road", "message"),
    [
        (Road([(0, 0), (900, 0)], 0.5), r"layer 1: \(35433, 0\) microsteps .* out of range"),
        (Road([(0, 0), (9, 0)], 2.0), "layer 1: a road 2 mm wide .* flow codes 2 to 254"),
        (Road([(0, 0), (9, 0)], 0.01), "layer 1: a road 0.01 mm wide"),
        (Road([(0, 0), (9, 0)], 0.5, material=2), "layer 1: material 2, but .* has 2"),
    ],
)
def test_what_cannot_be_written(road, message):
    with pytest.raises(InputError, match=message):
        sml.write(build_of(road), FDM)


def test_moves_read_together_are_those_read_one_by_one():
    """Blanks keep lines from being taken together."""
    text = sml.write(sml.fit(small_build(), FDM), FDM)
    assert re.search("MA[^;]*;\nMA", text)
    assert_same(sml.read(text), sml.read(text.replace(";\nMA", ";\n MA")))


@pytest.mark.parametrize(
    ("moves", "line", "wrong"),
    [
        (["MA1,1;"] * 4 + ["MA40000,1;"] + ["MA1,1;"] * 4, 6, "out of range"),
        (["MA1,1;"] * 250, 202, "more than 200 actions"),
        (["MA1,1;"] * 150 + ["MR1,0;"] + ["MA1,1;"] * 60, 202, "more than 200 actions"),
    ],
)
def test_a_fault_among_moves_is_told_with_its_line(moves, line, wrong):
    with pytest.raises(InputError, match=rf"^SML line {line}: .*{wrong}"):
        sml.read("\n".join(["BC;", *moves, "EC;"]), machine=FDM)
