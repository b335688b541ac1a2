#!/usr/bin/env bash
# In OctoPrint's analysis the time of an arc depends on how it is spelt. Half a circle takes its true
# time when I and J say where its centre is. With R, the same half circle takes only as long as its
# filament would take by itself at that feed; so does a whole circle, which ends where it began.
#
# Seen with OctoPrint 1.11.8 (octoprint/util/gcodeInterpreter.py): seconds of
#   half circle by I, J: 3.14
#   half circle by R: 0.10
#   whole circle: 0.20
# for arcs of radius 10 mm at 10 mm/s. Exits 0 while that is so.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q OctoPrint==1.11.8

venv/bin/python - <<'PY' | tee seen
from octoprint.util.gcodeInterpreter import gcode

def seconds(*lines):
    with open("arc.gcode", "w") as file:
        file.write("\n".join(["G21", "G90", "M83", "G1 X50 Y50 F600", *lines]) + "\n")
    found = gcode()
    found.load("arc.gcode")
    return 60 * found.totalMoveTimeMinute

before = seconds()
for name, arc in (
    ("half circle by I, J", "G3 X70 Y50 I10 J0 E1 F600"),
    ("half circle by R", "G3 X70 Y50 R10 E1 F600"),
    ("whole circle", "G3 X50 Y50 I10 J0 E2 F600"),
):
    print(f"{name}: {seconds(arc) - before:.2f}")
PY
diff seen - <<'SEEN'
half circle by I, J: 3.14
half circle by R: 0.10
whole circle: 0.20
SEEN
