"""Lengths at the edge of the program; everything inside is in millimetres."""

import difflib
import math
import re

from fdjax.errors import InputError

MM_PER_INCH = 25.4
MICROSTEP = 0.001 * MM_PER_INCH
"""One microstep of the Stratasys machines, 0.001 inch, in mm."""

_MM_PER_UNIT = {
    "mm": 1.0,
    "um": 1e-3,
    "cm": 10.0,
    "m": 1e3,
    "in": MM_PER_INCH,
    "mil": MICROSTEP,
    "microstep": MICROSTEP,
}
_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z]*)\s*")


def length(value: str | float, name: str = "length") -> float:
    """Millimetres of a length written as `"0.4mm"`, `"0.014in"` or a bare number of mm.

    `name` says in the error where the value stood. Raises `InputError` for anything that is
    not a finite length in a known unit (mm, um, cm, m, in, mil, microstep).

    >>> length("0.5in"), length(0.4)
    (12.7, 0.4)
    """
    if isinstance(value, str):
        match = _LENGTH.fullmatch(value)
        if match is None:
            raise InputError(f'{name}: "{value}" is no length; write it like "0.4mm" or "0.014in"')
        number, unit = float(match[1]), match[2] or "mm"
        if unit not in _MM_PER_UNIT:
            near = difflib.get_close_matches(unit, _MM_PER_UNIT, 1, 0.0)[0]
            known = ", ".join(_MM_PER_UNIT)
            raise InputError(
                f'{name}: unknown unit "{unit}" in "{value}" (did you mean {near}? known: {known})'
            )
        result = number * _MM_PER_UNIT[unit]
    elif isinstance(value, int | float) and not isinstance(value, bool):
        result = float(value)
    else:
        raise InputError(f'{name}: {value!r} is no length; write it like "0.4mm" or 0.4')
    if not math.isfinite(result):
        raise InputError(f"{name}: {value!r} is not finite")
    return result
