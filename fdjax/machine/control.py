"""What a sender says of its own accord: to park, to come back, to abort, to stop at once."""

from abc import ABC, abstractmethod
from collections.abc import Mapping

from fdjax.formats.profile import Machine
from fdjax.machine.gcode_state import GcodeState
from fdjax.machine.program import State
from fdjax.machine.sml_state import SmlState

_TRAVEL = 6000.0
_PUSH = 1800.0
"""mm/min."""


class Commands(ABC):
    """What a kind of firmware takes.

    - `asks_heat`: whether M105 asks for temperatures. `ends_at_once`: whether `interrupt` ends all.
    - `stop`: lines of an emergency stop; `off`: lines that turn heaters or flow off, to be sent
      when nothing else can be said any more.
    """

    stop: tuple[str, ...]
    off: tuple[str, ...]
    asks_heat = True
    ends_at_once = False

    @abstractmethod
    def park(self, state: State, machine: Machine) -> list[str]:
        """Lines that take the head off the part, heaters down to where nothing oozes."""

    @abstractmethod
    def unpark(self, state: State, machine: Machine) -> list[str]:
        """Lines that heat again and bring back a state before `park`."""

    @abstractmethod
    def end(self, state: State) -> list[str]:
        """Lines that turn everything off."""

    @abstractmethod
    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        """Bytes that break off a wait or a motion; none where the machine has no such thing."""


class _Gcode(Commands):
    """Printers that take G-code."""

    stop = ("M112",)
    off = ("M104 S0", "M140 S0", "M107")

    def park(self, state: State, machine: Machine) -> list[str]:
        assert isinstance(state, GcodeState)
        lift = min(state.z + machine.stream.park_lift, machine.bed[2] - state.shift[2])
        return [
            "M400",
            "G21",
            "M83",
            f"G1 E-{machine.stream.park_retract:g} F{_PUSH:g}",
            "G90",
            f"G1 Z{max(lift, state.z):.3f} F600",
            f"G1 X{-state.shift[0]:.3f} Y{machine.bed[1] - state.shift[1]:.3f} F{_TRAVEL:g}",
            f"M104 S{max(state.nozzle - 60, 0):g}",
        ]

    def unpark(self, state: State, machine: Machine) -> list[str]:
        assert isinstance(state, GcodeState)
        return [
            f"M109 S{state.nozzle:g}",
            f"G1 X{state.x:.3f} Y{state.y:.3f} F{_TRAVEL:g}",
            f"G1 Z{state.z:.3f} F600",
            f"G1 E{machine.stream.park_retract:g} F{_PUSH:g}",
            *modes(state),
        ]

    def end(self, state: State) -> list[str]:
        lines = [*self.off]
        if isinstance(state, GcodeState):
            lines += ["M83", "G1 E-2 F1800", "G91", "G1 Z5 F600", "G90"]
        return [*lines, "M84"]

    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        if facts.get("Cap:EMERGENCY_PARSER") == "1":
            return b"\nM108\nM410\n"
        return b""


def modes(state: GcodeState) -> list[str]:
    """Lines that set units, modes, filament position, speed and fan as a state has them."""
    scale = state.scale
    return [
        "G20" if scale != 1 else "G21",
        "G90" if state.absolute else "G91",
        "M83" if state.relative_e else "M82",
        f"G92 E{state.e / scale:.5f}",
        *([f"G1 F{60 * state.speed / scale:g}"] if state.speed else []),
        f"M106 S{state.fan:g}" if state.fan else "M107",
    ]


class _Grbl(Commands):
    """grbl: holds and resets in real time."""

    stop = ("\x18",)
    off = ("M5",)
    asks_heat = False
    ends_at_once = True

    def park(self, state: State, machine: Machine) -> list[str]:
        return ["M5"]

    def unpark(self, state: State, machine: Machine) -> list[str]:
        power = state.power if isinstance(state, GcodeState) else 0.0
        return [f"M3 S{power:g}"] if power else []

    def end(self, state: State) -> list[str]:
        return []

    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        return b"!\x18"


class _Sml(Commands):
    """SML: it can be held between roads; no public source tells how to break off a motion."""

    stop = ("PD;MM;CD0;",)
    off = ("PD;MM;CD0;",)
    asks_heat = False

    def park(self, state: State, machine: Machine) -> list[str]:
        return []

    def unpark(self, state: State, machine: Machine) -> list[str]:
        return []

    def end(self, state: State) -> list[str]:
        closing = "EC;" if isinstance(state, SmlState) and state.path is not None else ""
        return [f"{closing}PD;MM;CD0;"]

    def interrupt(self, facts: Mapping[str, str]) -> bytes:
        return b""


_BY_FIRMWARE = {"grbl": _Grbl(), "sml": _Sml()}


def commands_of(firmware: str) -> Commands:
    """The commands of a firmware."""
    return _BY_FIRMWARE.get(firmware, _Gcode())
