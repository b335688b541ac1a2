"""What each command of G-code sets in the record: one table, one line a command."""

from collections.abc import Callable, Mapping

from fdjax.errors import InputError
from fdjax.gcode.record import Record

Words = Mapping[str, float]

_ELSEWHERE = "moves the zero of coordinates to where the file does not say"


def _heat(record: Record, words: Words) -> None:
    if "S" in words or "R" in words:
        tool = int(words.get("T", record.tool))
        record.nozzles[tool] = words.get("S", words.get("R", 0.0))


def _heat_tool(record: Record, words: Words) -> None:
    """G10 and M568 of RepRapFirmware; without P, G10 is a retraction."""
    if "L" in words:
        raise InputError(f"G10 with L{words['L']:g} {_ELSEWHERE}")
    if "P" in words:
        _heat(record, {**words, "T": words["P"]})
    else:
        record.forget()


def _heat_bed(record: Record, words: Words) -> None:
    if "S" in words or "R" in words:
        record.bed = words.get("S", words.get("R", 0.0))


def _start_fan(record: Record, words: Words) -> None:
    record.fans[int(words.get("P", 0.0))] = words.get("S", 255.0)


def _stop_fan(record: Record, words: Words) -> None:
    record.fans[int(words.get("P", 0.0))] = 0.0


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
        record.speed_factor = record.kept_speed_factor
    if "S" in words:
        record.speed_factor = words["S"] / 100
    record.run_at(record.speed)


def _set_flow(record: Record, words: Words) -> None:
    if "S" in words:
        record.flows[int(words.get("T", record.tool))] = words["S"] / 100
        record.weigh()


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
    record.accelerations.update(given)


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
    """A change of tool. E goes on from where it was (Marlin: one `current_position.e`)."""
    record.tool = tool
    record.forget()
    record.weigh()


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
    "M568": _heat_tool,
    "M140": _heat_bed,
    "M190": _heat_bed,
    "M106": _start_fan,
    "M107": _stop_fan,
    "M200": _set_volumetric,
    "M204": _set_accelerations,
    "M220": _set_speed_factor,
    "M221": _set_flow,
    **dict.fromkeys(("G11", "G27", "G29", "G30", "G38", "M600", "M701", "M702"), _lose),
}

_PROGRAM = "is part of a program, which only its own firmware can run"
UNFOLLOWED = {
    **dict.fromkeys(("G52", "G55", "G56", "G57", "G58", "G59"), _ELSEWHERE),
    **dict.fromkeys(("G59.1", "G59.2", "G59.3", "G53"), _ELSEWHERE),
    "RESTORE_GCODE_STATE": "brings back modes and places that are not followed",
    **dict.fromkeys(("WHILE", "IF", "ELIF", "ELSE", "VAR", "GLOBAL", "SET", "BREAK"), _PROGRAM),
    "G5.1": "is a spline that cannot be followed",
    "G6": "moves motors by steps that the file does not hold",
    "G7": "counts X as a diameter",
    "G16": "counts in polar coordinates",
    "G51": "scales coordinates",
    "G61": "goes back to a place that the file does not say",
    "G68": "turns coordinates",
    "G90.1": "gives centres of arcs another meaning",
    "M32": "prints another file",
    "M605": "may print copies",
    "M808": "repeats lines from the machine's card",
}
"""Commands that change what is deposited and cannot be followed, and why."""
