"""Files of others: measured right, or refused with the reason."""

import pytest
from others_files import CASES, seen


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_files_of_others(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = seen(case, tmp_path)
    if isinstance(case.right, float):
        assert found == pytest.approx(case.right, abs=1e-4)
        return
    assert str(found).startswith("exit 2: fdjax: error: ")
    assert case.right in str(found)
    assert str(found).count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == [f"{case.name}.gcode"]
