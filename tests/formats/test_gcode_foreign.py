import dataclasses
import math

import numpy as np
import pytest

from fdjax.errors import InputError
from fdjax.formats import gcode, profile, read_file
from fdjax.road.bead import road_width

AREA = math.pi / 4 * 1.75**2


def read(text, **options):
    return gcode.read(text, **{"filament": 1.75, **options})


def only_road(text, **options):
    build = read(text, **options)
    (layer,) = build.layers
    (road,) = layer.roads
    return road


def volume(text, **options):
    return read(text, **options).volume / AREA


def test_width_is_the_volumes():
    road = only_road("G1 Z0.2\nG1 X10 Y0 E0.3\nG1 X10 Y20 E1.5\n", layer_height=0.2)
    expected = road_width(np.array([0.03, 0.06]) * AREA, 0.2)
    np.testing.assert_allclose(road.width, expected, rtol=1e-12)
    np.testing.assert_array_equal(road.xy, [(0, 0), (10, 0), (10, 20)])


def test_layers_are_those_of_z():
    text = "M83\n" + "".join(
        f"G0 Z{z}\nG0 X0 Y0\nG1 X10 E1\nG0 Y5\nG1 X0 E1\n" for z in (0.3, 0.5, 0.7)
    )
    build = read(text)
    np.testing.assert_allclose([layer.z for layer in build.layers], [0.3, 0.5, 0.7])
    np.testing.assert_allclose([layer.height for layer in build.layers], [0.3, 0.2, 0.2])
    assert [len(layer.roads) for layer in build.layers] == [2, 2, 2]
    assert [layer.height for layer in read(text, layer_height=0.25).layers] == [0.25] * 3


def test_line_numbers_checksums_comments_and_case():
    plain = "G1 Z0.2\nG1 X10 Y0 E1\nG1 X10 Y20 E3\n"
    framed = (
        "; made by hand\nN1 G1 Z0.2*55\nN2 g1 x10 y0 (a note; here) e1*77\n"
        "  N3   G1X10Y20E3 ; G1 X99 E99\nM117 (ready) N7 X*\n\n%\nSTART_PRINT BED=60\n"
    )
    np.testing.assert_array_equal(only_road(framed).xy, only_road(plain).xy)
    assert volume(framed) == pytest.approx(volume(plain)) == pytest.approx(3.0)


def test_inches():
    road = only_road("G20\nG1 Z0.01\nG1 X1 Y0 E0.1\nG21\nG1 X50.8 E3\n")
    np.testing.assert_allclose(road.xy, [(0, 0), (25.4, 0), (50.8, 0)])
    assert road.segment_volumes(0.254) / AREA == pytest.approx([2.54, 0.46])


def test_relative_moves_and_offsets():
    text = (
        "G1 Z0.2\nG1 X5 Y5\nG92 X0 Y0 E10\nM83\nG1 X10 Y0 E1\nG91\nG1 X0 Y10 E1\n"
        "G90\nM83\nG1 X0 Y10 E1\n"
    )
    road = only_road(text)
    np.testing.assert_allclose(road.xy, [(5, 5), (15, 5), (15, 15), (5, 15)])
    assert road.segment_volumes(0.2) / AREA == pytest.approx([1, 1, 1])


def test_g91_makes_e_relative_until_g90():
    assert volume("G1 Z0.2 E5\nG91\nG1 X10 E1\nG1 X10 E1\nG90\nG1 X0 E8\n") == pytest.approx(3.0)


def test_retraction_unretraction_and_wipe_are_no_deposit():
    text = (
        "M83\nG1 Z0.2\nG1 E5\nG1 X10 E1\nG1 E-2\nG0 X20\nG1 E2\nG1 X30 E1\n"
        "G1 X28 E-0.5\nG1 E-1\nG0 X0 Y5\nG1 E1.5\nG1 X10 E1\nG10\nG0 Y9\nG11\nG1 X0 E1\n"
    )
    assert volume(text) == pytest.approx(4.0)
    assert len(read(text).layers[0].roads) == 4


def test_filament_that_is_owed_comes_first():
    assert volume("M83\nG1 Z0.2\nG1 E-1\nG1 X10 E1.5\n") == pytest.approx(0.5)


def test_tools_share_one_absolute_e_as_in_marlin():
    text = "G1 Z0.2\nG1 X10 E5\nT1\nG1 X20 E7\nG1 E5.5\nT0\nG1 E5\nG1 X30 E6\nT1\nG1 X40 E9\n"
    build = read(text)
    assert [road.material for road in build.layers[0].roads] == [0, 1, 0, 1]
    volumes = [road.segment_volumes(0.2).sum() / AREA for road in build.layers[0].roads]
    assert volumes == pytest.approx([5, 2, 0.5, 1.5])  # each tool returns first what it owes


@pytest.mark.parametrize(
    "arc",
    ["G3 X0 Y20 I0 J10 E3", "G3 X0 Y20 R10 E3", "G91\nG3 X0 Y20 I0 J10 E3"],
)
def test_arcs_become_fine_polylines(arc):
    road = only_road(f"G1 Z0.2\n{arc}\n")
    assert np.abs(np.hypot(*(road.xy - [0, 10]).T) - 10).max() < 1e-9
    middles = (road.xy[1:] + road.xy[:-1]) / 2
    assert np.hypot(*(middles - [0, 10]).T).min() > 10 - 0.01
    assert road.xy[:, 0].max() == pytest.approx(10, abs=0.02)  # to the right: counter-clockwise
    assert np.ptp(road.width) < 1e-6
    assert road.segment_volumes(0.2).sum() / AREA == pytest.approx(3)


def test_arcs_turn_the_right_way():
    clockwise = only_road("G1 Z0.2\nG2 X0 Y20 I0 J10 E3\n")
    assert clockwise.xy[:, 0].min() == pytest.approx(-10, abs=0.02)
    short = only_road("G1 Z0.2\nG2 X10 Y10 R10 E1\n")
    long = only_road("G1 Z0.2\nG2 X10 Y10 R-10 E1\n")
    assert short.length == pytest.approx(5 * math.pi, rel=1e-3)
    assert long.length == pytest.approx(15 * math.pi, rel=1e-3)
    circle = only_road("G1 Z0.2\nG3 X0 Y0 I5 J0 E1\n")
    assert circle.closed
    assert circle.length == pytest.approx(10 * math.pi, rel=2e-3)


def test_loops_are_closed_roads():
    road = only_road("M83\nG1 Z0.2\nG1 X9 E1\nG1 X9 Y9 E1\nG1 Y9 X0 E1\nG1 X0 Y0 E1\n")
    assert road.closed
    assert road.xy.shape == (4, 2)


def test_what_stands_before_the_first_layer_mark_is_priming():
    text = "M83\nG1 Z0.3\nG1 X99 E9\n;LAYER:0\nG0 X0 Y0 Z0.2\nG1 X10 E1\n;LAYER:1\nG0 Z.4\nG1 X0 E1"
    build = read(text)
    assert [layer.z for layer in build.layers] == [0.2, 0.4]
    assert build.volume == pytest.approx(2 * AREA)


def test_filament_from_the_profile():
    text = "G1 Z0.2\nG1 X10 E1\n"
    machine = profile.load("marlin-0.4")
    assert gcode.read(text, machine=machine).volume == pytest.approx(AREA)
    with pytest.raises(InputError, match="filament's diameter"):
        gcode.read(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not G-code"),
        ("hello\nworld\n", "not G-code: no G, M or T command in its 2 lines"),
        ("G1 X1\0", "binary"),
        ("G28\nG1 X10 Y10\nG1 E5\n", "nothing is deposited in its 3 lines"),
        ("G1 Z0.2\nG1 X1..2 E1\n", r"line 2: '.2 E1' is no letter"),
        ("G1 Z0.2\nG1 X10 E\n", r"line 2: 'E' is no letter"),
        ("G1 Z0.2\nG1 X10 ?5\n", r"line 2: "),
        ("G1 Z0.2\nG2 X10 Y0 E1\n", "line 2: an arc needs I and J"),
        ("G1 Z0.2\nG2 X10 Y0 R3 E1\n", "line 2: no arc of radius 3 mm"),
        ("G18\nG2 X10 Y0 I5 E1\n", "line 2: .* G18"),
        ("G1 X10 E1\n", "Z = 0 mm tell no layer height"),
        ("G1 Z0.2\nG1 X10 Z0.4 E1\n", "line 2: deposits while Z moves"),
    ],
)
def test_what_cannot_be_read(text, message):
    with pytest.raises(InputError, match=message):
        read(text)


@pytest.mark.parametrize("options", [{"filament": 0.0}, {"layer_height": -1.0}])
def test_absurd_options(options):
    with pytest.raises(InputError, match="positive length"):
        read("G1 Z0.2\nG1 X10 E1\n", **options)


def test_flow_and_volumetric_e_scale_what_is_read():
    text = "M83\nG1 Z0.2\nG1 X10 E1\nM221 S50\nG0 Y5\nG1 X0 E1\n"
    assert volume(text) == pytest.approx(1.5)
    text = "M200 D1.75\nM83\nG1 Z0.2\nG1 X10 E2\n"
    assert gcode.read(text).volume == pytest.approx(2)
    assert read(text).volume == pytest.approx(2)


def test_g90_makes_e_absolute_as_in_marlin_unless_the_machine_runs_another():
    text = "M83\nG90\nG1 Z0.2\nG1 X10 E1\nG1 X20 E2\n"
    assert volume(text) == pytest.approx(2)
    marlin = profile.load("marlin-0.4")
    stream = dataclasses.replace(marlin.stream, firmware="klipper")
    klipper = dataclasses.replace(marlin, stream=stream)
    assert volume(text, machine=klipper) == pytest.approx(3)


def test_lines_without_a_command_go_on():
    assert volume("M83\nG1 Z0.2\nG1 F600\nX10 Y0 E1\nX10 Y9 E1\n") == pytest.approx(2)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("G1 X10 E6.65e-01", "line 2: 'E6.65e-01' has an exponent"),
        ("G1 X10 A0.6", "line 2: A0.6 moves an axis that is not known"),
        ("G90 G1 X5 E1", "line 2: G1 stands behind G90"),
    ],
)
def test_what_cannot_be_followed_is_named(line, message):
    with pytest.raises(InputError, match=message):
        read(f"G1 Z0.2\n{line}\n")


@pytest.mark.parametrize("text", ["M0 Insert the nuts T T", "M117 E1 E2 ?", "M600", "M73 P% R5"])
def test_messages_and_what_is_not_followed_are_passed_over(text):
    assert volume(f"M83\nG1 Z0.2\nG1 X10 E1\n{text}\nG1 X20 E1\n") == pytest.approx(2)


def test_a_diameter_for_each_tool():
    text = "M83\nG1 Z0.2\nT0\nG1 X10 E1\nT1\nG0 Y2\nG1 X0 E1\n; filament_diameter = 1.75,2.85\n"
    both = math.pi / 4 * (1.75**2 + 2.85**2)
    assert gcode.read(text).volume == pytest.approx(both)
    assert gcode.read(text, filament=[1.75, 2.85]).volume == pytest.approx(both)
    assert read(text).volume == pytest.approx(2 * AREA)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_files_that_an_editor_rewrote(tmp_path, encoding):
    path = tmp_path / "part.gcode"
    path.write_text("; made by hand\nM83\nG1 Z0.2\nG1 X10 E1\n", encoding=encoding)
    assert read_file(path, filament=1.75).volume == pytest.approx(AREA)
