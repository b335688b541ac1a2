"""The output folder: all of it or nothing."""

import pytest

from fdjax.app.output import output_folder
from fdjax.errors import DesignError, InputError


def test_files_move_at_the_end_and_parents_are_made(tmp_path):
    out = tmp_path / "a" / "b"
    with output_folder(out) as folder:
        (folder / "x.gcode").write_text("1")
        assert not out.exists()
    assert [p.name for p in out.iterdir()] == ["x.gcode"]
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_owned_files_of_an_earlier_run_go_and_others_stay(tmp_path):
    for name in ("x.gcode", "report.json", "mine.txt"):
        (tmp_path / name).write_text("old")
    with output_folder(tmp_path, owned=("x.gcode", "x.sml", "report.json")) as folder:
        (folder / "report.json").write_text("new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.txt", "report.json"]
    assert (tmp_path / "report.json").read_text() == "new"


@pytest.mark.parametrize("fault", [InputError("no"), RuntimeError("no"), KeyboardInterrupt()])
def test_nothing_is_left_after_a_fault(tmp_path, fault):
    (tmp_path / "x.gcode").write_text("old")

    def fail(path):
        with output_folder(path, owned=("x.gcode",)) as folder:
            (folder / "x.gcode").write_text("half")
            raise fault

    for path in (tmp_path, tmp_path / "new" / "deep"):
        with pytest.raises(type(fault)):
            fail(path)
    assert [p.name for p in tmp_path.iterdir()] == ["x.gcode"]
    assert (tmp_path / "x.gcode").read_text() == "old"


def test_a_failed_design_leaves_its_report(tmp_path):
    def fail():
        with output_folder(tmp_path / "out") as folder:
            (folder / "report.json").write_text("failed")
            raise DesignError("folded")

    with pytest.raises(DesignError):
        fail()
    assert (tmp_path / "out" / "report.json").read_text() == "failed"


def test_folders_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="is no folder"), output_folder(path):
            pass
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="cannot be written"), output_folder(tmp_path / "dangling"):
        pass
    (tmp_path / "out" / "report.json").mkdir(parents=True)
    with (
        pytest.raises(InputError, match="cannot be written"),
        output_folder(tmp_path / "out") as folder,
    ):
        (folder / "report.json").write_text("1")
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(InputError, match="no permission"), output_folder(tmp_path / "x"):
        pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["dangling", "file", "out"]
