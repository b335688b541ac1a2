"""What a sender says of its own accord: to park, to come back, to abort, to stop at once."""

from abc import ABC, abstractmethod
from collections.abc import Mapping

from fdjax.formats.profile import Machine
from fdjax.gcode.state import GcodeState
from fdjax.machine.program import State
from fdjax.machine.sml_state import SmlState

_TRAVEL = 6000.0
_PUSH = 1800.0
"""mm/min."""


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
    def off(self, machine: Machine) -> list[str]:
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
        lift = min(state.z + machine.stream.park_lift, machine.bed[2] - state.shift[2])
        return [
            "M400",
            "G21",
            "G90",
            "M83",  # behind G90, which to Marlin makes E absolute too
            f"G1 E-{machine.stream.park_retract:g} F{_PUSH:g}",
            f"G1 Z{max(lift, state.z):.3f} F600",
            f"G1 X{-state.shift[0]:.3f} Y{machine.bed[1] - state.shift[1]:.3f} F{_TRAVEL:g}",
            f"M104 S{max(state.nozzle - 60, 0):g}",
        ]

    def unpark(self, state: State, machine: Machine) -> list[str]:
        assert isinstance(state, GcodeState)
        if not state.placed:
            return []
        return [
            f"M109 S{state.nozzle:g}",
            f"G1 X{state.x:.3f} Y{state.y:.3f} F{_TRAVEL:g}",
            f"G1 Z{state.z:.3f} F600",
            f"G1 E{machine.stream.park_retract:g} F{_PUSH:g}",
            *modes(state),
        ]

    def off(self, machine: Machine) -> list[str]:
        return [*heats(dict.fromkeys(range(_tools(machine)), 0.0), machine), "M140 S0", "M107"]

    def end(self, state: State, machine: Machine) -> list[str]:
        # The steppers stay on: the position is needed to go on with the print.
        lift = ["G21", "M83", f"G1 E-{machine.stream.park_retract:g} F{_PUSH:g}"]
        lift += ["G91", "G1 Z5 F600", "G90"]
        return [*self.off(machine), *(lift if state.placed else [])]

    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        if facts.get("Cap:EMERGENCY_PARSER") == "1":
            return b"\nM108\nM410\n"
        return b""


def _tools(machine: Machine) -> int:
    return machine.gcode.tools if machine.gcode is not None else 1


def heats(nozzles: Mapping[int, float], machine: Machine) -> list[str]:
    """Lines that set temperatures of nozzles, by their tools, without waiting."""
    if _tools(machine) == 1:
        return [f"M104 S{heat:g}" for heat in nozzles.values()]
    return [f"M104 T{tool} S{heat:g}" for tool, heat in nozzles.items()]


def modes(state: GcodeState, *, extruder: bool = True) -> list[str]:
    """Lines that set units, modes and speed as a state has them, and filament position and fan."""
    scale = state.scale
    plain = [
        "G20" if scale != 1 else "G21",
        "G90" if state.absolute else "G91",
        *([f"G1 F{60 * state.speed / scale:g}"] if state.speed else []),
    ]
    if not extruder:
        return plain
    return [
        *plain,
        "M83" if state.relative_e else "M82",
        *([f"M220 S{100 * state.speed_factor:g}"] if state.speed_factor != 1 else []),
        *([f"M221 S{100 * state.flow_factor:g}"] if state.flow_factor != 1 else []),
        f"G92 E{state.e / state.e_scale:.5f}",
        *(["M107"] if not state.fan else []),
        *(
            f"M106{f' P{number}' if number else ''} S{speed:g}"
            for number, speed in state.fans.items()
            if speed or number
        ),
    ]


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

    def off(self, machine: Machine) -> list[str]:
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

    def off(self, machine: Machine) -> list[str]:
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
