"""`fdjax send` as people use it, from a design's file to a virtual print and its porosity."""

import subprocess
import sys

import numpy as np
import pytest
from shapely import box
from streams import PRINTER, STRATASYS

import fdjax
from fdjax.app.cli import main
from fdjax.machine.journal import read_log
from fdjax.machine.virtual.marlin import VirtualMarlin
from fdjax.plan.toolpath import Build, Layer, Road

OUTLINE = box(0, 0, 40, 40)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A small build as G-code and as SML."""
    folder = tmp_path_factory.mktemp("files")
    layers = []
    for index in range(3):
        x = np.repeat(np.arange(2.0, 39.0, 2.0 + index), 2)
        y = np.resize([2.0, 38.0, 38.0, 2.0], len(x))
        road = Road(np.stack([x, y], 1), np.full(len(x) - 1, 0.5))
        layers.append(Layer(0.254 * (index + 1), 0.254, (road,), OUTLINE))
    build = Build(tuple(layers), name="mat", origin=(80.0, 80.0))
    fdjax.write_file(build, folder / "mat.gcode", PRINTER)
    fdjax.write_file(build, folder / "mat.sml", STRATASYS)
    return folder


def send(path, *options):
    machine = "stratasys-fdm1650" if path.suffix == ".sml" else "marlin-0.4"
    return main(["send", str(path), "--machine", machine, *options])


@pytest.fixture
def mat(files, tmp_path):
    path = tmp_path / "mat.gcode"
    path.write_text((files / "mat.gcode").read_text())
    return path


@pytest.mark.parametrize(
    ("name", "port"),
    [
        ("mat.gcode", "virtual:marlin"),
        ("mat.gcode", "virtual:marlin?faults=0.03&seed=5"),
        ("mat.gcode", "virtual:klipper"),
        ("mat.gcode", "virtual:rrf?faults=0.02&seed=1"),
        ("mat.sml", "virtual:fdm1650"),
    ],
)
def test_what_was_printed_has_the_porosity_of_the_file(files, tmp_path, name, port):
    path = tmp_path / name
    path.write_text((files / name).read_text())
    firmware = port[8:].partition("?")[0].replace("fdm1650", "sml")
    printed = tmp_path / "printed.gcode"
    options = ("--firmware", firmware, "--printed", str(printed), "--quiet")
    assert send(path, "--port", port, *options) == 0
    file, print_ = (fdjax.measure(fdjax.read_file(p), window=10) for p in (path, printed))
    np.testing.assert_allclose(print_.porosity, file.porosity, atol=2e-6)
    assert sorted(p.name for p in tmp_path.iterdir()) == [name, f"{name}.log", "printed.gcode"]


def test_the_log_replays_to_the_same_print(mat, capsys):
    printed, again = mat.with_name("printed.gcode"), mat.with_name("again.gcode")
    assert send(mat, "--port", "virtual:marlin", "--printed", str(printed), "--quiet") == 0
    log = mat.with_name("mat.gcode.log")
    times = [time for time, _, _ in read_log(log)]
    assert times == sorted(times)
    assert main(["virtual", "marlin", "--replay", str(log), "--printed", str(again)]) == 0
    assert "mm^3 laid down" in capsys.readouterr().out
    moves = [
        [line for line in path.read_text().splitlines() if line.startswith("G")]
        for path in (printed, again)
    ]
    assert moves[0] == moves[1]


def test_a_dry_run_sends_nothing(mat, capsys):
    assert send(mat, "--dry-run") == 0
    said = capsys.readouterr().out
    assert "layers    3" in said
    assert "material" in said
    assert [path.name for path in mat.parent.iterdir()] == ["mat.gcode"]


def refused(capsys, path, *options):
    """The one line that a bad request brings."""
    assert send(path, *options) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1, error
    assert not path.with_name(f"{path.name}.journal").exists()
    return error[0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("G28\n", "", "homing"),
        ("M104 S210", "M104 S999", "999"),
        ("; fdjax end\n", "", "truncated|end mark"),
        ("machine = marlin-0.4", "machine = other", "other"),
        ("G21\n", "G21\nM112\n", "M112"),
        ("G28\n", "G28\nG1 X999 F600\n", "999|bed"),
        ("G21\n", "G21\nM117 " + "x" * 120 + "\n", "96|long"),
    ],
)
def test_a_file_that_would_do_harm_is_not_sent(mat, capsys, old, new, message):
    text = mat.read_text()
    assert old in text
    mat.write_text(text.replace(old, new, 1))
    error = refused(capsys, mat, "--port", "virtual:marlin", "--quiet")
    assert any(word in error for word in message.split("|")), error


def test_requests_that_cannot_be_met(mat, files, capsys):
    assert "virtual:marlin" in refused(capsys, mat, "--quiet")
    assert "no print to go on with" in refused(
        capsys, mat, "--port", "virtual:marlin", "--resume", "--quiet"
    )
    assert "only a virtual machine" in refused(
        capsys, mat, "--port", "/dev/null", "--printed", "x.gcode", "--quiet"
    )
    assert main(["send", str(files / "mat.sml"), "--machine", "marlin-0.4"]) == 2
    assert "takes no sml" in capsys.readouterr().err


def test_a_file_that_changed_is_not_gone_on_with(mat, capsys):
    journal = mat.with_name("mat.gcode.journal")
    from fdjax.machine.journal import Job, Journal

    kept = Journal(journal, Job("mat.gcode", "0" * 64, "marlin-0.4", "virtual:marlin"))
    kept.reached(40, 1, 0.0)
    kept.close()
    assert send(mat, "--port", "virtual:marlin", "--resume", "--quiet") == 2
    assert "has changed since" in capsys.readouterr().err


def test_a_print_that_stops_exits_with_4_and_leaves_its_journal(mat, capsys, monkeypatch):
    run = VirtualMarlin._begin
    monkeypatch.setattr(
        VirtualMarlin,
        "_begin",
        lambda self, line: self._halt() or 0.0 if line.startswith("N60 ") else run(self, line),
    )
    assert send(mat, "--port", "virtual:marlin", "--quiet") == 4
    error = capsys.readouterr().err
    assert "mat.gcode, line" in error
    assert "halted" in error
    assert mat.with_name("mat.gcode.journal").exists()


def test_help_and_stream_load_neither_jax_nor_arrays():
    code = (
        "import sys, fdjax.app.cli, fdjax.app.sending, fdjax.machine.virtual\n"
        "assert not {'jax', 'numpy', 'shapely', 'matplotlib'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
