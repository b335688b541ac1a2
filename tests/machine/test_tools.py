"""Prints of two tools, as fdjax writes them: streamed, cut in the midst of a layer, disturbed."""

import dataclasses

import klippy
import numpy as np
import pytest
import shapely
from test_going_on import Bench, compared

from fdjax.formats import profile, write_file
from fdjax.machine import virtual
from fdjax.machine.program import Program
from fdjax.machine.survey import survey
from fdjax.machine.virtual.port import VirtualPort
from fdjax.plan.toolpath import Build, Layer, Road

DUAL = profile.load("marlin-0.4-dual")
FIRMWARES = pytest.mark.parametrize("firmware", ["marlin", "klipper", "rrf"])


def machine_of(firmware, *, one_nozzle=False):
    """The machine with two tools, also with one nozzle for both, the second hotter."""
    first, second = DUAL.gcode.tool
    if one_nozzle:
        first, second = (
            dataclasses.replace(DUAL.gcode.tool[0], standby=0, nozzle=heat, park=20.0)
            for heat in (210, 225)
        )
    tables = dataclasses.replace(DUAL.gcode, one_nozzle=one_nozzle, tool=(first, second))
    stream = dataclasses.replace(DUAL.stream, firmware=firmware)
    return dataclasses.replace(DUAL, gcode=tables, stream=stream)


def program_of(path, machine):
    """Four layers of six roads, half of each tool."""

    def road(k):
        return Road(np.array([(0.0, k), (15.0, k), (30.0, k + 0.5)]), 0.4, material=k // 3)

    layers = []
    for number in range(4):
        order = range(6) if number % 2 == 0 else (3, 4, 5, 0, 1, 2)
        roads = tuple(road(k) for k in order)
        layers.append(Layer(0.2 * (number + 1), 0.2, roads, shapely.box(-1, -1, 31, 7)))
    write_file(Build(tuple(layers), origin=(90.0, 90.0)), path, machine)
    return Program(path, machine)


def line_of(program, text, times=1):
    """Number of the line that is this one for so many times."""
    found = [command.line for command in program.commands() if command.text == text]
    return found[times - 1]


@FIRMWARES
@pytest.mark.parametrize("one_nozzle", [False, True], ids=["two nozzles", "one nozzle"])
@pytest.mark.parametrize("accident", ["pause", "abort", "kill", "power"])
def test_a_print_cut_while_the_second_tool_lays_goes_on_with_it(
    tmp_path, firmware, one_nozzle, accident
):
    program = program_of(tmp_path / "two.gcode", machine_of(firmware, one_nozzle=one_nozzle))
    assert survey(program).errors == ()
    # In the midst of the first layer's second material, and of the second layer's first.
    first, back = line_of(program, "T1"), line_of(program, "T0", 2)
    marks = [number for number, text in program.lines() if text.startswith("; fdjax road")]
    for line in (max(k for k in marks if k < back) + 2, [k for k in marks if k > first][1] + 1):
        compared(program, firmware, accident, line)


@FIRMWARES
@pytest.mark.parametrize("accident", ["pause", "kill", "power"])
def test_a_print_cut_at_a_change_of_tool_goes_on(tmp_path, firmware, accident):
    program = program_of(tmp_path / "two.gcode", machine_of(firmware))
    change = line_of(program, "T1")
    for line in range(change - 2, change + 6):
        compared(program, firmware, accident, line)


@FIRMWARES
@pytest.mark.parametrize("seed", range(4))
def test_faults_and_a_stall_at_a_change_of_tool_change_nothing(tmp_path, firmware, seed):
    machine = machine_of(firmware)
    program = program_of(tmp_path / "two.gcode", machine)
    before = [
        command.line for command in program.commands() if command.line < line_of(program, "T1")
    ]

    def states(**more):
        bench = Bench(firmware, program)
        bench.port = VirtualPort(bench.machine, **more)
        bench.stream().run()
        # A line that neither moves nor lays may be said twice.
        return [state for text, state in bench.states if "G1 X" in text], bench.roads()

    faults = virtual.faults(firmware, 0.05, seed)
    # So many frames are written until a tool waits for heat.
    accident = len(before) + seed, "stall"
    assert states(faults=faults, accident=accident) == states()


@pytest.mark.skipif(klippy.PROGRAM is None, reason="no Kalico; see tests/machine/klippy")
def test_a_real_host_prints_it(tmp_path):
    program = program_of(tmp_path / "two.gcode", machine_of("klipper"))
    assert klippy.judged(program.path, tmp_path) == []
