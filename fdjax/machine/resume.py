"""Going on with a print: from which line, and how the machine gets back to it."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.gcode import rebuild
from fdjax.gcode.settings import state_name
from fdjax.gcode.state import GcodeState
from fdjax.machine.control import above, rise, tools, within
from fdjax.machine.program import Program, State
from fdjax.machine.protocols.base import same
from fdjax.machine.sml_state import SmlState
from fdjax.moves import Point as Place
from fdjax.moves import Position

PLANNED = 16
"""Moves that a machine may have taken and not made when its power failed."""
AHEAD = 32
"""Lines that a machine may have run beyond the last that was written down."""
_LIFT = 10.0
_RESOLUTION = 0.02


class Standing(Enum):
    """What a machine says of its position, against where the print broke off."""

    HERE = "stands where the print broke off"
    ELSEWHERE = "has kept its height, but not its place"
    LOST = "has lost its position"


@dataclass(frozen=True)
class Point:
    """Where a print goes on: after a line of the file, in a layer, in a state."""

    line: int
    layer: int
    state: State


class Points:
    """The places from which a print that reached a line can go on; none before it was homed.

    Raises `InputError` where nothing had been laid down yet, or nothing is left.
    """

    def __init__(self, program: Program, starts: Sequence[int], reached: int) -> None:
        self._before: deque[Point] = deque(maxlen=PLANNED + 1)  # the last one at `reached`
        self._after: list[Point] = []
        self._path = program.path
        state, layer, line, laid = program.state(), 0, 0, False
        for command in program.commands():
            if command.line > reached:
                if not self._after:
                    self._before.append(Point(line, layer, state.copy()))
                elif len(self._after) >= AHEAD and _may_begin(state):
                    self._after.append(Point(line, layer, state.copy()))
                    break
                if len(self._after) < AHEAD:
                    self._after.append(Point(line, layer, state.copy()))
            elif reached - command.line <= 4 * PLANNED:
                self._before.append(Point(line, layer, state.copy()))
            moves = state.run(command.text)
            if command.line <= reached:
                laid = laid or any(move.volume > 0 for move in moves)
                laid = laid or (isinstance(state, GcodeState) and bool(moves) and state.pours)
                if any(sign in command.text.upper() for sign in _HOMING):
                    self._before.clear()
            line = command.line
            while layer < len(starts) and starts[layer] <= line:
                layer += 1
        if not self._after:
            raise InputError(f"{program.path}: nothing is left to send after line {reached}")
        if not laid:
            raise InputError(
                f"{program.path}: nothing had been laid down by line {reached}; begin anew, "
                "without --resume"
            )

    def at(self, reported: Position | None) -> Point | None:
        """Where the machine stands, if it has kept its power and says so.

        It may have run a few lines more than it acknowledged, or than was written down.
        """
        if reported is None:
            return None
        for point in (*self._after, *reversed(self._before)):
            position = point.state.position
            known = sum(value is not None for value in position)
            if known == 4 and _may_begin(point.state) and same(reported, position, _RESOLUTION):
                return point
        return None

    @property
    def kept(self) -> Point:
        """Where a machine goes on that has made all moves, but does not stand there any more.

        Behind an object that is left out, not before it: settings that it brought hold already.
        """
        *before, last = self._before
        before = [] if isinstance(last.state, GcodeState) else before
        return self._first([last, *reversed(before), *self._after])

    @property
    def lost(self) -> Point:
        """Where it goes on if it lost its power, and with it the last moves that it had taken."""
        return self._first([*self._before, *self._after])

    def _first(self, points: list[Point]) -> Point:
        found = next((point for point in points if _may_begin(point.state)), None)
        if found is None:
            raise InputError(f"{self._path}: nothing is left to send: all of it is left out")
        return found

    @property
    def waits(self) -> Place | None:
        """Where on the bed the head waits while an object is left out."""
        state = self._after[0].state
        return state.objects.waits if isinstance(state, GcodeState) else None

    @property
    def top(self) -> float:
        """Of all that may stand on the bed, mm."""
        state = (self._after or self._before)[-1].state
        return state.top if isinstance(state, GcodeState) else 0.0

    @property
    def lowest(self) -> float:
        """The least height at which it may have stopped, mm: taken for true, all errors lift."""
        return min(point.state.on_bed[2] for point in (*self._before, *self._after))


_HOMING = ("G28", "$H", "FH")


def _may_begin(state: State) -> bool:
    """Whether what follows does not hang on what the machine would have forgotten."""
    if isinstance(state, GcodeState):
        return not state.objects.skips  # nothing is laid down until it does not
    return state.path is None and not state.outputs


def at_layer(program: Program, starts: Sequence[int], layer: int) -> Point:
    """The point before a layer, counted from 1. Raises `InputError` for one that is not there."""
    if not 1 <= layer <= len(starts):
        raise InputError(f"layer {layer}: {program.path.name} has layers 1 to {len(starts)}")
    state = program.state()
    line = starts[layer - 1] - 1
    for command in program.commands():
        if command.line > line:
            if _may_begin(state) or isinstance(state, SmlState):
                break
            line = command.line
        state.run(command.text)
    return Point(line, layer, state)


def standing(reported: Position | None, point: Point | None) -> Standing:
    """What a report says, given the point that it was found to be, if any.

    A machine that was switched on anew is at zero.
    """
    if point is not None:
        return Standing.HERE
    if reported is None or not any(reported[:3]):
        return Standing.LOST
    return Standing.ELSEWHERE


def way_back(
    point: Point,
    machine: Machine,
    stands: Standing,
    *,
    height: float,
    top: float = 0.0,
    waits: Place | None = None,
    extruder: bool = True,
) -> list[str]:
    """Lines that bring the machine to a point, hot and with all that the file had in force.

    `height` is that of the nozzle now, mm above the bed; where the position is lost it is taken for
    true. `top` is what stands on the bed beyond what the file had laid down by the point; `waits`
    is where the head stands, where it is not where the file is. It rises above all first. Only X
    and Y are homed, unless the machine stands where it should: Z never is, as the part stands
    there. Raises `InputError` where that cannot be done.
    """
    state = point.state
    if isinstance(state, SmlState):
        return _sml(state, stands)
    if not extruder and stands is Standing.LOST:
        raise InputError("grbl: it finds home along all axes at once, so not beside a part")
    now = state.copy()
    now.on_bed, now.top = (*state.on_bed[:2], height), max(state.top, top)
    now.objects = replace(state.objects, waits=waits)
    lost, here = stands is Standing.LOST, stands is Standing.HERE
    high = max(above(now, machine, _LIFT), min(state.on_bed[2] + _LIFT, machine.bed[2]))
    x, y, z = (
        place - shift
        for place, shift in zip(state.on_bed, _shift_then(state, stands, extruder), strict=True)
    )
    if not extruder:
        *_, up = within((0.0, 0.0, high), state, machine)
        lines = ["M5", "G21", "G90", f"G1 Z{up:.3f} F600", f"G1 X{x:.3f} Y{y:.3f} F6000"]
        lines += [f"G1 Z{z:.3f} F600"]
        lines += [f"{state.spindle} S{state.power:g}"] if state.power else []
        return [*lines, *rebuild.modes(state, extruder=False)]
    count = tools(machine)
    return [
        *rebuild.DIRECT,
        *rebuild.out_of_object(state),
        *rebuild.heat_all(state, heaters=machine.gcode.heaters if machine.gcode else 1),
        *rebuild.set_before_homing(state, tools=count),
        *(line.format(z=height) for line in state.firmware.stands if lost),
        f"G1 Z{high:.3f} F600" if lost else rise(now, high, state, machine),
        *([] if here else ["G28 X Y"]),
        *rebuild.set_after_homing(state),
        *(rebuild.select(state) if count > 1 else []),
        *rebuild.wait_for_heat(state),
        *rebuild.DIRECT,  # a change of tool may run a macro
        *(
            rebuild.prime(state, machine.stream.park_retract, 300)
            if state.nozzle
            else rebuild.leave_out(state)
        ),
        *(["G10"] if state.retracted and lost else []),
        f"G1 X{x:.3f} Y{y:.3f} F6000",
        f"G1 Z{z:.3f} F600",
        # A stack that is still there is not stacked again.
        *(rebuild.saved_states(state) if lost or not (here or state.firmware.stacks) else []),
        *([] if here else rebuild.place(state)),
        *rebuild.into_object(state),
        *rebuild.modes(state, extruder=True),
        *rebuild.extruder_as_it_was(state),
    ]


def _shift_then(state: GcodeState, stands: Standing, extruder: bool) -> tuple[float, ...]:
    """What the machine has between bed and coordinates once X and Y have been homed."""
    if stands is Standing.HERE or not extruder:
        return state.shift
    x, y, _ = state.offset
    return (0.0, 0.0, 0.0) if stands is Standing.LOST else (x, y, state.shift[2])


def must_be_saved(program: Program, point: Point) -> None:
    """Raise `InputError` where the file goes back, after a point, to a place saved before it.

    A machine that has lost its position has lost that too, and it cannot be brought there.
    """
    state = point.state
    if not isinstance(state, GcodeState) or not state.saved:
        return
    firmware, lacking = state.firmware, set(state.saved)
    for command in program.commands(point.line):
        name, _, rest = command.text.upper().partition(" ")
        if firmware.stacks or name not in (firmware.save, firmware.restore):
            continue
        key = state_name(command.text, len(name))
        if name == firmware.save:
            lacking.discard(key)
        elif key in lacking and (firmware.saves_place or "MOVE=1" in rest):
            raise InputError(
                f"{program.path}, line {command.line}: {command.text} goes back to a place that "
                "the machine has lost; begin anew, or at a layer behind it with --layer"
            )


def _sml(state: SmlState, stands: Standing) -> list[str]:
    if stands is Standing.LOST:
        raise InputError(
            "SML: no public source tells how this machine finds home with a part in it; a print "
            "can go on only while the machine has kept its power: say so with --kept-power"
        )
    lines = ["PD;MM;"]
    lines += [state.sml.materials[state.material]] if state.material is not None else []
    lines += [state.sml.layer.replace("{z}", f"{state.z:g}")]
    return [*lines, f"SR{state.sml.travel_speed};MA{state.x:g},{state.y:g};", f"SR{state.rate:g};"]
