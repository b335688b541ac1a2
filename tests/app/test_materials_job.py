"""`[materials]` of a job: what it takes, what it refuses, and what a file then holds."""

import json

import numpy as np
import pytest
from PIL import Image

from fdjax.app import config
from fdjax.app.run import design
from fdjax.errors import InputError
from fdjax.formats import read_file


def job_of(folder, materials, machine="marlin-0.4-dual", **tables):
    table = {
        "machine": machine,
        "files": ["gcode", "sml"],
        "part": {"shape": "rectangle", "size": [20, 20], "layers": 4},
        "target": {"solid": 0.25, "tolerance": 0.2},
        "pattern": {"kind": "grid-lines", "map": "uniform"},
        "design": {"controls": []},
        "materials": materials,
    }
    return config.parse(table | tables, folder=folder, name="job")


def test_a_split_function_is_met_by_volume_in_both_files(tmp_path):
    job = job_of(tmp_path, {"function": "x + y - 15", "split": True})
    table = design(job, tmp_path, progress=lambda text: None)
    report = json.loads((tmp_path / "report.json").read_text())
    asked = 1 - (15**2 / 2) / 20**2
    for name, facts in report["files"].items():
        found = facts["materials"]
        assert found["asked"] == pytest.approx([1 - asked, asked], abs=0.005)
        assert found["got"] == pytest.approx(found["asked"], abs=0.01)
        assert found["changes"] <= 4
        build = read_file(tmp_path / name, machine=facts["machine"])
        wrong = 0.0
        for layer in build.layers:
            for road in layer.roads:
                over = (road.path[1:] + road.path[:-1]).sum(1) / 2 - 15
                # But for half a road's width, and what short pieces grow by.
                beyond = (over if road.material else -over) < -0.3
                wrong += road.segment_volumes(layer.height)[beyond].sum()
        assert wrong < 0.01 * build.volume
    assert "of the volume, 0.2" in table


def test_a_picture_is_looked_up_at_the_centre_of_each_road(tmp_path):
    pixels = np.zeros((4, 4), np.uint8)
    pixels[:, 1:] = 255
    Image.fromarray(pixels).save(tmp_path / "wide.png")
    job = job_of(tmp_path, {"image": "wide.png"}, files=["gcode"])
    design(job, tmp_path, progress=lambda text: None)
    facts = json.loads((tmp_path / "report.json").read_text())["files"]["job.gcode"]["materials"]
    assert facts["wrong"] == 0
    assert facts["asked"] == pytest.approx([0.25, 0.75], abs=1e-6)


@pytest.mark.parametrize(
    ("materials", "words"),
    [
        ({"function": "x", "share": 0.5}, "exactly one of"),
        ({"split": True}, "needs one of function, image, share"),
        ({"function": "x", "tools": [1, 1]}, "2 different ones are needed"),
        ({"function": "x", "tools": [0, 1, 2]}, "2 different ones are needed"),
        ({"function": "x", "levels": [1, 0]}, "each must be above the one before"),
        ({"function": "x", "levels": []}, "one value or more is needed"),
        ({"share": 0.5, "levels": [0]}, "levels is for function or image"),
        ({"share": [0.7, 0.6]}, "more than 1 together"),
        ({"share": 0.5, "unit": "in"}, "unit is for function"),
        ({"function": "x", "seed": 3}, "seed is for share"),
        ({"function": "x +"}, "syntax error"),
        ({"image": "none.png"}, "no such file"),
        ({"share": 2}, "out of range"),
    ],
)
def test_what_a_job_cannot_mean_is_refused_in_one_line(tmp_path, materials, words):
    with pytest.raises(InputError, match=words) as caught:
        job_of(tmp_path, materials)
    assert "[materials]" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_material_that_the_machine_lacks_is_refused_before_any_work(tmp_path):
    job = job_of(tmp_path, {"function": "x"}, machine="marlin-0.4")
    with pytest.raises(InputError, match=r"tool 1 is asked for, but marlin-0\.4 has 1"):
        design(job, tmp_path, progress=lambda text: None)
    assert list(tmp_path.iterdir()) == []


def test_a_function_that_is_not_finite_is_refused_before_any_work(tmp_path):
    job = job_of(tmp_path, {"function": "1/(x-x)"})
    said: list[str] = []
    with pytest.raises(InputError, match="the function is inf at"):
        design(job, tmp_path, progress=said.append)
    assert said == []
