#!/usr/bin/env bash
# OctoPrint's analysis converts half of a file in inches. After G20 it takes X, Y and Z for inches,
# but E and F for millimetres: the part has its true size, its filament is 25.4 times too short and
# its time 25.4 times too long. Marlin and RepRapFirmware scale all of them.
#
# Seen with OctoPrint 1.11.8 (octoprint/util/gcodeInterpreter.py). The same square in both units:
#   mm:   width 25.40 filament 5.08 seconds 13.54
#   inch: width 25.40 filament 0.20 seconds 343.80
# Exits 0 while that is so.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q OctoPrint==1.11.8

cat > mm.gcode <<'MM'
G21
G90
M83
G1 X25.4 Y25.4 F609.6
G1 X50.8 E1.27
G1 Y50.8 E1.27
G1 X25.4 E1.27
G1 Y25.4 E1.27
MM
cat > inch.gcode <<'INCH'
G20
G90
M83
G1 X1 Y1 F24
G1 X2 E0.05
G1 Y2 E0.05
G1 X1 E0.05
G1 Y1 E0.05
INCH
venv/bin/python - <<'PY' | tee seen
from octoprint.util.gcodeInterpreter import gcode

for unit in ("mm", "inch"):
    file = gcode()
    file.load(f"{unit}.gcode")
    area = file.get_result()["printing_area"]
    width, seconds = area["maxX"] - area["minX"], 60 * file.totalMoveTimeMinute
    print(f"{unit}: width {width:.2f} filament {file.extrusionAmount[0]:.2f} seconds {seconds:.2f}")
PY
diff seen - <<'SEEN'
mm: width 25.40 filament 5.08 seconds 13.54
inch: width 25.40 filament 0.20 seconds 343.80
SEEN
