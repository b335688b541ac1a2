"""Command lines with `{names}` in them, filled by plain replacement: nothing is evaluated."""

import re
from collections.abc import Iterable, Mapping

from fdjax.errors import InputError

_NAME = re.compile(r"\{([^{}]*)\}")

GCODE_NAMES = (
    "first_tool",
    "nozzle_temperature",
    "bed_temperature",
    "bed_x",
    "bed_y",
    "bed_z",
    "first_height",
    "top_z",
    "park_z",
)
"""What start, prime and end code of a G-code machine may use; lengths in mm.

`first_tool` is the tool that lays first, `nozzle_temperature` its; `first_height` is the first
layer's height, `top_z` the last layer's z and `park_z` 10 mm above
it, but not above the bed's height.
"""

SML_NAMES = ("layers", "speed", "travel_speed", "acceleration")
"""What header and footer of an SML machine may use; speeds as its SR and AC commands take them."""


def check(lines: Iterable[str], allowed: Iterable[str], where: str) -> None:
    """Raise `InputError` for a name in braces that is not allowed, a stray brace or a line break.

    `where` says in the error which lines these are.
    """
    allowed = tuple(allowed)
    for line in lines:
        for name in _NAME.findall(line):
            if name not in allowed:
                raise InputError(
                    f"{where}: unknown placeholder {{{name}}} in {line!r} "
                    f"(known: {', '.join(allowed) or 'none here'})"
                )
        if re.search(r"[{}\r\n]", _NAME.sub("", line)):
            raise InputError(f"{where}: stray brace or line break in {line!r}")


def fill(lines: Iterable[str], values: Mapping[str, object]) -> list[str]:
    """The lines with every `{name}` replaced by its value.

    >>> fill(["M104 S{nozzle_temperature}"], {"nozzle_temperature": 210})
    ['M104 S210']
    """
    return [_NAME.sub(lambda match: str(values[match[1]]), line) for line in lines]
