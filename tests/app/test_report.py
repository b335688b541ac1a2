"""What a report says beside its numbers."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from fdjax.app import config
from fdjax.app.measuring import Question, answer
from fdjax.app.report import faults_of, scaled_sections
from fdjax.app.run import design
from fdjax.errors import DesignError


def test_a_file_that_leaves_out_roads_too_short_is_refused_and_says_why(tmp_path):
    tables = {
        "machine": "stratasys-fdm1650",
        "files": ["sml"],
        "part": {"shape": "rectangle", "size": [20, 20], "layers": 2, "layer_height": "0.010in"},
        "target": {"solid": 0.35, "tolerance": 1.0},
        "pattern": {"kind": "texture", "cell": "hexagonal"},
        "design": {"iterations": 1, "corrections": 0},
    }
    said = r"too close or shorter than the machine's 3.3 mm, \d+\.\d % left out, 2 % is allowed"
    with pytest.raises(DesignError, match=said):
        design(config.parse(tables, name="job"), tmp_path, progress=lambda text: None)
    facts = json.loads((tmp_path / "report.json").read_text())["files"]["job.sml"]
    assert facts["thinned"] > 0.02 * facts["volume"]
    assert not (tmp_path / "job.sml").exists()


def test_of_many_faults_the_first_are_told_and_the_report_has_all(tmp_path):
    # Two lines that part at five degrees lie on each other, layer by layer.
    lens = [[[0, 0.5], [0.5, 0.5 + side], [1, 0.5]] for side in (0.02, -0.02)]
    tables = {
        "files": ["gcode"],
        "part": {"shape": "rectangle", "size": [20, 20], "layers": 5},
        "target": {"solid": 0.3, "tolerance": 1.0},
        "pattern": {"kind": "texture", "cell": {"size": [1, 1], "lines": lens}},
        "design": {"iterations": 1, "corrections": 0},
    }
    with pytest.raises(DesignError, match=r"spacing, layer 0.*2 more in report.json$") as caught:
        design(config.parse(tables, name="job"), tmp_path, progress=lambda text: None)
    assert "\n" not in str(caught.value)
    assert len(json.loads((tmp_path / "report.json").read_text())["faults"]) == 5


def test_a_job_that_counts_coverage_says_it_and_the_volume(tmp_path):
    tables = {
        "files": ["gcode"],
        "part": {"shape": "rectangle", "size": [20, 20], "layers": 2},
        "target": {"solid": 0.35, "tolerance": 0.2},
        "pattern": {"kind": "mesh", "count": "coverage", "phases": 2},
        "design": {"controls": []},
    }
    said = design(config.parse(tables, name="job"), tmp_path, progress=lambda text: None)
    assert "the same, by volume" in said
    assert "what is open, seen from above" in said
    facts = json.loads((tmp_path / "report.json").read_text())["files"]["job.gcode"]
    assert facts["count"] == "coverage"
    assert 1 - facts["mean_got"] == pytest.approx(facts["coverage"], rel=1e-3)
    solid = facts["volume"] / (20 * 20 * 2 * 0.2)
    assert 1 - facts["by_volume"]["mean_got"] == pytest.approx(solid, rel=1e-9)
    assert facts["by_volume"]["mean_got"] > facts["mean_got"] + 0.005
    target = {"target": "0.65"}
    counted, plain = (
        answer(tmp_path / "job.gcode", Question(**target, count=count)).facts()
        for count in ("coverage", "volume")
    )
    for name in ("mean_got", "rms"):
        assert counted[name] == pytest.approx(facts[name])
        assert plain[name] == pytest.approx(facts["by_volume"][name])


@pytest.mark.parametrize(("model", "single"), [(0.004, True), (0.019, False)])
def test_a_file_that_misses_by_more_than_its_model_says_that_single_roads_show(model, single):
    result = SimpleNamespace(
        made=True,
        limited_by=["span at its limit"],
        outcome=SimpleNamespace(error=model),
        controls=None,
        pattern=SimpleNamespace(facts=lambda controls: {}),
    )
    file = SimpleNamespace(
        path=Path("job.gcode"), planned=1.0, thinned=0.0, errors=[], subdomains=(),
        comparison=SimpleNamespace(rms=0.025),
    )  # fmt: skip
    job = config.parse({"part": {"shape": "rectangle", "size": [9, 9]}, "target": {"solid": 0.2}})
    ((_, said),) = faults_of(job, result, [file])  # type: ignore[arg-type]
    assert said.startswith("job.gcode misses its target: RMS 0.0250 in 5 mm windows")
    assert "limited by span at its limit" in said
    assert ("single roads, where their mean would miss by 0.004" in said) == single


@pytest.mark.parametrize(
    ("free", "scaled", "noted"), [(False, 0.025, 1), (False, -0.009, 0), (True, 0.2, 0)]
)
def test_sections_that_changed_are_told_of_where_the_job_gave_their_width(free, scaled, noted):
    job = SimpleNamespace(pattern=SimpleNamespace(width_is_free=free))
    notes = scaled_sections(job, [SimpleNamespace(path=Path("a.sml"), scaled=scaled)])
    assert len(notes) == noted
    assert all("a.sml: sections are changed by +2.5 %" in note for note in notes)
