#!/usr/bin/env bash
# printrun's estimate of a file's time counts a wait in milliseconds and not the same wait in seconds:
# G4 P10000 takes 10 s, G4 S10 none, though Marlin, for which it is made, knows both. An arc takes no
# time either; its filament and its ends are counted.
#
# Seen with printrun 2.2.0 (printrun/gcoder.py, `estimate_duration`), without its window libraries:
#   G4 P10000: 10 s
#   G4 S10: 0 s
#   G3 X70 Y50 I10 J0 E1: 0 s
#   G1 X70 Y50 E1: 2 s
# Exits 0 while that is so.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --no-deps printrun==2.2.0

venv/bin/python - <<'PY' | tee seen
from printrun.gcoder import GCode

START = ["G21", "G90", "M83", "G1 Z0.2 F600", "G1 X50 Y50 F6000", "G1 X50 Y50 F600"]
before = GCode(START).estimate_duration()[1]
for line in ("G4 P10000", "G4 S10", "G3 X70 Y50 I10 J0 E1", "G1 X70 Y50 E1"):
    seconds = (GCode([*START, line]).estimate_duration()[1] - before).seconds
    print(f"{line}: {seconds} s")
PY
diff seen - <<'SEEN'
G4 P10000: 10 s
G4 S10: 0 s
G3 X70 Y50 I10 J0 E1: 0 s
G1 X70 Y50 E1: 2 s
SEEN
