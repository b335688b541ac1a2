"""What a report says beside its numbers."""

import json

from fdjax.app import config
from fdjax.app.run import design


def test_a_mean_missed_for_roads_too_short_is_told_of(tmp_path):
    tables = {
        "machine": "stratasys-fdm1650",
        "files": ["sml"],
        "part": {"shape": "rectangle", "size": [20, 20], "layers": 2, "layer_height": "0.010in"},
        "target": {"solid": 0.35, "tolerance": 1.0},
        "pattern": {"kind": "texture", "cell": "hexagonal"},
        "design": {"iterations": 1, "corrections": 0},
    }
    design(config.parse(tables, name="job"), tmp_path, progress=lambda text: None)
    report = json.loads((tmp_path / "report.json").read_text())
    facts = report["files"]["job.sml"]
    assert facts["mean_got"] > facts["mean_asked"] + 0.01
    (note,) = [note for note in report["notes"] if "left out" in note]
    assert f"{1 - facts['mean_got']:.4f} is laid: roads shorter than the machine's 3.3 mm" in note
