#!/usr/bin/env bash
# gcode-lib's linearize_arcs, which is there for hosts and tools that know no arcs, moves some of
# them elsewhere, without a word:
# - with R in place of I and J the arc is drawn about the point where it starts, as if I and J were
#   0: the first chord leaps to the far side, and the arc is longer than any of that radius;
# - of a helix the first chord rises by the whole Z, and the rest is flat;
# - under G91 the chords' ends are absolute, and G91 still holds, so that they add up.
# An arc with I and J under G90 comes out right.
#
# Seen with gcode-lib 1.1.13 on a half circle about (5, 0), as told at the end of this script, which
# exits 0 while that is so.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q gcode-lib==1.1.13

venv/bin/python - <<'PY' | tee seen
import math

import gcode_lib


def ends(arc, mode="G90"):
    """Where the chords of an arc from (0, 0, 0) end, as a machine reads them."""
    text = f"G21\n{mode}\nM83\n{arc} E1\n"
    at, found = [0.0, 0.0, 0.0], []
    for line in gcode_lib.linearize_arcs(gcode_lib.from_text(text).lines):
        if line.raw.startswith("G1 "):
            for axis, letter in enumerate("XYZ"):
                word = next((w for w in line.raw.split() if w[0] == letter), None)
                if word:
                    at[axis] = float(word[1:]) + (at[axis] if mode == "G91" else 0)
            found.append(tuple(at))
    return found


def length(points):
    return sum(math.dist(a, b) for a, b in zip(points, points[1:]))


half = math.pi * 5
for name, arc, mode in (
    ("I, J", "G2 X10 Y0 I5 J0", "G90"),
    ("R", "G2 X10 Y0 R5", "G90"),
    ("I, J under G91", "G2 X10 Y0 I5 J0", "G91"),
):
    points = ends(arc, mode)
    print(f"half circle by {name}: {length([(0, 0, 0), *points]) / half:.2f} of its length,", end=" ")
    print("first at ({:.1f}, {:.1f}), last at ({:.1f}, {:.1f})".format(*points[0][:2], *points[-1][:2]))
z = [point[2] for point in ends("G2 X10 Y0 Z1 I5 J0")]
print(f"half a turn of a helix that rises by 1: at {z[0]:g} after the first chord of {len(z)}")
PY
diff seen - <<'SEEN'
half circle by I, J: 1.00 of its length, first at (0.0, 0.2), last at (10.0, 0.0)
half circle by R: 4.62 of its length, first at (10.0, -0.2), last at (10.0, 0.0)
half circle by I, J under G91: 32.33 of its length, first at (0.0, 0.2), last at (400.0, 251.4)
half a turn of a helix that rises by 1: at 1 after the first chord of 79
SEEN
