"""Going on with a print: from which line, and how the machine gets back to it."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.machine.control import modes
from fdjax.machine.gcode_state import GcodeState
from fdjax.machine.moves import Position
from fdjax.machine.program import Program, State
from fdjax.machine.protocols.base import same
from fdjax.machine.sml_state import SmlState

PLANNED = 16
"""Moves that a machine may have taken and not made when its power failed."""
AHEAD = 32
"""Lines that a machine may have run beyond the last that was written down."""
_LIFT = 10.0
_RESOLUTION = 0.02


@dataclass(frozen=True)
class Point:
    """Where a print goes on: after a line of the file, in a layer, in a state."""

    line: int
    layer: int
    state: State


class Points:
    """The places from which a print that reached a line can go on."""

    def __init__(self, program: Program, starts: Sequence[int], reached: int) -> None:
        self._before: deque[Point] = deque(maxlen=PLANNED + 1)  # the last one at `reached`
        self._after: list[Point] = []
        state, layer, line = program.state(), 0, 0
        for command in program.commands():
            if command.line > reached:
                if not self._after:
                    self._before.append(Point(line, layer, state.copy()))
                elif len(self._after) == AHEAD:
                    break
                self._after.append(Point(line, layer, state.copy()))
            elif reached - command.line <= 4 * PLANNED:
                self._before.append(Point(line, layer, state.copy()))
            state.run(command.text)
            line = command.line
            while layer < len(starts) and starts[layer] <= line:
                layer += 1
        if not self._after:
            raise InputError(f"{program.path}: nothing is left to send after line {reached}")

    def at(self, reported: Position | None) -> Point | None:
        """Where the machine stands, if it has kept its power and says so.

        It may have run a few lines more than it acknowledged, or than was written down.
        """
        if reported is None:
            return None
        for point in (*self._after, *reversed(self._before)):
            position = point.state.position
            known = sum(value is not None for value in position)
            if known == 4 and same(reported, position, _RESOLUTION):
                return point
        return None

    @property
    def kept(self) -> Point:
        """Where a machine goes on that has kept its power but does not say where it is."""
        return next(point for point in reversed(self._before) if _may_begin(point.state))

    @property
    def lost(self) -> Point:
        """Where it goes on if it lost its power, and with it the last moves that it had taken."""
        return next(point for point in self._before if _may_begin(point.state))


def _may_begin(state: State) -> bool:
    """Whether what follows does not hang on what the machine would have forgotten."""
    return isinstance(state, GcodeState) or (state.path is None and not state.outputs)


def at_layer(program: Program, starts: Sequence[int], layer: int) -> Point:
    """The point before a layer, counted from 1. Raises `InputError` for one that is not there."""
    if not 1 <= layer <= len(starts):
        raise InputError(f"layer {layer}: {program.path.name} has layers 1 to {len(starts)}")
    return Point(starts[layer - 1] - 1, layer, _state_before(program, starts[layer - 1]))


def _state_before(program: Program, line: int) -> State:
    state = program.state()
    for command in program.commands():
        if command.line >= line:
            break
        state.run(command.text)
    return state


def way_back(point: Point, machine: Machine, *, kept: bool) -> list[str]:
    """Lines that bring the machine to a point, hot and in its modes.

    Where it has `kept` its position there is no homing. Where it has not, the nozzle is taken to
    stand at the height where the print broke off; it rises, and only X and Y are homed: Z never
    is, as the part stands there.
    """
    state = point.state
    if isinstance(state, SmlState):
        return _sml(state, kept)
    x, y, z = state.on_bed
    high = min(z + _LIFT, machine.bed[2])
    lines = ["G21", "G90", f"M140 S{state.bed:g}"]
    lines += [f"T{state.tool}"] if state.tool else []
    if not kept:
        lines += [f"G92 Z{z:.3f}"]
    shift = state.shift if kept else (0.0, 0.0, 0.0)
    lines += [f"G1 Z{high - shift[2]:.3f} F600"]
    if not kept:
        lines += ["G28 X Y"]
    if state.bed:
        lines += [f"M190 S{state.bed:g}"]
    if state.nozzle:
        lines += [f"M109 S{state.nozzle:g}", "M83", f"G1 E{machine.stream.park_retract:g} F300"]
    lines += [f"G1 X{x - shift[0]:.3f} Y{y - shift[1]:.3f} F6000", f"G1 Z{z - shift[2]:.3f} F600"]
    if not kept and any(state.shift):
        lines += [f"G92 X{state.x:.3f} Y{state.y:.3f} Z{state.z:.3f}"]
    if state.power:
        lines += [f"M3 S{state.power:g}"]
    return lines + modes(state)


def _sml(state: SmlState, kept: bool) -> list[str]:
    if not kept:
        raise InputError(
            "SML: no public source tells how this machine finds home with a part in it; a print "
            "can go on only while the machine has kept its power: say so with --kept-power"
        )
    lines = ["PD;MM;"]
    lines += [state.sml.materials[state.material]] if state.material is not None else []
    lines += [state.sml.layer.replace("{z}", f"{state.z:g}")]
    return [*lines, f"SR{state.sml.travel_speed};MA{state.x:g},{state.y:g};", f"SR{state.rate:g};"]
