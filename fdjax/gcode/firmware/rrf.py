"""RepRapFirmware 3.5: sources are its files in src/GCodes and docs.duet3d.com ("G-codes").

- Only M82 and M83 set E's mode: `drivesRelative` beside `axesRelative` (GCodes2.cpp).
- Words alone go on with a motion in its CNC mode only (StringParser.cpp).
- It runs all commands of a line (GCodeBuffer/StringParser.cpp).
- G4 takes S before P (GCodes2.cpp, DoDwell). F below `minimumMovementSpeed` is raised to it.
- M106 without S configures or reports (GCodes2.cpp); M221 names its drive by D.
- M566, M572 and M201 to M205 hold until they are given again; M376 is the height at which G29's
  mesh fades out, G29 S1 loads the mesh and S2 turns it off. Homing does not.
- G92 sets the machine's own position: axes that it names count as homed, and limits go with it
  (GCodes.cpp, SetPositions).
- M120 and M121 push and pop feed, units and modes, not the place (GCodeMachineState.h).
- An unknown M-code is a warning; M21 is known.
"""

from fdjax.gcode.firmware.base import Firmware, Kept

REPRAP = Firmware(
    "rrf",
    e_mode="apart",
    runs_all=True,
    bare_fan=False,
    flow_tool="D",
    shifts_machine=True,
    save="M120",
    restore="M121",
    stacks=True,
    kept={
        "M92": Kept(),
        "M201": Kept(),
        "M201.1": Kept(),
        "M203": Kept(),
        "M204": Kept(),
        "M205": Kept(),
        "M207": Kept(by=("P",)),
        "M302": Kept(),
        "M376": Kept(),
        "M486": Kept(once=("S", "A", "P", "U", "C")),
        "M566": Kept(),
        "M572": Kept(by=("D",)),
        "M579": Kept(),
        "M593": Kept(),
        "M906": Kept(),
        "M913": Kept(),
    },
)
