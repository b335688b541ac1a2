"""Lines that bring a printer into the state of a record, written from the record alone.

Modes are set before they are used: nothing is assumed of the printer.
"""

from collections.abc import Mapping

from fdjax.gcode import settings
from fdjax.gcode.record import Record, Saved

DIRECT = ("G21", "G90", "M83")
"""Millimetres, absolute axes, relative E; E last, as G90 sets its mode too in Marlin."""


def heats(nozzles: Mapping[int, float], *, heaters: int) -> list[str]:
    """Set temperatures of nozzles, by their numbers, without waiting."""
    if heaters == 1:
        return [f"M104 S{heat:g}" for heat in nozzles.values()]
    return [f"M104 T{tool} S{heat:g}" for tool, heat in nozzles.items()]


def select(record: Record) -> list[str]:
    """Take the tool in use, and bring back what ends by that."""
    ended = _factors(record) if record.firmware.tool_begins_anew else []
    return [f"T{record.tool}", *ended]


def heat_all(record: Record, *, heaters: int) -> list[str]:
    """All temperatures that the file has set, without waiting."""
    chamber = [f"M141 S{record.chamber:g}"] if record.chamber else []
    return [f"M140 S{record.bed:g}", *chamber, *heats(record.nozzles, heaters=heaters)]


def wait_for_heat(record: Record) -> list[str]:
    """Wait for bed, chamber and the nozzle in use."""
    found = [f"M190 S{record.bed:g}"] if record.bed else []
    found += [f"M191 S{record.chamber:g}"] if record.chamber else []
    return found + ([f"M109 S{record.nozzle:g}"] if record.nozzle else [])


def push(record: Record, length: float, feed: float) -> str:
    """Push so many mm of filament, or pull them back, in the modes of `DIRECT`; `feed`: mm/min."""
    e = (
        length * record.areas.get(record.tool, record.filament_area)
        if record.volumetric
        else length
    )
    return f"G1 E{e:g} F{feed:g}"


def set_before_homing(record: Record, *, tools: int) -> list[str]:
    """All settings that hold until they are given again, but those that homing ends."""
    ends = record.firmware.home_ends
    kept = {key: words for key, words in record.settings.items() if key[0] not in ends}
    return settings.lines(kept, tools=tools)


def set_after_homing(record: Record) -> list[str]:
    """The settings that homing ends."""
    ends = record.firmware.home_ends
    kept = {key: words for key, words in record.settings.items() if key[0] in ends}
    return settings.lines(kept, tools=1)


def fans(record: Record) -> list[str]:
    """All fans that the file has set, and the first one, which is off where it has not."""
    return _blow(record, {0: 0.0} | record.fans)


def fans_off(record: Record) -> list[str]:
    """All these fans off."""
    return _blow(record, dict.fromkeys({0: 0.0} | record.fans, 0.0))


def _blow(record: Record, speeds: Mapping[int, float]) -> list[str]:
    letter = record.firmware.fan
    return [
        f"M106{f' {letter}{number}' if number else ''} S{speed:g}" if speed or number else "M107"
        for number, speed in speeds.items()
    ]


def saved_states(record: Record) -> list[str]:
    """Save again what the file had saved, at a place that the printer knows, which is `record`'s.

    Of firmware that saves places there is nothing to be said: see `fdjax.machine.resume`.
    """
    firmware = record.firmware
    if firmware.saves_place:
        return []
    found = []
    for name, saved in record.saved.items():
        if not firmware.stacks:
            found += [*_offset(saved), *_factors(saved), "G21", "G90"]
            found += [_coordinates(record, saved), f"G92 E{saved.e:.7f}"]
        found += modes(saved, extruder=True)
        found.append(firmware.save if firmware.stacks else f"{firmware.save} NAME={name}")
    return found + (_factors(record) if found and not firmware.stacks else [])


def place(record: Record) -> list[str]:
    """Say where the printer stands, in the coordinates of the file, where these are shifted.

    So they are, for a while, where states are saved again.
    """
    saved = bool(saved_states(record)) and not record.firmware.stacks
    moved = [_coordinates(record, record)] if saved or any(record.shift) else []
    return [*(_offset(record) if saved or any(record.offset) else []), *moved]


def _offset(saved: Saved | Record) -> list[str]:
    x, y, z = saved.offset
    return [f"SET_GCODE_OFFSET X={x:.3f} Y={y:.3f} Z={z:.3f}"]


def _factors(state: Saved | Record) -> list[str]:
    """M220 and M221, of a firmware with one flow."""
    flow = state.flows.get(0, 1.0)
    return [f"M220 S{100 * state.speed_factor:.10g}", f"M221 S{100 * flow:.10g}"]


def _coordinates(record: Record, saved: Saved | Record) -> str:
    """G92 by which the bed position of `record` is told in the coordinates of `saved`."""
    x, y, z = (a - b for a, b in zip(record.on_bed, saved.shift, strict=True))
    return f"G92 X{x:.3f} Y{y:.3f} Z{z:.3f}"


def modes(state: Saved | Record, *, extruder: bool) -> list[str]:
    """Set units, modes and speed."""
    scale = state.scale
    found = ["G20" if scale != 1 else "G21", "G90" if state.absolute else "G91"]
    found += [f"G1 F{60 * state.speed / scale:.10g}"] if state.speed else []
    return found + (["M83" if state.relative_e else "M82"] if extruder else [])


def leave_out(record: Record) -> list[str]:
    """Leave out again the objects that the file had left out."""
    command = "EXCLUDE_OBJECT NAME=" if _named(record) else "M486 P"
    return [f"{command}{name}" for name in sorted(record.objects.left_out)]


def out_of_object(record: Record) -> list[str]:
    """Leave an object whose moves are not made."""
    if not record.objects.left_out:
        return []
    return ["EXCLUDE_OBJECT_END" if _named(record) else "M486 S-1"]


def into_object(record: Record) -> list[str]:
    """Be in the object in which the file is."""
    command = "EXCLUDE_OBJECT_START NAME=" if _named(record) else "M486 S"
    return [command + record.objects.current] if record.objects.current else []


def prime(record: Record, length: float, feed: float) -> list[str]:
    """Push filament, and leave out again the objects that the file had left out.

    Klipper counts pushes until it does that: it is to have counted as many as in the record.
    """
    times = record.objects.pushes_counted
    pushes = [push(record, length / max(times, 1), feed)] * max(times, 1)
    return [*leave_out(record), *pushes] if times else [*pushes, *leave_out(record)]


def _named(record: Record) -> bool:
    return "EXCLUDE_OBJECT" in record.firmware.kept


def extruder_as_it_was(record: Record) -> list[str]:
    """Position of the filament, and all fans; in the modes of the record."""
    return [f"G92 E{record.e / record.e_scale:.7f}", *fans(record)]
