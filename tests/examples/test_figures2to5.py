"""The example that draws and prints Figures 2 to 5: its six jobs run, and lay what they say."""

import itertools
import json
import re
import runpy
from pathlib import Path

import pytest
import shapely
from PIL import Image

from fdjax.formats import read_file

SCRIPT = Path(__file__).parents[2] / "examples" / "figures2to5.py"
ENDS_EARLY = {"figure4": 0.02, "figure5": 0.2}
"""Share of the lines that may end early, where sides meet at small angles or at none."""

UNIFORM = {"figure2_rectangle", "figure2_circle"}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures") / "new"
    script = runpy.run_path(str(SCRIPT))
    script["main"](["--out", str(folder)])
    return folder, script["JOBS"]


def test_each_job_runs_and_lays_its_lines(finished):
    folder, jobs = finished
    for name in jobs:
        report = json.loads((folder / name / "report.json").read_text())
        assert report["ok"], name
        (file,) = report["files"].values()
        assert file["thinned"] <= ENDS_EARLY.get(name, 0) * (file["thinned"] + file["volume"])
        assert 0.75 < file["mean_got"] < 0.85
        assert {finding["severity"] for finding in file["findings"]} <= {"warning"}
        assert (folder / name / "roads.png").exists()


def test_uniform_lines_are_as_far_apart_as_the_box_says(finished):
    folder, _ = finished
    for name in UNIFORM:
        layer = read_file(folder / name / f"{name}.gcode").layers[0]
        (road,) = layer.roads
        x0, y0, x1, y1 = layer.outline.bounds
        middle = shapely.LineString([(x0, (y0 + y1) / 2 + 0.1), (x1, (y0 + y1) / 2 + 0.1)])
        crossings = shapely.get_parts(shapely.LineString(road.path).intersection(middle))
        at = sorted(point.x for point in crossings)
        gaps = {round(b - a, 1) for a, b in itertools.pairwise(at[1:-1])}
        assert len(at) == {"figure2_rectangle": 31, "figure2_circle": 26}[name]
        assert max(gaps) - min(gaps) < 0.15


def test_the_even_grid_is_the_evenest(finished):
    folder, jobs = finished
    rms = {
        name: next(iter(json.loads((folder / name / "report.json").read_text())["files"].values()))[
            "rms"
        ]
        for name in jobs
    }
    assert max(rms[name] for name in UNIFORM) < min(rms[name] for name in set(jobs) - UNIFORM)


def test_the_grids_are_drawn(finished):
    folder, jobs = finished
    with Image.open(folder / "figures2to5.png") as picture:
        assert min(picture.size) >= 1000
    text = (folder / "figures2to5.svg").read_text()
    assert len(re.findall(r"<!-- Figure \d", text)) == len(jobs)
