#!/usr/bin/env bash
# The filament that gcode-lib's compute_stats says a file extrudes is not what leaves the nozzle:
# - what a retraction pulled back counts a second time when it is pushed forward again, so the sum
#   grows with the number of retractions;
# - lines whose words stand without blanks count nothing, though firmwares take them.
#
# Seen with gcode-lib 1.1.13, as told at the end of this script, which exits 0 while that is so.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q gcode-lib==1.1.13

venv/bin/python - <<'PY' | tee seen
import gcode_lib


def extruded(*lines):
    text = "\n".join(["G21", "G90", "M83", "G1 X0 Y0 Z0.2 F600", *lines]) + "\n"
    return gcode_lib.compute_stats(gcode_lib.from_text(text).lines).total_extrusion


pause = ["G1 E-.8", "G1 X15", "G1 E.8"]
for name, said in (
    ("two moves of 1 mm", extruded("G1 X10 E1", "G1 X20 E1")),
    ("with a retraction between", extruded("G1 X10 E1", *pause, "G1 X20 E1")),
    ("with ten of them", extruded("G1 X10 E1", *10 * pause, "G1 X20 E1")),
    ("without blanks", extruded("G1X10E1", "G1X20E1")),
):
    print(f"{name}: {said:g} mm for 2")
PY
diff seen - <<'SEEN'
two moves of 1 mm: 2 mm for 2
with a retraction between: 2.8 mm for 2
with ten of them: 10 mm for 2
without blanks: 0 mm for 2
SEEN
