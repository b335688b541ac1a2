"""The example jobs: each can be set up, and each designs to the end."""

import sys
from pathlib import Path

import pytest

from fdjax.app import config, setting
from fdjax.app.cli import main

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests" / "machine"))
import klippy  # noqa: E402

JOBS = sorted((ROOT / "examples").glob("*.toml"))


@pytest.mark.parametrize("path", JOBS, ids=lambda path: path.stem)
def test_job_can_be_set_up(path):
    job = config.load(path)
    part = setting.part_of(job.part)
    target = setting.target_of(job.target, part)
    centre = part.regions[0].geometry.representative_point()
    assert 0 <= float(target(centre.x, centre.y)) <= 1
    machines, left_out = setting.machines_of(job, part)
    assert left_out == []
    for kind, machine in machines.items():
        assert kind in (machine.format, "ssl")


@pytest.mark.slow
@pytest.mark.parametrize("path", JOBS, ids=lambda path: path.stem)
def test_job_designs_to_the_end(path, tmp_path):
    out = tmp_path / "out"
    assert main(["design", str(path), "--out", str(out), "--quiet"]) == 0
    job = config.load(path)
    asked = {f"{job.name}.{kind}" for kind in job.files or config.FILE_KINDS}
    asked |= {"report.json", "roads.png", "porosity.png"}
    asked |= {"laplacians.png"} if job.design.laplacians else set()
    assert asked == {p.name for p in out.iterdir()}
    for path in out.glob("*.gcode") if klippy.PROGRAM is not None else ():
        assert klippy.judged(path, tmp_path) == []  # by a real host; see `klippy`
