"""Files that PrusaSlicer and CuraEngine make here: volumes by role, widths beside their own."""

import math
import os
import re
import shutil
import struct
import subprocess
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from fdjax.formats import read_file
from fdjax.formats.gcode_layers import Choice
from fdjax.formats.slicers import ROLE_OF

pytestmark = pytest.mark.slow
CUBE = [(0, 0, 0, 20, 20, 6)]
BRACKET = [(0, 0, 0, 8, 20, 12), (8, 0, 9, 26, 20, 12)]


def stl(path, boxes):
    """A model of boxes."""
    faces = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    data = b""
    for x0, y0, z0, x1, y1, z1 in boxes:
        corners = [(x, y, z) for z in (z0, z1) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
        for a, b, c, d in faces:
            for triangle in ((a, b, c), (a, c, d)):
                numbers = [value for k in triangle for value in corners[k]]
                data += struct.pack("<12fH", 0, 0, 0, *numbers, 0)
    path.write_bytes(bytes(80) + struct.pack("<I", len(data) // 50) + data)
    return path


def by_hand(text, areas):
    """mm^3 of each role, summed from E alone; what was pulled back comes first."""
    totals = defaultdict(float)
    position, e, tool, role, relative = {}, 0.0, 0, "", False
    owed = defaultdict(float)
    for line in text.splitlines():
        if line.startswith(";TYPE:"):
            name = line[6:].lower().replace("-", " ")
            role = ROLE_OF.get(name, name)
        words = line.split(";")[0].split()
        if not words:
            continue
        if words[0] in ("M82", "M83"):
            relative = words[0] == "M83"
        elif re.fullmatch(r"T\d", words[0]):
            tool = int(words[0][1:])
        given = {w[0]: float(w[1:]) for w in words[1:] if re.fullmatch(r"[XYZE]-?[\d.]+", w)}
        if words[0] == "G92":
            e = given.get("E", e)
        elif words[0] in ("G0", "G1"):
            moved = any(given.get(axis, position.get(axis)) != position.get(axis) for axis in "XY")
            position.update(given)
            if "E" in given:
                push = given["E"] if relative else given["E"] - e
                e = given["E"]
                paid = min(owed[tool], max(push, 0.0))
                owed[tool] += -min(push, 0.0) - paid
                totals[role] += (max(push, 0.0) - paid) * areas[tool] * moved
    return {role: total for role, total in totals.items() if total}


def read_by_role(path, **options):
    build = read_file(path, choice=Choice(roles=("all",)), **options)
    totals = defaultdict(float)
    for layer in build.layers:
        for road in layer.roads:
            totals[road.role] += road.segment_volumes(layer.height).sum()
    return build, dict(totals)


PRUSA = {
    "cube": (CUBE, []),
    "relative E": (CUBE, ["--use-relative-e-distances", "--before-layer-gcode=G92 E0"]),
    "bracket with supports": (BRACKET, ["--support-material"]),
    "raft": (CUBE, ["--raft-layers=3"]),
    "combined infill": (CUBE, ["--infill-every-layers=2", "--nozzle-diameter=0.6"]),
    "vase": (CUBE, ["--spiral-vase", "--top-solid-layers=0", "--fill-density=0", "--perimeters=1"]),
    "two objects": (CUBE, ["--duplicate=2", "--brim-width=3"]),
    "two extruders": (
        CUBE,
        ["--nozzle-diameter=0.4,0.4", "--filament-diameter=1.75,2.85", "--infill-extruder=2"],
    ),
}


@pytest.mark.skipif(shutil.which("prusa-slicer") is None, reason="no PrusaSlicer here")
@pytest.mark.parametrize("kind", PRUSA)
def test_prusaslicer(tmp_path, kind):
    boxes, options = PRUSA[kind]
    path = tmp_path / "part.gcode"
    model = stl(tmp_path / "part.stl", boxes)
    command = ["prusa-slicer", "-g", model, *options, "--output", path]
    subprocess.run(command, check=True, capture_output=True)
    text = path.read_text()
    diameters = [1.75, 2.85] if kind == "two extruders" else [1.75]
    expected = by_hand(text, [math.pi / 4 * each**2 for each in diameters])
    build, found = read_by_role(path)
    assert found == pytest.approx(expected, rel=1e-6)
    if kind == "vase":
        return  # where the flow ramps, the width is not the one told
    lines = text.splitlines()
    told, good = 0.0, 0.0
    for line_width, width, length in _widths(lines, build):
        told += length
        good += length * (abs(line_width - width) < 0.01)
    assert good > 0.99 * told > 1000


def _widths(lines, build):
    """Width told, width read and length of each piece, in the file's order."""
    width, x, y, told = 0.0, None, None, {}
    for line in lines:
        if line.startswith(";WIDTH:"):
            width = float(line[7:])
        match = re.match(r"G1 X([-\d.]+) Y([-\d.]+) E", line)
        place = re.match(r"G1 X([-\d.]+) Y([-\d.]+)", line)
        if match:
            told[(x, y, float(match[1]), float(match[2]))] = width
        if place:
            x, y = float(place[1]), float(place[2])
    for layer in build.layers:
        for road in layer.roads:
            for (a, b), wide in zip(
                np.stack([road.path[:-1], road.path[1:]], 1), road.width, strict=True
            ):
                key = (*a.tolist(), *b.tolist())
                if key in told:
                    yield told[key], float(wide), float(np.hypot(*(b - a)))


CURA = "/usr/share/cura/resources"


@pytest.mark.skipif(shutil.which("CuraEngine") is None, reason="no CuraEngine here")
@pytest.mark.parametrize("adhesion", ["skirt", "raft", "brim"])
def test_curaengine(tmp_path, adhesion):
    resources = Path(os.environ.get("CURA_RESOURCES", CURA))
    definition = resources / "definitions" / "fdmprinter.def.json"
    if not definition.exists():
        pytest.skip("no definitions of Cura here; CURA_RESOURCES may name their folder")
    path = tmp_path / "part.gcode"
    model = stl(tmp_path / "part.stl", CUBE)
    settings = [
        f"adhesion_type={adhesion}",
        "roofing_layer_count=0",
        "infill_line_distance=2.25",
        "mesh_rotation_matrix=[[1,0,0],[0,1,0],[0,0,1]]",
    ]
    command = ["CuraEngine", "slice", "-j", definition, "-o", path]
    command += [word for setting in settings for word in ("-s", setting)]
    search = f"{definition.parent}:{resources / 'extruders'}"
    subprocess.run(
        [*command, "-e0", "-l", model],
        check=True,
        capture_output=True,
        env={**os.environ, "CURA_ENGINE_SEARCH_PATH": search},
    )
    expected = by_hand(path.read_text(), [math.pi / 4 * 2.85**2])
    _, found = read_by_role(path, filament=2.85)
    assert found == pytest.approx(expected, rel=1e-6)
    part = read_file(path, filament=2.85)
    widths = np.concatenate([road.width for layer in part.layers[1:] for road in layer.roads])
    lengths = np.concatenate(
        [road.segment_lengths for layer in part.layers[1:] for road in layer.roads]
    )
    # Its lines are .4 mm wide; E has five decimals, which in short ones is a per cent.
    assert lengths[np.abs(widths - 0.4) < 0.01].sum() > 0.98 * lengths.sum()
