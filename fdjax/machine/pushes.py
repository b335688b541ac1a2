"""How much filament a move may push before a firmware refuses it."""

from math import dist

from fdjax.formats.profile import Machine
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import Refused
from fdjax.moves import Move

PUSH = 50.0
"""mm of filament in one move without X and Y: Klipper's `max_extrude_only_distance` as it comes."""


def limits(machine: Machine) -> tuple[float, float]:
    """mm of filament in one move without X and Y, and mm^2 of a section, that Klipper takes."""
    stream = machine.stream
    return stream.longest_push or PUSH, stream.largest_section or 4 * machine.nozzle**2


def check_push(state: GcodeState, move: Move, machine: Machine) -> None:
    """Raise `Refused` for a move with E that Klipper refuses (extruder.py, `check_move`).

    Its limits are the profile's, or those that it comes with: 50 mm of filament, and a section of
    4 x nozzle^2, which a move may exceed that pushes less than nozzle x section / filament area.
    """
    (a, b, _), (x, y, _) = move.start, move.end
    longest, largest = limits(machine)
    pushed = move.volume / state.gain * state.flow_factor  # mm of filament
    length = dist(move.start, move.end)
    if (a == x and b == y) or pushed < 0:
        if abs(pushed) > longest:
            raise Refused(
                f"{abs(pushed):.3f} mm of filament in one move: Klipper takes {longest:g} mm "
                "(max_extrude_only_distance; the profile's stream.longest_push)"
            )
        return
    section = pushed * state.filament_area / length
    if section > largest * (1 + 1e-9) and pushed > machine.nozzle * largest / state.filament_area:
        raise Refused(
            f"a section of {section:.3f} mm^2: Klipper takes {largest:.3f} mm^2 "
            "(max_extrude_cross_section; the profile's stream.largest_section)"
        )
