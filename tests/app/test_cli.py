"""The command line: exit codes, what is printed, and what is not loaded."""

import json
import os
import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest
import shapely
from PIL import Image

from fdjax.app import cli
from fdjax.app.cli import main
from fdjax.errors import DesignError, InputError
from fdjax.formats import gcode, profile
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.road.bead import section_area

SOLID = section_area(0.4, 0.2) / (0.2 * 2.0)
"""Solid share of roads 0.4 wide, 0.2 high, 2 apart."""

JOB = '[part]\nshape = "rectangle"\nsize = [20, 10]\n[target]\nsolid = 0.2\n'


@pytest.fixture
def plate(tmp_path, monkeypatch):
    """A G-code file of straight roads 2 mm apart on a plate of 20 x 10 mm, two layers."""
    roads = tuple(Road([(0, y), (20, y)], 0.4, family="xi") for y in np.arange(1, 10, 2))
    outline = shapely.box(0, 0, 20, 10)
    layers = tuple(Layer(0.2 * k, 0.2, roads, outline) for k in (1, 2))
    build = Build(layers, name="plate", origin=(50.0, 60.0))
    path = tmp_path / "plate.gcode"
    path.write_text(gcode.write(build, profile.load("marlin-0.4")))
    monkeypatch.chdir(tmp_path)
    return path


@pytest.fixture
def design(monkeypatch):
    """Puts a design in the place of the real one; set `design.run` to what it shall do."""
    module = ModuleType("fdjax.app.run")
    monkeypatch.setitem(sys.modules, "fdjax.app.run", module)
    monkeypatch.setattr("fdjax.app.run", module, raising=False)
    monkeypatch.setattr(cli, "_prepare_jax", lambda: None)

    def stand_in(job, folder, *, progress):
        progress("error 0.1")
        (folder / f"{job.name}.gcode").write_text(str(job.design.export_failed))
        return module.run()  # type: ignore[attr-defined]

    module.design = stand_in  # type: ignore[attr-defined]
    module.run = lambda: "the table"  # type: ignore[attr-defined]
    return module


def one_line(capsys) -> str:
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("fdjax: error: ")
    assert err.count("\n") == 1
    return err


def test_measure_prints_draws_and_writes_what_the_file_says(plate, capsys):
    arguments = ["measure", str(plate), "--target", "0.2", "--solid", "--json", "m.json"]
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "plate.gcode: 2 layers, 10 roads" in out
    fact = json.loads((plate.parent / "m.json").read_text())
    assert fact["mean_got"] == pytest.approx(1 - SOLID, abs=1e-4)
    assert fact["mean_asked"] == pytest.approx(0.8)
    assert fact["windows"] == 8
    # the road on the edge of two windows counts in the upper one: two roads below, three above
    errors = 0.2 - np.array([2, 3]) * section_area(0.4, 0.2) / (0.2 * 5)
    assert fact["rms"] == pytest.approx(np.sqrt((errors**2).mean()), abs=1e-4)
    assert fact["largest"] == pytest.approx(errors[0], abs=1e-4)
    assert fact["largest_at"][1] == 2.5
    assert fact["volume"] == pytest.approx(SOLID * 20 * 10 * 0.4, rel=1e-4)
    assert f"{fact['rms']:.4f}" in out
    with Image.open(plate.parent / "plate_porosity.png") as picture:
        assert picture.width > 1000
    assert sorted(p.name for p in plate.parent.iterdir()) == [
        "m.json", "plate.gcode", "plate_porosity.png"]  # fmt: skip


def test_measure_with_shifted_windows_and_units(plate, capsys):
    common = ["measure", str(plate), "--target", "1 - x/40", "--unit", "in", "--picture", "p.pdf"]
    assert main([*common, "--window", "4mm", "--shift", "--json", "m.json"]) == 0
    fact = json.loads((plate.parent / "m.json").read_text())
    assert fact["x"][0] == pytest.approx(-2)
    assert fact["mean_asked"] == pytest.approx(1 - 10 / 25.4 / 40)
    assert "4 mm windows, shifted by half" in capsys.readouterr().out
    assert (plate.parent / "p.pdf").read_bytes().startswith(b"%PDF")


def test_measure_of_what_is_covered(plate, capsys):
    arguments = ["measure", str(plate), "--target", "0.8", "--count", "coverage"]
    assert main([*arguments, "--json", "m.json"]) == 0
    assert "mean of the part, of what is covered from above" in capsys.readouterr().out
    fact = json.loads((plate.parent / "m.json").read_text())
    assert fact["mean_got"] == pytest.approx(1 - fact["coverage"], abs=1e-4)
    assert fact["mean_got"] < 1 - SOLID - 0.01


def test_measure_against_an_array_lies_over_the_outline(plate):
    np.save(plate.parent / "f.npy", np.array([[0.5, 0.5], [0.9, 0.9]]))
    assert main(["measure", str(plate), "--target", "f.npy", "--json", "m.json"]) == 0
    asked = json.loads((plate.parent / "m.json").read_text())["asked"]
    np.testing.assert_allclose(asked, np.array([[0.55], [0.65], [0.75], [0.85]]) + np.zeros(2))


def test_measure_of_another_outline_leaves_windows_out(plate):
    job = ["measure", str(plate), "--target", "0.5", "--json", "m.json"]
    assert main([*job, "--outline", "POLYGON ((0 0, 20 0, 0 10, 0 0))"]) == 0
    got = json.loads((plate.parent / "m.json").read_text())["got"]
    assert got[3][1] is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.gcode", "--target", "0.5"], "nowhere.gcode"),
        (["plate.stl", "--target", "0.5"], "unknown kind of file"),
        (["cut.gcode", "--target", "0.5"], "truncated"),
        (["text.gcode", "--target", "0.5"], "not G-code"),
        (["plate.gcode", "--target", "0.5 +"], "syntax error at column"),
        (["plate.gcode", "--target", "__import__('os')"], "unknown function"),
        (["plate.gcode", "--target", "x"], "must lie in 0..1"),
        (["plate.gcode", "--target", "no.npy"], "no such file"),
        (["plate.gcode", "--target", "0.5", "--window", "5 feet"], "--window: unknown unit"),
        (["plate.gcode", "--target", "0.5", "--window", "-5"], "must be positive"),
        (["plate.gcode", "--target", "0.5", "--window", "5m"], "window"),
        (["plate.gcode", "--target", "0.5", "--unit", "ft"], "unknown unit"),
        (["plate.gcode", "--target", "0.5", "--outline", "no.json"], "no.json"),
        (["plate.gcode", "--target", "0.5", "--machine", "marlim-0.4"], "marlin-0.4"),
        (["plate.gcode", "--target", "0.5", "--filament", "thin"], "--filament"),
        (["plate.gcode", "--target", "0.5", "--picture", "p.docx"], "is written as .png"),
        (["plate.gcode", "--target", "0.5", "--picture", "no/p.png"], "cannot be written"),
        (["plate.gcode", "--target", "0.5", "--json", "no/m.json"], "cannot be written"),
        (["bare.gcode", "--target", "0.5"], "--outline"),
    ],
)
def test_measure_of_bad_input_is_one_line_and_exit_2(plate, capsys, arguments, words):
    text = plate.read_text()
    (plate.parent / "cut.gcode").write_text(text[: len(text) // 2])
    (plate.parent / "text.gcode").write_text("A letter, not a machine file.\n")
    bare = "G28\nG1 Z0.2\nG1 X0 Y0\nG1 X20 Y0 E1\nG1 X20 Y1\nG1 X0 Y1 E2\n"
    (plate.parent / "bare.gcode").write_text("; filament_diameter = 1.75\nM82\n" + bare)
    if arguments[0] == "bare.gcode":
        arguments = [*arguments, "--filament", "1.75", "--layer-height", "0.2"]
    assert main(["measure", *arguments]) == 2
    assert words in one_line(capsys)


def test_machines(capsys):
    assert main(["machines"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in listed] == profile.names()
    assert main(["machines", "stratasys-fdm1650"]) == 0
    shown = capsys.readouterr().out
    assert "bed                254, 254, 254\n" in shown
    assert "area_per_code      0.0015 (?)\n" in shown
    assert "no public source" in shown
    assert main(["machines", "marlin-0.4"]) == 0
    assert "(?)" not in capsys.readouterr().out
    assert main(["machines", "marlin"]) == 2
    assert "marlin-0.4" in one_line(capsys)


@pytest.mark.parametrize(
    "arguments",
    [[], ["desing"], ["design"], ["design", "j.toml"], ["measure", "f.gcode"], ["machines", "-x"]],
)
def test_a_wrong_command_line_exits_2(capsys, arguments):
    assert main(arguments) == 2
    assert "usage: fdjax" in capsys.readouterr().err


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("fdjax 0.")


def test_design_moves_its_files_and_prints_its_table(tmp_path, design, capsys):
    (tmp_path / "job.toml").write_text(JOB)
    arguments = ["design", str(tmp_path / "job.toml"), "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert (out, err) == ("the table\n", "error 0.1\n")
    assert (tmp_path / "out" / "job.gcode").read_text() == "False"
    assert main([*arguments, "--force-export", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "out" / "job.gcode").read_text() == "True"


@pytest.mark.parametrize(
    ("fault", "code", "left"),
    [
        (DesignError("the map folds"), 3, ["job.gcode"]),
        (InputError("no line count can give this"), 2, []),
        (KeyboardInterrupt(), 130, []),
    ],
)
def test_design_that_fails(tmp_path, design, capsys, fault, code, left):
    (tmp_path / "job.toml").write_text(JOB)

    def fail():
        raise fault

    design.run = fail
    out = tmp_path / "out"
    assert main(["design", str(tmp_path / "job.toml"), "--out", str(out), "--quiet"]) == code
    assert one_line(capsys) == f"fdjax: error: {fault if str(fault) else 'interrupted'}\n"
    assert [p.name for p in out.glob("*")] == left


def test_design_of_bad_input_leaves_no_folder(tmp_path, design, capsys):
    job = tmp_path / "job.toml"
    job.write_text(JOB.replace("shape", "shap"))
    assert main(["design", str(job), "--out", str(tmp_path / "out")]) == 2
    assert 'job.toml: [part]: unknown key "shap" (did you mean "shape"?)' in one_line(capsys)
    job.write_text(JOB)
    assert main(["design", str(job), "--out", str(job)]) == 2
    assert "is no folder" in one_line(capsys)
    assert [p.name for p in tmp_path.iterdir()] == ["job.toml"]


@pytest.mark.parametrize(
    ("arguments", "kept_out"),
    [
        (["--help"], ["jax", "numpy", "shapely", "matplotlib"]),
        (["design", "--help"], ["jax", "numpy", "shapely", "matplotlib"]),
        (["machines"], ["jax", "matplotlib"]),
        (["measure", "plate.gcode", "--target", "0.5"], ["jax", "matplotlib"]),
    ],
)
def test_commands_load_only_what_they_need(plate, arguments, kept_out):
    code = (
        "import sys; from fdjax.app.cli import main; "
        f"assert main({arguments!r}) == 0; "
        f"assert not set({kept_out!r}) & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=plate.parent, capture_output=True)


def test_a_design_of_lines_does_without_scipy():
    code = "import sys, fdjax.app.run, fdjax.pattern.isolines; assert 'scipy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_design_sets_up_numpy_before_it_is_loaded(tmp_path):
    code = (
        "import sys; from fdjax.app import cli; "
        "cli._prepare_jax = lambda: sys.exit(7 if 'numpy' in sys.modules else 5); "
        "cli.main(['design', 'job.toml', '--out', 'out'])"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=tmp_path).returncode == 5


def test_a_reader_that_has_had_enough_is_no_fault():
    command = [sys.executable, "-m", "fdjax", "machines"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    assert process.wait() == 0
    assert process.stderr.read() == b""
    process.stderr.close()


def test_measure_of_several_outlines_and_of_a_target_that_varies_in_z(plate, capsys):
    pair = "MULTIPOLYGON (((0 0, 8 0, 8 10, 0 10, 0 0)), ((12 0, 20 0, 20 10, 12 10, 12 0)))"
    job = ["measure", str(plate), "--window", "4", "--target"]
    assert main([*job, "0.5 + z/10", "--outline", pair]) == 0
    # The middles of the two layers lie at 0.1 and 0.3 mm.
    assert "porosity asked      0.5200" in capsys.readouterr().out
    assert main([*job, "3*z", "--outline", pair]) == 0
    assert main([*job, "4*z", "--outline", pair]) != 0
    assert "is 1.2 at" in capsys.readouterr().err


@pytest.mark.parametrize(("given", "kept"), [("/a/b", "/a/b/programs"), ("gs://a/b", "None")])
def test_programs_are_kept_beside_what_jax_keeps(given, kept):
    """In a process of its own: JAX keeps what it was told first."""
    code = (
        "from fdjax import programs; from fdjax.app import cli; "
        "cli._prepare_jax(); print(programs._Kept.folder)"
    )
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": given}
    told = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert told.stdout.strip() == kept
