"""The SML interpreter: paths, flow in pieces, waits; and that it deposits what a file holds."""

import math
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings

from fdjax.errors import InputError
from fdjax.formats import profile, sml
from fdjax.machine.program import Program
from fdjax.machine.sml_state import SmlState
from fdjax.units import MICROSTEP

sys.path.append(str(Path(__file__).parents[1] / "formats"))
from format_samples import builds, small_build

MACHINE = profile.load("stratasys-fdm1650")
AREA = MACHINE.sml.area_per_code


def after(*lines):
    """State and moves after these lines."""
    state = SmlState(MACHINE.sml)
    return state, [move for line in lines for move in state.run(line)]


def volume_of(build):
    return math.fsum(
        road.segment_volumes(layer.height).sum() for layer in build.layers for road in layer.roads
    )


def codes(moves):
    """Code and length in microsteps of the moves that are not waits."""
    return [
        (round(move.volume / move.length / AREA, 9), round(move.length / MICROSTEP, 6))
        for move in moves
        if not move.seconds
    ]


def test_moves_are_in_microsteps_absolute_and_relative():
    state, moves = after("FH;SR800;AZ10;", "MA1000,0;mr 0 500;", "MZ5;")
    assert (state.x, state.y, state.z) == (1000, 500, 15)
    assert state.homed
    assert state.position == pytest.approx((25.4, 12.7, 0.381, 0))
    assert [move.speed for move in moves[1:]] == pytest.approx([20.32] * 4)


def test_a_command_may_span_lines():
    state, moves = after("MA1000", ",200", "0;MA0,0;")
    assert len(moves) == 2
    assert moves[0].end == pytest.approx((25.4, 50.8, 0))
    assert state.rest == ""


def test_a_path_moves_at_its_end():
    state = SmlState(MACHINE.sml)
    assert state.run("BC;MA100,0;MA100,100;") == ()
    assert len(state.run("EC;")) == 2
    assert state.path is None


def test_the_head_waits_before_each_move_until_that_is_cleared():
    _, moves = after(">PD.08,41;MA100,0;MA200,0;PD;MA300,0;", "WA1.5;")
    assert [move.seconds for move in moves] == [0.08, 0, 0.08, 0, 0, 1.5]


def test_the_first_even_code_holds_from_the_start_and_odd_ones_change_nothing():
    _, moves = after("MM;MM0,53;MM6,100;MM-70,175;", "MA1000,0;")
    assert codes(moves) == [(100, 1000)]


def test_codes_change_at_their_places():
    _, moves = after("MM;MM0,53;MM6,100;MM300,40;MM-200,60;BC;MA500,0;MA500,500;EC;")
    assert codes(moves) == [(100, 300), (40, 200), (40, 300), (60, 200)]


def test_a_place_within_a_microstep_of_a_point_is_the_point():
    _, moves = after("MM;MM6,100;MM141,40;BC;MA100,100;MA200,100;EC;")
    assert codes(moves) == [(100, pytest.approx(141.421356)), (40, 100)]


def test_suspended_and_cleared_flow_lays_nothing():
    _, moves = after("MM6,100;MA100,0;VM;MA200,0;MM;MA300,0;MM6,100;MA400,0;")
    assert [code for code, _ in codes(moves)] == [100, 0, 0, 100]


def test_arcs_turn_about_their_centre():
    state, moves = after("MA1000,0;", "AA0,0,90;")
    assert (state.x, state.y) == pytest.approx((0, 1000), abs=1e-9)
    assert sum(move.length for move in moves[1:]) == pytest.approx(
        500 * math.pi * MICROSTEP, rel=1e-3
    )
    assert after("MA1000,0;AR-1000,0,90;")[0].y == pytest.approx(1000)


def test_materials_are_those_of_the_profile():
    assert after("sp2;")[0].material == 1
    assert after("MA1,1;")[0].material is None


def test_a_copy_goes_its_own_way():
    state = after("BC;MA1,1;")[0]
    other = state.copy()
    other.run("MA2,2;EC;")
    assert state.path == ((0, 0), (1, 1))


@pytest.mark.parametrize(
    "text",
    [
        "MA1;",
        "MA1,2,3;",
        "AA1,2;",
        "AA0,9000000,9;",
        "MA1,-;",
        "MA" + "9" * 400 + "x;",
        "MM1,2" + "0" * 400 + ";",
        "M1,2;",
        "QQ1;",
        "EC;",
        "BC;BC;",
        "MM0,256;",
        "SR;",
        "x" * 2000,
    ],
)
def test_damaged_commands_are_refused(text):
    with pytest.raises(InputError):
        after(text)


def run(path):
    program = Program(path, MACHINE)
    state = program.state()
    moves = [move for command in program.commands() for move in state.run(command.text)]
    assert all(move.volume >= 0 for move in moves)
    return math.fsum(move.volume for move in moves)


def test_deposits_what_a_file_holds(tmp_path):
    path = tmp_path / "part.sml"
    path.write_text(sml.write(small_build(materials=2), MACHINE))
    assert run(path) == pytest.approx(volume_of(sml.read(path.read_text())), rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(build=builds())
def test_deposits_what_any_file_holds(build, tmp_path_factory):
    path = tmp_path_factory.mktemp("any") / "part.sml"
    path.write_text(sml.write(build, MACHINE))
    laid = run(path)
    if laid:
        assert laid == pytest.approx(volume_of(sml.read(path.read_text())), rel=1e-9)
