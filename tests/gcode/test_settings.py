"""What a file has in force: noted whoever's word it is, and written down again from the record."""

import pytest

from fdjax.errors import InputError
from fdjax.gcode import rebuild
from fdjax.gcode.firmware import GRBL, KLIPPER, MARLIN, REPRAP
from fdjax.gcode.settings import lines
from fdjax.gcode.state import GcodeState

HOMED = ("G28", "G1 X0 Y0 Z5 F3000")


def after(firmware, *text, **start):
    state = GcodeState(firmware, **start)
    for line in text:
        state.run(line)
    return state


def rebuilt(state, tools=1):
    """A printer that was switched on and told what is in force, where `state` is."""
    other = GcodeState(state.firmware)
    other.on_bed = state.on_bed
    for line in (
        *rebuild.DIRECT,
        *rebuild.heat_all(state, heaters=tools),
        *rebuild.set_before_homing(state, tools=tools),
        *rebuild.set_after_homing(state),
        *rebuild.saved_states(state),
        *rebuild.place(state),
        *rebuild.modes(state, extruder=True),
        *rebuild.extruder_as_it_was(state),
    ):
        other.run(line)
    return other


@pytest.mark.parametrize(
    ("firmware", "text", "kept"),
    [
        (MARLIN, ["M201 X900 Y900", "M201 Z50"], ["M201 X900 Y900 Z50"]),
        (MARLIN, ["M204 P500 T800", "M204 S400", "M204 R60"], ["M204 S400 R60"]),
        (MARLIN, ["M205 X6", "M900 K.06", "M205 Y5"], ["M900 K.06", "M205 X6 Y5"]),
        (MARLIN, ["M900 T1 K.1", "M900 K.2"], ["M900 T1 K.1", "M900 T0 K.2"]),
        (MARLIN, ["T1", "M900 K.3"], ["M900 T1 K.3"]),
        (MARLIN, ["G20", "M205 X.5", "G21", "M205 X6"], ["G20", "M205 X.5", "G21", "M205 X6"]),
        (MARLIN, ["M200 D1.75", "M200 S0", "M200 D2"], ["M200 D2"]),
        (MARLIN, ["M420 S1 Z3 V", "M420 Z5"], ["M420 S1 Z5"]),
        (MARLIN, ["M420 S1", "G28"], []),
        (MARLIN, ["G28", "G29"], ["M420 S1"]),
        (MARLIN, ["M204", "M205"], []),
        (MARLIN, ["M220 S80", "M221 T1 S92"], ["M220 S80", "M221 T1 S92"]),
        (MARLIN, ["M302 P1", "M302 S80"], ["M302 S80"]),
        (MARLIN, ["M486 T3", "M486 S1", "M486 S2"], ["M486 T3"]),
        (REPRAP, ["M566 X600 Y600 E300:300", "M572 D0:1 S.05"], None),
        (REPRAP, ["M566 X600", "M566 Y300"], ["M566 X600 Y300"]),
        (REPRAP, ["G29", "G28"], ["G29 S1"]),
        (REPRAP, ["G29 S1", "G29 S2"], ["G29 S2"]),
        (KLIPPER, ["SET_PRESSURE_ADVANCE ADVANCE=.05"], ["SET_PRESSURE_ADVANCE ADVANCE=.05"]),
        (
            KLIPPER,
            ["SET_VELOCITY_LIMIT ACCEL=500 VELOCITY=90", "M204 S300", "SET_VELOCITY_LIMIT ACCEL=1"],
            ["M204 S300", "SET_VELOCITY_LIMIT ACCEL=1 VELOCITY=90"],
        ),
        (
            KLIPPER,
            ["EXCLUDE_OBJECT_DEFINE NAME=a CENTER=1,2", "EXCLUDE_OBJECT_START NAME=a"],
            ["EXCLUDE_OBJECT_DEFINE NAME=a CENTER=1,2"],
        ),
        (KLIPPER, ["EXCLUDE_OBJECT_START NAME=a", "EXCLUDE_OBJECT_END NAME=a"], []),
        (KLIPPER, ["BED_MESH_PROFILE LOAD=pei", "BED_MESH_CLEAR"], ["BED_MESH_CLEAR"]),
        (KLIPPER, ["SET_FAN_SPEED FAN=a SPEED=1", "SET_FAN_SPEED FAN=b SPEED=0"], None),
    ],
)
def test_settings_hold_until_they_are_given_again(firmware, text, kept):
    state = after(firmware, *text)
    tools = 2 if any("T1" in line for line in text) else 1
    assert lines(state.settings, tools=tools) == (text if kept is None else kept)
    assert after(firmware, *lines(state.settings, tools=2)).settings == state.settings


def test_known_settings_leave_the_place_known_and_macros_do_not():
    assert after(KLIPPER, *HOMED, "SET_PRESSURE_ADVANCE ADVANCE=.1", "G10", "G11").placed
    assert not after(KLIPPER, *HOMED, "CLEAN_NOZZLE").placed
    assert after(KLIPPER, *HOMED, "SET_GCODE_OFFSET Z=.1").placed


@pytest.mark.parametrize(
    ("firmware", "text"),
    [
        (MARLIN, [*HOMED, "M141 S40", "M104 T1 S180", "M106 P2 S90", "G92 X3 E7", "M82", "G20"]),
        (MARLIN, [*HOMED, "M302 S90", "M200 D1.75", "M220 S70", "M221 S95", "M203 X100", "M106"]),
        (KLIPPER, [*HOMED, "SET_GCODE_OFFSET Z=0.15 X=1", "G92 X3", "M83", "M221 S95", "M204 S50"]),
        (
            KLIPPER,
            [
                *(*HOMED, "G92 X1 E3", "M220 S50", "SAVE_GCODE_STATE NAME=a", "M220 S100"),
                *("M83", "G91", "G1 X5 F600", "SET_HEATER_TEMPERATURE HEATER=extruder TARGET=200"),
            ],
        ),
        (REPRAP, [*HOMED, "M83", "M120", "G91", "G1 F600", "M120", "G90", "G1 X4 F1200"]),
    ],
)
def test_a_printer_is_rebuilt_from_the_record_alone(firmware, text):
    state = after(firmware, *text)
    other = rebuilt(state, tools=2)
    for name in (
        *("absolute", "relative_e", "scale", "speed", "speed_factor", "flow_factor", "volumetric"),
        *("offset", "nozzles", "bed", "chamber", "accelerations", "coldest", "gain"),
    ):
        assert getattr(other, name) == pytest.approx(getattr(state, name)), name
    assert {k: w for k, w in other.settings.items() if k[0] not in ("M220", "M221")} == {
        k: w for k, w in state.settings.items() if k[0] not in ("M220", "M221")
    }
    assert other.fans == {0: 0} | state.fans
    assert (other.x, other.y, other.z, other.e) == pytest.approx(
        (state.x, state.y, state.z, state.e)
    )
    assert other.saved.keys() == state.saved.keys()
    for name, saved in state.saved.items():
        again = other.saved[name]
        fields = [f for f in saved._fields if f not in ("on_bed", "flows", *_not_kept(firmware))]
        assert [getattr(again, f) for f in fields] == [
            pytest.approx(getattr(saved, f)) for f in fields
        ]


def _not_kept(firmware):
    """What M120 does not bring back."""
    return ("shift", "offset", "e", "speed_factor") if firmware is REPRAP else ()


def test_klippers_saved_state_brings_modes_back_and_moves_only_if_asked():
    state = after(KLIPPER, *HOMED, "G1 E3", "SAVE_GCODE_STATE NAME=a", "G91", "M83", "G1 X9 E1 F60")
    state.run("RESTORE_GCODE_STATE NAME=a")
    assert (state.absolute, state.relative_e, state.speed, state.x) == (True, False, 50, 9)
    (move,) = state.run("G1 E4")
    assert move.volume == pytest.approx(state.gain)  # E goes on as a coordinate
    (move,) = state.run("RESTORE_GCODE_STATE NAME=a MOVE=1")
    assert (move.end, state.x) == ((0, 0, 5), 0)


def test_marlins_saved_place_is_all_that_comes_back():
    state = after(MARLIN, *HOMED, "G1 X5 Y6", "G60", "G60 S1", "G91", "G1 X5 Y5")
    (move,) = state.run("G61 X")
    assert (move.end, state.absolute) == ((5, 11, 5), False)
    assert state.run("G61 S1")[0].end == (5, 6, 5)


def test_rrf_stacks_modes():
    state = after(REPRAP, *HOMED, "M120", "G91", "M83", "G1 X5 F60", "M121")
    assert (state.absolute, state.relative_e, state.speed, state.x) == (True, False, 50, 5)


@pytest.mark.parametrize(
    ("firmware", "line"),
    [
        (KLIPPER, "RESTORE_GCODE_STATE NAME=x"),
        (MARLIN, "G61 S3"),
        (REPRAP, "M121"),
    ],
)
def test_a_state_that_was_never_saved_is_refused(firmware, line):
    with pytest.raises(InputError, match="no state of that name was saved"):
        after(firmware, line)


@pytest.mark.parametrize(
    ("firmware", "line", "seconds"),
    [
        (MARLIN, "G4 P500 S1", 1),
        (MARLIN, "G4 P500", 0.5),
        (KLIPPER, "G4 S2", 0),
        (KLIPPER, "G4 P250 S2", 0.25),
        (REPRAP, "G4 S2", 2),
        (GRBL, "G4 P1.5", 1.5),
    ],
)
def test_waits_are_the_firmwares(firmware, line, seconds):
    assert GcodeState(firmware).run(line)[0].seconds == seconds


@pytest.mark.parametrize(
    ("firmware", "lines", "message"),
    [
        (KLIPPER, ["G1 X5", "G2 X0 R3"], "no arcs with R"),
        (KLIPPER, ["G91", "G2 X5 I2.5"], "no arcs with G91"),
        (KLIPPER, ["G20"], "millimetres only"),
        (KLIPPER, ["G1 X5 F0"], "no speed"),
        (KLIPPER, ["G1 F-60"], "no speed"),
        (GRBL, ["G1 X5 E1 F100"], "grbl has no E"),
        (GRBL, ["M900 K1"], "unknown to grbl"),
        (GRBL, ["G4 S1"], "waits by G4 P alone"),
        (GRBL, ["G4"], "waits by G4 P alone"),
        (GRBL, ["G1 X1 F0"], "no speed"),
        (GRBL, ["G0 X1", "G1 X5"], "no G1 before an F"),
        (GRBL, ["G2 X1 I.5"], "no G2 before an F"),
        (KLIPPER, ["EXCLUDE_OBJECT CURRENT=1"], "no current object"),
        (KLIPPER, ["SET_VELOCITY_LIMIT ACCEL=a"], "must be numbers"),
    ],
)
def test_what_a_firmware_refuses(firmware, lines, message):
    with pytest.raises(InputError, match=message):
        after(firmware, *lines)


def test_no_speed_is_ignored_or_the_slowest():
    assert after(MARLIN, "G1 X1 F600", "G1 X2 F0").speed == 10
    assert after(REPRAP, "G1 X1 F600", "G1 X2 F0").pace < 0.01


def test_klippers_arcs_are_chords_and_small_circles_vanish():
    state = after(KLIPPER, "M83", "G1 X10 Y0")
    assert len(state.run("G3 X0 Y10 I-10 E3")) == 15
    (move,) = state.run("G3 I.3 E1")
    assert (move.length, move.volume) == (0, pytest.approx(state.gain))


def test_one_acceleration_of_klipper():
    assert after(KLIPPER, "M204 P500 T300").accelerations == {"P": 300, "T": 300}
    assert after(KLIPPER, "M204 P500").accelerations == {}
    assert after(KLIPPER, "SET_VELOCITY_LIMIT ACCEL=70").accelerations == {"P": 70, "T": 70}


def test_fans_of_a_firmware():
    assert after(KLIPPER, "M106 P2 S90").fans == {0: 90}
    assert after(REPRAP, "M106 P1 H1 T45", "M106 P0 S1").fans == {0: 1}


def test_the_highest_deposit_is_that_of_the_whole_bed():
    state = after(
        MARLIN, *("M83", "G28", "G1 Z30 F600", "G1 X10 E1", "G1 Z40", "G1 E2", "G1 X20", "G1 Z.2")
    )
    assert state.top == 30
    state.run("g1 x30 e1")
    assert state.top == 30
    state.run("G92 Z0")
    state.run("G1 Z40.1 X5 E.1")
    assert state.top == pytest.approx(40.3)


def test_what_a_firmware_does_not_know_changes_nothing():
    state = after(KLIPPER, "M200 D1.75", "M205 X5", "M302 P1", "M203 X9")
    assert (state.volumetric, state.settings, state.coldest) == (False, {}, None)
