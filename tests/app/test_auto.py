"""A job of kind auto: what suits is tried, the best is kept, and the report says so."""

import json

import pytest

from fdjax.app.config import parse
from fdjax.app.run import design
from fdjax.errors import InputError

pytestmark = pytest.mark.usefixtures("compiled_once")


def test_the_best_of_what_suits_is_kept_and_said(tmp_path):
    job = parse({
        "files": ["gcode"],
        "part": {"shape": "rectangle", "size": ["20mm", "15mm"], "layers": 4},
        "target": {"solid": "0.3 + 0.1*x/20", "tolerance": 0.05},
        "pattern": {"kind": "auto", "tried": ["transfinite", "blocks"], "phases": 2},
        "design": {"iterations": 8},
    })  # fmt: skip
    table = design(job, tmp_path, progress=lambda _: None)
    notes = json.loads((tmp_path / "report.json").read_text())["notes"]
    assert [note.split(":")[0] for note in notes[:2]] == ["tried transfinite", "tried blocks"]
    assert all(note in table for note in notes)
    kept = notes[2].removeprefix("kept ")
    report = json.loads((tmp_path / "report.json").read_text())
    kind = report["design"]["pattern"]["kind"]
    assert kind == {"transfinite": "grid-lines", "blocks": "blocks"}[kept]
    # What is compared are files: the one that is kept is the one that was looked at.
    facts = report["files"]["part.gcode"]
    rms, shifted = facts["rms"], facts["rms_windows_shifted_by_half"]
    assert f"tried {kept}: RMS {rms:.4f}, shifted {shifted:.4f} in its file" in notes
    assert (tmp_path / "part.gcode").exists()


def test_where_nothing_suits_it_is_said(tmp_path):
    job = parse({
        "files": ["gcode"],
        "part": {"shape": "rectangle", "size": ["20mm", "15mm"]},
        "target": {"solid": 0.3},
        "pattern": {"kind": "auto", "tried": ["polar"]},
    })  # fmt: skip
    with pytest.raises(InputError, match="none of polar suits this outline"):
        design(job, tmp_path, progress=lambda _: None)
