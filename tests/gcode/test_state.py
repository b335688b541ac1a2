"""The G-code interpreter: modes, units, filament, arcs; and that it deposits what a file holds."""

import dataclasses
import math
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.errors import InputError
from fdjax.formats import gcode, profile, read_file, write_file
from fdjax.gcode.firmware import GRBL, KLIPPER, REPRAP
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import code_of, parse
from fdjax.machine.program import Program

sys.path.append(str(Path(__file__).parents[1] / "formats"))
from format_samples import builds, small_build

MARLIN = profile.load("marlin-0.4")
BARE = dataclasses.replace(MARLIN, gcode=dataclasses.replace(MARLIN.gcode, tools=2, prime=()))


def after(*lines, **start):
    """State and moves after these lines."""
    state = GcodeState(**start)
    return state, [move for line in lines for move in state.run(line)]


def deposited(program):
    """Volume along XY moves, what a tool's was pulled back being owed first, mm^3; None where
    nothing is pushed forward.
    """
    state, owed, volume, pushed = program.state(), {}, 0.0, False
    for command in program.commands():
        for move in state.run(command.text):
            pushed = pushed or move.volume > 0
            own = owed.get(state.tool, 0.0) - move.volume
            if own < 0 and move.start != move.end:
                volume -= own
            owed[state.tool] = max(own, 0.0)
    return volume if pushed else None


def volume_of(build):
    return math.fsum(
        road.segment_volumes(layer.height).sum() for layer in build.layers for road in layer.roads
    )


@pytest.mark.parametrize(
    ("code", "name", "words"),
    [
        ("G1 X10 F1200", "G1", {"X": 10, "F": 1200}),
        ("g01x10y-.5", "G1", {"X": 10, "Y": -0.5}),
        ("G28 X", "G28", {"X": 0}),
        ("M117 Layer 3 of 7", "M117", {}),
        ('M862.3 P "MK3S"', "M862.3", {"P": 0}),
        ("SET_FAN_SPEED FAN=x SPEED=0.5", "SET_FAN_SPEED", {}),
        ("G1_MACRO", "G1_MACRO", {}),
        ("$H", "$H", {}),
        ("T1", "T1", {}),
        ("X-1.5Y2", "", {"X": -1.5, "Y": 2}),
    ],
)
def test_commands_are_parsed(code, name, words):
    assert parse(code) == (name, words)


@pytest.mark.parametrize(
    "code", ["?", "G1 X1.2.3", "G", "12", "G1 E1e-5", "M104 T" + "9" * 400, "G1 X1 X2", "G1 X=3"]
)
def test_damaged_commands_are_refused(code):
    with pytest.raises(InputError):
        parse(code)


def test_plain_lines_do_what_all_others_do():
    plain, fast = after("G92 E0", "G1 X1 Y2 E0.5 F600", "G1 X-3 Y4.25 E1.5", "G0 X0 Y0")
    other, slow = after("G92 E0", "G1 F600 X1 Y2 E0.5", "g1 X-3Y4.25E1.5", "G0 Y0 X0")
    assert fast == slow
    assert plain == other


def test_relative_moves_and_units():
    state, moves = after("G20", "G91", "G1 X1 E0.1 F60", "X1 Y-1", "G90", "G21", "G0 Z5")
    assert state.position == (None, None, 5, None)  # G91 says nothing of where they were
    assert (state.x, state.y, state.e) == pytest.approx((50.8, -25.4, 2.54))
    assert [move.speed for move in moves] == pytest.approx([25.4] * 3)
    assert moves[-1].end == pytest.approx((50.8, -25.4, 5))


def test_speed_before_any_is_that_of_marlin():
    assert after("G0 X10")[1][0].speed == 25


def test_position_is_shifted_by_g92_and_not_by_homing():
    state, moves = after("G28", "G1 X10 Y10 Z1", "G92 X0", "G1 X5", "G28 X")
    assert moves[-2].end == (15, 10, 1)
    assert state.on_bed == (0, 10, 1)
    assert state.homed == {"X", "Y", "Z"}
    assert state.unknown == {"X", "E"}


def test_filament_is_absolute_relative_and_reset():
    lines = ["G1 X1 E2", "G1 X2 E3", "G92 E0", "G1 X3 E1", "M83", "G1 X4 E1", "G1 E-0.5 F600"]
    state, moves = after(*lines)
    pushed = [move.volume / state.filament_area for move in moves]
    assert pushed == pytest.approx([2, 1, 1, 1, -0.5])
    assert moves[-1].seconds == pytest.approx(0.05)
    assert moves[-1].start == moves[-1].end


def test_flow_and_diameter_scale_the_volume():
    _, moves = after("M83", "G1 X1 E2", filament_area=3.0, flow=1.5)
    assert moves[0].volume == pytest.approx(4)


def test_heat_fan_tools_and_waits():
    state, moves = after(
        "M140 S60", "M109 R215", "M104 T1 S180", "M106", "T1", "G4 P250", "G4 S2", "M190 S55"
    )
    assert (state.bed, state.nozzles, state.nozzle) == (55, {0: 215, 1: 180}, 180)
    assert state.fan == 255
    assert [move.seconds for move in moves] == [0.25, 2]
    assert after("G10 P1 S200 R150")[0].nozzles == {1: 200}


@pytest.mark.parametrize("name", ["G2", "G3"])
def test_arcs_are_fine_polylines_that_share_the_filament(name):
    turn = 1 if name == "G3" else -1
    state, moves = after("M83", "G1 X10 Y0", f"{name} X0 Y{10 * turn} I-10 J0 E3")
    length = sum(move.length for move in moves[1:])
    assert length == pytest.approx(5 * math.pi, rel=1e-3)
    assert all(math.hypot(*move.end[:2]) == pytest.approx(10) for move in moves[1:])
    assert sum(move.volume for move in moves) == pytest.approx(3 * state.filament_area)
    by_radius = after("M83", "G1 X10 Y0", f"{name} X0 Y{10 * turn} R10 E3")[1]
    assert by_radius[-1].end == pytest.approx(moves[-1].end)
    assert len(by_radius) == len(moves)


@pytest.mark.parametrize("code", ["G2 X5", "G2 X5 R1"])
def test_arcs_without_a_centre_are_refused(code):
    with pytest.raises(InputError):
        after(code)


def test_several_commands_in_a_line():
    lines = ("G21 G91", "G90 G0 X5 Y5 F600", "G1X7M8", "X-1.5")
    state, moves = after(*lines, firmware=GRBL)
    assert state.absolute
    assert [move.end[0] for move in moves] == [5, 7, -1.5]


def test_power_deposits_along_g1_only():
    _, moves = after("M3 S500", "G0 X10", "G1 X20", "M5", "G1 X30", area_per_power=1e-3)
    assert [move.volume for move in moves] == pytest.approx([0, 5, 0])


def test_a_copy_goes_its_own_way():
    state = after("M104 S200")[0]
    other = state.copy()
    other.run("M104 S100")
    other.run("G1 X5")
    assert (state.nozzle, state.x) == (200, 0)


def test_what_a_copy_does_not_know_stays_unknown():
    state = after("G28", "G92 E0")[0]
    other = state.copy()
    state.run("G1 Z40")
    assert other.position == (None, None, None, 0)


@pytest.mark.parametrize("relative", [True, False])
def test_deposits_what_a_file_holds(tmp_path, relative):
    machine = dataclasses.replace(BARE, gcode=dataclasses.replace(BARE.gcode, relative_e=relative))
    path = tmp_path / "part.gcode"
    write_file(small_build(materials=2), path, machine)
    laid = deposited(Program(path, machine))
    assert laid == pytest.approx(volume_of(read_file(path)), rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(build=builds(), data=st.data())
def test_deposits_what_any_file_holds(build, data, tmp_path_factory):
    path = tmp_path_factory.mktemp("any") / "part.gcode"
    path.write_text(gcode.write(build, BARE))
    laid = deposited(Program(path, BARE))
    if laid is not None:
        held = gcode.read(path.read_text(), machine=BARE)
        assert laid == pytest.approx(volume_of(held), rel=1e-9)


@pytest.mark.parametrize(
    ("firmware", "modes", "relative"),
    [
        (None, ["M83", "G90"], False),  # Marlin: G90 and G91 set E's mode too
        (None, ["G91"], True),
        (None, ["G91", "M82"], False),  # and M82 after them sets it again
        (None, ["G90", "M83"], True),
        (KLIPPER, ["M83", "G90"], True),
        (KLIPPER, ["G91"], True),
        (KLIPPER, ["G91", "M82"], True),
        (KLIPPER, ["G91", "G90"], False),
        (REPRAP, ["G91"], False),
        (REPRAP, ["M83", "G90"], True),
    ],
)
def test_the_mode_of_e_is_the_firmwares(firmware, modes, relative):
    state, _ = after("G92 E5", *modes, **({"firmware": firmware} if firmware else {}))
    (move,) = state.run("G1 X10 E6")
    assert move.volume / state.filament_area == pytest.approx(6 if relative else 1)


def test_flow_of_each_tool():
    lines = ("M83", "M221 S50", "M221 T1 S200", "G1 X1 E1", "T1", "G1 X2 E1", "T2", "G1 X3 E1")
    state, moves = after(*lines)
    assert [move.volume / state.filament_area for move in moves] == pytest.approx([0.5, 2, 1])
    assert state.e == 3  # what the machine reports is not scaled


def test_volumetric_e_is_what_is_deposited():
    lines = ("M83", "M200 D1.75", "G1 X1 E2", "M200 S0", "G1 X2 E1", "M200 S1", "G1 X3 E2")
    _, moves = after(*lines, "M200 D0", "G1 X4 E1", filament_area=3.0)
    assert [move.volume for move in moves] == pytest.approx([2, 3, 2, 3])
    (move,) = after("M83", "M200 D1.75", "M221 S50", "G20", "G1 X1 E2")[1]
    assert move.volume == pytest.approx(25.4**3)  # cubic inches


def test_speed_factor_scales_the_speed_until_it_is_brought_back():
    lines = ("G1 X1 F600", "M220 S50", "G1 X2", "M220 B S200", "G1 X3 F600", "M220 R", "G1 X4")
    state, moves = after(*lines)
    assert [move.speed for move in moves] == pytest.approx([10, 5, 20, 5])
    assert state.speed == 10


def test_absolute_e_goes_on_after_a_change_of_tool():
    state, moves = after("G1 X1 E2", "T1", "G1 X2 E3")
    assert moves[1].volume == pytest.approx(state.filament_area)


def test_klippers_tools_begin_anew():
    """E counts from 0 and M221 ends; the tool that is in use already changes nothing."""
    for line, pushed, flow in (
        ("T1", 3, 1),
        ("ACTIVATE_EXTRUDER EXTRUDER=extruder1", 3, 1),
        ("T0", 2, 2),
    ):
        state = GcodeState(KLIPPER)
        made = [m for code in ("M221 S200", "G1 E2", line, "G1 E3") for m in state.run(code)]
        assert made[1].volume / state.filament_area == pytest.approx(pushed)
        assert (state.e, state.flow_factor) == (3, flow)


def test_each_tool_has_its_filament():
    _, moves = after("M83", "G1 X1 E1", "T1", "G1 X2 E1", areas={0: 2.0, 1: 5.0})
    assert [move.volume for move in moves] == [2, 5]


@pytest.mark.parametrize(
    "text",
    ["M117 Take T1 then T2", "M0 Insert the nuts", "M1 to go on, press", "M118 E1 A1 E2", "M117 E"],
)
def test_texts_are_no_words(text):
    name = text.split()[0]
    assert parse(text) == (name, {})
    state, moves = after(text)
    assert not moves
    assert state.tool == 0


def test_a_message_keeps_its_parentheses():
    assert code_of("N3 M117 Layer (2) of 9 ; aside") == "M117 Layer (2) of 9"
    assert code_of("G1 (a; b) X1 ; c") == "G1  X1"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("G1 X1 E6.65e-01", "'E6.65e-01' has an exponent"),
        ("G1 X1 E6.65E-01", "'E6.65E-01' has an exponent"),
        ("G1 X1e-5 Y2", "'X1e-5' has an exponent"),
        ("G1 X1 A0.6", "A0.6 moves an axis that is not known"),
        ("G1 X1 E", "'E' is no letter with a number"),
        ("X1 E2", "'X1 E2' goes on with no motion"),
        ("G90 G1 X5", "G1 stands behind G90"),
        ("G1 X5 M106", "M106 stands behind G1"),
        ("G18", ""),
    ],
)
def test_what_cannot_be_followed(line, message):
    if message:
        with pytest.raises(InputError, match=message):
            after(line)
    else:
        with pytest.raises(InputError, match="out of the XY plane"):
            after(line, "G2 X5 R5")


def test_compact_lines_have_no_exponents():
    assert parse("G1X1E-5") == ("G1", {"X": 1, "E": -5})
    assert parse("g1x1e-5") == ("G1", {"X": 1, "E": -5})


def test_words_alone_go_on_with_the_last_motion():
    state, moves = after("M83", "G1 F600", "X10 E1", "G0 X0", "Y5")
    assert [move.end[:2] for move in moves] == [(0, 0), (10, 0), (0, 0), (0, 5)]
    assert moves[1].volume == pytest.approx(state.filament_area)
    assert after("X5", firmware=GRBL)[1][0].end[0] == 5


def test_fans_have_numbers():
    state, _ = after("M106 S100", "M106 P2 S255", "M107")
    assert state.fans == {0: 0, 2: 255}


def test_accelerations_are_those_of_m204():
    assert after("M204 S500 T800", "M204 R300")[0].accelerations == {"P": 500, "T": 800, "R": 300}


def test_splines_are_those_of_marlin():
    state, moves = after("M83", "G1 X10 Y0", "G5 X20 Y0 I3 J0 P-3 Q0 E2")
    assert moves[-1].end == (20, 0, 0)
    assert {move.end[1] for move in moves} == {0}
    _, moves = after("M83", "G5 X10 Y10 I0 J5 P-5 Q0 E2")
    bend = [(move.end[0], move.end[1]) for move in moves]
    t = 0.5  # the cubic (0, 0), (0, 5), (5, 10), (10, 10)
    middle = 3 * t * (1 - t) ** 2 * 0 + 3 * t**2 * (1 - t) * 5 + t**3 * 10
    assert min(math.dist(place, (middle, 10 - middle)) for place in bend) < 0.1
    assert sum(move.volume for move in moves) == pytest.approx(2 * state.filament_area)
    lengths = [move.length for move in moves]
    assert [m.volume / n for m, n in zip(moves, lengths, strict=True)] == pytest.approx(
        [moves[0].volume / lengths[0]] * len(moves)
    )


@pytest.mark.parametrize("firmware", [KLIPPER, REPRAP, GRBL])
def test_splines_of_firmware_without_them_are_refused(firmware):
    with pytest.raises(InputError, match="G5 is a spline"):
        after("G5 X10 I1 J1 P1 Q1 E1", firmware=firmware)


@pytest.mark.parametrize(
    "line",
    [
        "o100 repeat [5]", "O1 sub", "M808 L5", "while iterations < 5", "var a = 1", "G55",
        "G68 R90", "G90.1", "M605 S2", "RESTORE_GCODE_STATE NAME=a", "M32 other.g", "G6 X1 E1",
    ],
)  # fmt: skip
def test_programs_and_zeros_that_cannot_be_followed_are_named(line):
    word = line.split()[0].upper()
    with pytest.raises(InputError, match=word):
        after(line)


def test_the_end_of_a_shift_matters_only_where_there_is_one():
    after("G92.1", "G1 X5")
    with pytest.raises(InputError, match=r"G92\.1 ends the shift"):
        after("G92 X10", "G92.1")
