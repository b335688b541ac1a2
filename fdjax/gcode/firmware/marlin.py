"""Marlin 2: sources are its files (2.0.8 to 2.1.2), and what a build of 2.0.8 was seen to do.

- G90, G91 set E's mode too, M82 and M83 set it again: `GcodeSuite::set_relative_mode` clears the E
  bits (gcode.h). Seen in 2.0.8: after M83, G90 a `G1 E1` and a second one push 1 mm together.
- Words alone are an unknown command: GCODE_MOTION_MODES is off as it comes (Configuration_adv.h).
- One command a line: `GCodeParser::parse` takes the first (parser.cpp).
- `G4 P500 S1` waits a second: S is looked at last and overwrites (G4.cpp).
- F0 leaves the speed: `if (parser.floatval('F') > 0)` (gcode.cpp, get_destination_from_command).
- M201 to M205: M201-M205.cpp, where S of M204 sets P and T first. M900: M900.cpp, T
  only with several tools. M200: M200.cpp, where D says whether E is a volume, and S after it.
  M207 to M209: M207-M209.cpp. M218: M218.cpp. M302: M302.cpp, where S alone decides of P.
- Homing ends M420: `set_bed_leveling_enabled(false)` (G28.cpp); it comes back only where
  RESTORE_LEVELING_AFTER_G28 is on, which it is not as it comes.
- Switched on anew it takes the nozzle to be at 0, and G92 shifts the file's coordinates only: its
  soft end stops (motion.cpp, `apply_motion_limits`) would stop all that lies lower than where it
  stood, so they are turned off: the check has seen that the file stays within the room.
- G60, G61 keep places, XYZE, and no modes: G60.cpp, G61.cpp.
- G5: G5.cpp, where it is built with BEZIER_CURVE_SUPPORT.
- M486 counts and marks objects, T begins anew; of one that is left out E goes on and the axes stay:
  M486.cpp, cancel_object.h, gcode.cpp, where it is built with CANCEL_OBJECTS.
"""

from fdjax.gcode.firmware.base import Firmware, Kept

MARLIN = Firmware(
    "marlin",
    splines=True,
    no_speed="ignored",
    home_ends=("M420",),
    stands=("M211 S0", "G92 Z{z:.3f}"),
    save="G60",
    restore="G61",
    saves_place=True,
    skipping="stays",
    kept={
        "M92": Kept(by=("T",), of_tool="T"),
        "M200": Kept(by=("T",), of_tool="T", over={"D": "S"}),
        "M201": Kept(by=("T",), of_tool="T"),
        "M203": Kept(by=("T",), of_tool="T"),
        "M204": Kept(over={"S": "PT"}),
        "M205": Kept(),
        "M207": Kept(),
        "M208": Kept(),
        "M209": Kept(),
        "M211": Kept(),
        "M218": Kept(by=("T",), of_tool="T"),
        "M301": Kept(by=("E",)),
        "M302": Kept(over={"S": "P"}),
        "M304": Kept(),
        "M309": Kept(),
        "M412": Kept(once=("R",)),
        "M413": Kept(),
        "M420": Kept(once=("V", "T", "C")),
        "M425": Kept(),
        "M486": Kept(once=("S", "A", "P", "U", "C")),
        "M569": Kept(by=("X", "Y", "Z", "E", "T", "I")),
        "M593": Kept(by=("X", "Y")),
        "M851": Kept(),
        "M900": Kept(by=("T",), of_tool="T"),
        "M906": Kept(by=("T", "I")),
        "M913": Kept(by=("T", "I")),
    },
)
