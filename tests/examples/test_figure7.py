"""The example that prints and draws Figure 7: its zones and blocks are in the files."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from shapely import LineString, box

from fdjax.formats import read_file

SCRIPT = Path(__file__).parents[2] / "examples" / "figure7.py"


@pytest.mark.slow
def test_both_grids_are_drawn_and_the_embedded_one_is_finer_where_it_says(tmp_path):
    script = runpy.run_path(str(SCRIPT))
    script["main"](["--out", str(tmp_path)])
    with Image.open(tmp_path / "figure7.png") as picture:
        assert min(picture.size) > 300
    for name in script["JOBS"]:
        assert json.loads((tmp_path / name / "report.json").read_text())["ok"]
    layers = read_file(tmp_path / "figure7a" / "figure7a.gcode").layers
    density = []
    for place in (box(5, 2, 15, 50), box(24, 13, 33, 43), box(39, 22, 57, 34)):
        inside = [
            LineString(road.path).intersection(place).length
            for layer in layers
            for road in layer.roads
        ]
        density.append(np.sum(inside) / place.area)
    assert density[1] / density[0] == pytest.approx(2, rel=0.15)
    assert density[2] / density[1] == pytest.approx(2, rel=0.15)
