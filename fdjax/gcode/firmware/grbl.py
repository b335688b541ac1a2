"""grbl 1.1h: sources are gcode.c, protocol.c and report.c, and its simulator.

- G0 is in force from the start, and a line holds several commands, of different groups (gcode.c).
- E is no word that it knows (error 20). G4 takes P, in seconds, and nothing else (error 28).
- F0 is refused where a motion needs a speed (error 22), and so is such a motion before any F.
- `(comments)` and `;` to the line's end are dropped, N words passed over (protocol.c, gcode.c).
"""

from fdjax.gcode.firmware.base import Firmware

_KNOWN = (
    *(f"G{number}" for number in (0, 1, 2, 3, 4, 10, 17, 18, 19, 20, 21, 28, 28.1, 30, 30.1)),
    *(f"G{number}" for number in (38.2, 38.3, 38.4, 38.5, 40, 43.1, 49, 53, 54, 55, 56, 57, 58)),
    *(f"G{number}" for number in (59, 61, 80, 90, 91, 91.1, 92, 92.1, 93, 94)),
    *(f"M{number}" for number in (0, 1, 2, 3, 4, 5, 8, 9, 30)),
)
"""Those of gcode.c; M7 and M56 are off as it comes."""

GRBL = Firmware(
    "grbl",
    e_mode="while",
    first_motion="G0",
    first_speed=0.0,
    modal=True,
    runs_all=True,
    extrudes=False,
    dwell={"P": 1.0},
    needs_dwell=True,
    no_speed="refused",
    known=frozenset(_KNOWN),
    refuses_unknown=True,
)
