"""How often a design is corrected by its plan."""

from types import SimpleNamespace

import numpy as np
import pytest

from fdjax.app import planning


class Found:
    """A design that moves with each correction."""

    def __init__(self, count=0):
        self.controls = np.array(float(count))

    def corrected(self, places, volumes, *, progress):
        return Found(int(self.controls) + 1)

    def recounted(self, laid):
        return self


@pytest.mark.parametrize(
    ("most", "largest", "kept"),
    [
        (0, [0.09], 0),
        (3, [0.09, 0.02, 0.01], 1),
        (3, [0.01, 0.01, 0.01], 1),
        (3, [0.09, 0.05, 0.02, 0.01], 2),
        (3, [0.09, 0.05, 0.04, 0.04], 3),
        (1, [0.09, 0.05, 0.02], 1),
    ],
)
def test_a_plan_is_corrected_anew_only_while_a_window_is_far_off(monkeypatch, most, largest, kept):
    def tried(job, result, *_):
        missed = SimpleNamespace(largest=largest[int(result.controls)])
        return SimpleNamespace(design=result, laid=1.0, plan=None, missed=missed)

    monkeypatch.setattr(planning, "_tried", tried)
    monkeypatch.setattr(planning, "_soundest", lambda job, made, machine: made[-1])
    monkeypatch.setattr(planning, "deposits", lambda *_: ([], []))
    pattern = SimpleNamespace(corrections=most, enough=0.03, count="volume")
    job = SimpleNamespace(pattern=pattern, target=SimpleNamespace(window=5.0))
    design, _ = planning._planned(job, Found(), None, None, None, None)
    assert design.controls == kept
