"""What each command of G-code sets in the record: one table, one line a command."""

from collections.abc import Callable, Mapping

from fdjax.errors import InputError
from fdjax.gcode.firmware import Firmware
from fdjax.gcode.record import Record
from fdjax.gcode.settings import forget

Words = Mapping[str, float]
Parameters = Mapping[str, str]
"""Klipper's, by their names."""

_ELSEWHERE = "moves the zero of coordinates to where the file does not say"


def _heat(record: Record, words: Words) -> None:
    if "S" in words or "R" in words:
        tool = 0 if record.one_nozzle else int(words.get("T", record.tool))
        record.nozzles[tool] = words.get("S", words.get("R", 0.0))


def _heat_tool(record: Record, words: Words) -> None:
    """G10 and M568 of RepRapFirmware; without P, G10 is a retraction.

    The position that is reported stays as it was: Marlin takes what it pulls back away behind it
    (planner.cpp, `apply_retract`), Klipper's macros save and restore it.
    """
    if "L" in words:
        raise InputError(f"G10 with L{words['L']:g} {_ELSEWHERE}")
    if "P" in words:
        _heat(record, {**words, "T": words["P"]})
    elif record.firmware.extrudes:
        record.retracted = True
    else:
        record.forget()


def _return_filament(record: Record, words: Words) -> None:
    record.retracted = False


def _heat_bed(record: Record, words: Words) -> None:
    if "S" in words or "R" in words:
        record.bed = words.get("S", words.get("R", 0.0))


def _heat_chamber(record: Record, words: Words) -> None:
    if "S" in words or "R" in words:
        record.chamber = words.get("S", words.get("R", 0.0))


def _start_fan(record: Record, words: Words) -> None:
    if "S" in words or record.firmware.bare_fan:
        record.fans[int(words.get(record.firmware.fan, 0.0))] = words.get("S", 255.0)


def _stop_fan(record: Record, words: Words) -> None:
    record.fans[int(words.get(record.firmware.fan, 0.0))] = 0.0


def _set_position(record: Record, words: Words) -> None:
    k = record.scale
    named = words or dict.fromkeys("XYZE", 0.0)
    shift = [
        place - named[axis] * k if axis in named else before
        for axis, place, before in zip("XYZ", record.on_bed, record.shift, strict=True)
    ]
    record.shift = (shift[0], shift[1], shift[2])
    if "E" in named:
        record.e = named["E"] * record.e_scale
    record.know(named.keys())
    if record.firmware.shifts_machine:
        record.homed |= named.keys() & set("XYZ")


def _measure_by(**modes: float) -> Callable[[Record, Words], None]:
    return lambda record, words: record.measure_by(**modes)


def _set_axes(absolute: bool) -> Callable[[Record, Words], None]:
    def act(record: Record, words: Words) -> None:
        of_e = {"relative_e": not absolute} if record.firmware.e_mode == "set" else {}
        record.measure_by(absolute=absolute, **of_e)

    return act


def _set_speed_factor(record: Record, words: Words) -> None:
    """M220, with B and R as Marlin has them (M220.cpp): keep the factor, and bring it back."""
    if "B" in words:
        record.kept_speed_factor = record.speed_factor
    if "R" in words:
        record.race(record.kept_speed_factor)
    if "S" in words:
        record.race(words["S"] / 100)


def _set_flow(record: Record, words: Words) -> None:
    if "S" in words:
        letter = record.firmware.flow_tool
        tool = int(words.get(letter, record.tool)) if letter else 0
        record.pour(words["S"] / 100, tool)


def _set_volumetric(record: Record, words: Words) -> None:
    """M200 as Marlin has it (M200.cpp): D turns it on, D0 and S0 off, for all tools.

    The filament is taken to have the diameter D, so that E is what is deposited.
    """
    on = record.volumetric or words.get("D", 0.0) != 0
    record.volumetric = words.get("D", 1.0) != 0 and words.get("S", float(on)) != 0
    record.weigh()


def _set_accelerations(record: Record, words: Words) -> None:
    """M204: S is for roads and travel (Marlin, M201-M205.cpp)."""
    given = {letter: words[letter] for letter in "PTR" if words.get(letter, 0.0) > 0}
    if words.get("S", 0.0) > 0:
        given = {"P": words["S"], "T": words["S"]} | given
    elif record.firmware.one_acceleration:
        least = min(given.values(), default=0.0)
        given = {"P": least, "T": least} if {"P", "T"} <= given.keys() else {}
    record.accelerations.update(given)


def _set_coldest(record: Record, words: Words) -> None:
    """M302: S is the least temperature, and P1 takes all away (Marlin, M302.cpp)."""
    if not record.firmware.coldest:
        return
    if "S" in words:
        record.coldest = words["S"]
    if "P" in words:
        record.coldest = 0.0 if words["P"] else record.coldest or None


def _probe(record: Record, words: Words) -> None:
    """G29 measures a mesh and uses it; it is not to be measured again beside a part."""
    if record.firmware.name == "rrf":
        off = words.get("S") == 2
        record.settings[("G29", "", 1.0)] = {"S": "2" if off else "1"}
    elif "M420" in record.firmware.kept:
        record.settings[("M420", "", 1.0)] = {"S": "1"}
    record.forget()


def _set_power(spindle: str) -> Callable[[Record, Words], None]:
    def act(record: Record, words: Words) -> None:
        record.power, record.spindle = words.get("S", record.power), spindle

    return act


def _set(**values: object) -> Callable[[Record, Words], None]:
    def act(record: Record, words: Words) -> None:
        for name, value in values.items():
            setattr(record, name, value)

    return act


def _lose(record: Record, words: Words) -> None:
    """The machine goes to places that the command does not name."""
    record.forget()


def _end_shift(record: Record, words: Words) -> None:
    """G92.1: grbl takes G92's shift away, Marlin as it is built does nothing (G92.cpp)."""
    if record.shift != (0.0, 0.0, 0.0):
        raise InputError("G92.1 ends the shift of G92 with some machines only; leave both out")


def select(record: Record, tool: int) -> None:
    """A change of tool. E goes on from where it was (Marlin: one `current_position.e`), or anew."""
    if record.firmware.tool_begins_anew and tool != record.tool:
        record.e = 0.0
        record.pour(1.0, 0)
    record.tool = tool
    record.forget()
    record.weigh()


_LOST = ("G27", "G30", "G38", "M600", "M701", "M702")
"""They go to places that they do not name, also as somebody's macros."""

SETTERS: dict[str, Callable[[Record, Words], None]] = {
    **{plane: _set(plane=plane) for plane in ("G17", "G18", "G19")},
    "G20": _measure_by(scale=25.4),
    "G21": _measure_by(scale=1.0),
    "G90": _set_axes(True),
    "G91": _set_axes(False),
    "G92": _set_position,
    "G92.1": _end_shift,
    "M3": _set_power("M3"),
    "M4": _set_power("M4"),
    "M5": _set(power=0.0),
    "M82": _measure_by(relative_e=False),
    "M83": _measure_by(relative_e=True),
    "M104": _heat,
    "M109": _heat,
    "G10": _heat_tool,
    "G11": _return_filament,
    "G29": _probe,
    "M568": _heat_tool,
    "M141": _heat_chamber,
    "M191": _heat_chamber,
    "M140": _heat_bed,
    "M190": _heat_bed,
    "M106": _start_fan,
    "M107": _stop_fan,
    "M200": _set_volumetric,
    "M204": _set_accelerations,
    "M220": _set_speed_factor,
    "M302": _set_coldest,
    "M221": _set_flow,
    **dict.fromkeys(_LOST, _lose),
}

_PROGRAM = "is part of a program, which only its own firmware can run"
UNFOLLOWED = {
    **dict.fromkeys(("G52", "G55", "G56", "G57", "G58", "G59"), _ELSEWHERE),
    **dict.fromkeys(("G59.1", "G59.2", "G59.3", "G53"), _ELSEWHERE),
    **dict.fromkeys(("WHILE", "IF", "ELIF", "ELSE", "VAR", "GLOBAL", "SET", "BREAK"), _PROGRAM),
    "RESTORE_GCODE_STATE": "brings back modes and places that are not followed",
    "G5.1": "is a spline that cannot be followed",
    "G6": "moves motors by steps that the file does not hold",
    "G7": "counts X as a diameter",
    "G16": "counts in polar coordinates",
    "G51": "scales coordinates",
    "G68": "turns coordinates",
    "G90.1": "gives centres of arcs another meaning",
    "M32": "prints another file",
    "M605": "may print copies",
    "M808": "repeats lines from the machine's card",
}
"""Commands that change what is deposited and cannot be followed, and why."""


def _heat_by_name(record: Record, words: Parameters) -> None:
    name, target = words.get("HEATER", ""), float(words.get("TARGET", "0"))
    if name == "heater_bed":
        record.bed = target
    elif name.startswith("extruder") and name[8:].isdigit() | (name == "extruder"):
        record.nozzles[int(name[8:] or 0)] = target


def _activate(record: Record, words: Parameters) -> None:
    number = words.get("EXTRUDER", "extruder").lower().removeprefix("extruder")
    select(record, int(number or 0))


def _cool_all(record: Record, words: Parameters) -> None:
    record.nozzles = dict.fromkeys(record.nozzles, 0.0)
    record.bed = 0.0
    forget(record.settings, ("SET_HEATER_TEMPERATURE",))


def _limit(record: Record, words: Parameters) -> None:
    if "ACCEL" in words:
        record.accelerations |= dict.fromkeys("PT", float(words["ACCEL"]))


def _stand(record: Record, words: Parameters) -> None:
    x, y, z = (
        float(words.get(axis, str(place))) for axis, place in zip("XYZ", record.on_bed, strict=True)
    )
    record.on_bed = (x, y, z)
    record.objects = record.objects.stand(record.on_bed)
    record.homed |= frozenset("XYZ")
    record.know(words.keys())


EXTENDED: dict[str, Callable[[Record, Parameters], None]] = {
    "SET_HEATER_TEMPERATURE": _heat_by_name,
    "TURN_OFF_HEATERS": _cool_all,
    "ACTIVATE_EXTRUDER": _activate,
    "SET_KINEMATIC_POSITION": _stand,
    "SET_VELOCITY_LIMIT": _limit,
}


def knows(firmware: Firmware, name: str) -> bool:
    """Whether a firmware has a command, as far as is known here.

    >>> from fdjax.gcode.firmware import KLIPPER, MARLIN
    >>> knows(KLIPPER, "M204"), knows(KLIPPER, "M205"), knows(MARLIN, "M205")
    (True, False, True)
    """
    own = {*firmware.kept, *firmware.harmless, firmware.save, firmware.restore}
    common = firmware.known or (SETTERS.keys() | _OTHERS)
    return name in own or name in common


_OTHERS = frozenset(
    [f"G{number}" for number in (0, 1, 2, 3, 4, 28)]
    + [f"M{number}" for number in (0, 17, 18, 20, 24, 25, 27, 73, 75, 76, 77, 84, 105, 110, 111)]
    + [f"M{number}" for number in (112, 114, 115, 117, 118, 119, 155, 211, 400, 401, 402, 575)]
)
"""Commands that printers know and that set nothing of the record."""


def passes_over(firmware: Firmware, name: str) -> bool:
    """Whether a firmware does not know a command of G or M, nor is it likely to be a macro."""
    unknown = bool(firmware.known) and name not in firmware.known and name not in _LOST
    return unknown and name[:1] in "GM" and name[1:2].isdigit()
