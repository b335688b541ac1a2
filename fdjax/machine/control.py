"""What a sender says of its own accord: to park, to come back, to abort, to stop at once."""

from abc import ABC, abstractmethod
from collections.abc import Mapping

from fdjax.formats.profile import Machine
from fdjax.gcode import rebuild
from fdjax.gcode.state import GcodeState
from fdjax.machine.program import State
from fdjax.machine.sml_state import SmlState
from fdjax.moves import Point

_TRAVEL = 6000.0
_PUSH = 1800.0
"""mm/min."""
_END_LIFT = 5.0
_ROUNDING = 1e-3


class Commands(ABC):
    """What a kind of firmware takes.

    - `asks_heat`: whether M105 asks for temperatures. `ends_at_once`: whether `interrupt` ends all.
    - `stop`: lines of an emergency stop.
    """

    stop: tuple[str, ...]
    asks_heat = True
    ends_at_once = False

    @abstractmethod
    def park(self, state: State, machine: Machine) -> list[str]:
        """Lines that take the head off the part, heaters down to where nothing oozes.

        A machine that has not been told where it is stays where it is.
        """

    @abstractmethod
    def unpark(self, state: State, machine: Machine) -> list[str]:
        """Lines that heat again and bring back a state before `park`."""

    @abstractmethod
    def off(self, state: State, machine: Machine) -> list[str]:
        """Lines that turn heaters and flow off, also where nothing else can be said any more."""

    @abstractmethod
    def end(self, state: State, machine: Machine) -> list[str]:
        """Lines that take the head off the part and turn everything off."""

    @abstractmethod
    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        """Bytes that break off a wait or a motion; none where the machine has no such thing."""


class _Gcode(Commands):
    """Printers that take G-code."""

    stop = ("M112",)

    def park(self, state: State, machine: Machine) -> list[str]:
        assert isinstance(state, GcodeState)
        if not state.placed:
            return []
        x, y, _ = within((*machine.parking, 0.0), state, machine)
        return [
            "M400",
            *rebuild.DIRECT,
            *_rise(state, machine, machine.stream.park_lift),
            f"G1 X{x:.3f} Y{y:.3f} F{_TRAVEL:g}",
            f"M104 S{max(state.nozzle - 60, 0):g}",
        ]

    def unpark(self, state: State, machine: Machine) -> list[str]:
        assert isinstance(state, GcodeState)
        if not state.placed:
            return []
        return [
            *rebuild.DIRECT,
            f"M109 S{state.nozzle:g}",
            f"G1 X{state.x:.3f} Y{state.y:.3f} F{_TRAVEL:g}",
            f"G1 Z{state.z:.3f} F600",
            rebuild.push(state, machine.stream.park_retract, _PUSH),
            *rebuild.modes(state, extruder=True),
            *rebuild.extruder_as_it_was(state),
        ]

    def off(self, state: State, machine: Machine) -> list[str]:
        assert isinstance(state, GcodeState)
        count = machine.gcode.heaters if machine.gcode is not None else 1
        lines = [*rebuild.heats(dict.fromkeys(range(count), 0.0), heaters=count), "M140 S0"]
        lines += ["M141 S0"] if state.chamber else []
        if any(name == "SET_HEATER_TEMPERATURE" for name, _, _ in state.settings):
            lines.append("TURN_OFF_HEATERS")
        return lines + rebuild.fans_off(state)

    def end(self, state: State, machine: Machine) -> list[str]:
        assert isinstance(state, GcodeState)
        # The steppers stay on: the position is needed to go on with the print.
        away = [*rebuild.DIRECT, *_rise(state, machine, _END_LIFT)] if state.placed else []
        return [*self.off(state, machine), *rebuild.out_of_object(state), *away]

    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        if facts.get("Cap:EMERGENCY_PARSER") == "1":
            return b"\nM108\nM410\n"
        return b""


def tools(machine: Machine) -> int:
    """How many tools a machine has."""
    return machine.gcode.tools if machine.gcode is not None else 1


def above(state: GcodeState, machine: Machine, lift: float) -> float:
    """Bed height for travel: above all that stands, and never below where the nozzle is, mm."""
    z = state.on_bed[2]
    return max(min(max(z, state.top) + lift, machine.bed[2]), z)


def within(place: Point, state: GcodeState, machine: Machine) -> Point:
    """Coordinates of a place on the bed, so far as the firmware's own limits let it go there.

    Where they are shifted, it stays off the edges, which they may miss by their rounding.
    """
    if state.firmware.shifts_machine:
        x, y, z = (at - by for at, by in zip(place, state.shift, strict=True))
        (a, b, c), (d, e, f) = machine.room
        return min(max(x, a), d), min(max(y, b), e), min(max(z, c), f)
    x, y, z = (
        min(max(at, low + _ROUNDING), high - _ROUNDING) - by if by else at
        for at, by, low, high in zip(place, state.shift, *machine.room, strict=True)
    )
    return x, y, z


def _rise(state: GcodeState, machine: Machine, lift: float) -> list[str]:
    """Pull filament back and rise above all that stands."""
    return [
        rebuild.push(state, -machine.stream.park_retract, _PUSH),
        rise(state, above(state, machine, lift), state, machine),
    ]


def rise(now: GcodeState, height: float, shifted: GcodeState, machine: Machine) -> str:
    """Rise to a height over the bed, in the coordinates of `shifted`, from where the head waits."""
    waits = now.objects.waits
    x, y, z = within((*(waits or now.on_bed)[:2], height), shifted, machine)
    return f"G1{f' X{x:.3f} Y{y:.3f}' if waits else ''} Z{z:.3f} F600"


class _Grbl(Commands):
    """grbl: holds and resets in real time."""

    stop = ("\x18",)
    asks_heat = False
    ends_at_once = True

    def park(self, state: State, machine: Machine) -> list[str]:
        return ["M5"]

    def unpark(self, state: State, machine: Machine) -> list[str]:
        assert isinstance(state, GcodeState)
        power = state.power
        return [f"{state.spindle} S{power:g}"] if power else []

    def off(self, state: State, machine: Machine) -> list[str]:
        return ["M5"]

    def end(self, state: State, machine: Machine) -> list[str]:
        return ["M5"]

    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        return b"!\x18"


class _Sml(Commands):
    """SML: it can be held between roads; no public source tells how to break off a motion."""

    stop = ("PD;MM;CD0;",)
    asks_heat = False

    def park(self, state: State, machine: Machine) -> list[str]:
        return []

    def unpark(self, state: State, machine: Machine) -> list[str]:
        return []

    def off(self, state: State, machine: Machine) -> list[str]:
        return ["PD;MM;CD0;"]

    def end(self, state: State, machine: Machine) -> list[str]:
        closing = "EC;" if isinstance(state, SmlState) and state.path is not None else ""
        return [f"{closing}PD;MM;CD0;"]

    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        return b""


_BY_FIRMWARE = {"grbl": _Grbl(), "sml": _Sml()}


def commands_of(firmware: str) -> Commands:
    """The commands of a firmware."""
    return _BY_FIRMWARE.get(firmware, _Gcode())
