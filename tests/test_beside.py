"""Work done by a second process: pictures, and half of a plan's layers."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

from fdjax.beside import Beside
from fdjax.errors import InputError
from fdjax.part.part import Part
from fdjax.plan.trace import lay
from fdjax.road.stroke import Lines

CODE = """
import sys
from pathlib import Path
import numpy as np
from shapely import box
from fdjax.beside import Beside
from fdjax.errors import InputError
from fdjax.view import DRAW

edges = np.arange(4.0)
asked = got = np.full((3, 3), 0.5)
try:
    with Beside("fdjax.view.figures") as beside:
        for name in sys.argv[1:]:
            picture = edges, edges, asked, got
            around = box(0, 0, 3, 3)
            beside.ask(DRAW, Path(name), "porosity_figure", *picture, outline=around, title="plate")
        {fault}
except InputError as fault:
    sys.exit(str(fault))
assert "matplotlib" not in sys.modules
"""


def run(*names: str | Path, fault: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", CODE.format(fault=fault), *map(str, names)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_pictures_are_there_when_the_block_is_left(tmp_path: Path) -> None:
    first, second = tmp_path / "first.png", tmp_path / "second.png"
    done = run(first, second)
    assert (done.returncode, done.stderr) == (0, "")
    assert first.read_bytes() == second.read_bytes() > b"\x89PNG"


@pytest.mark.parametrize(
    ("name", "said"),
    [("a.bmp", "a picture is written as .png, .pdf or .svg"), ("no/a.png", "cannot be written")],
)
def test_the_first_fault_is_told_and_the_rest_drawn(tmp_path: Path, name: str, said: str) -> None:
    good = tmp_path / "good.png"
    done = run(tmp_path / name, tmp_path / "b.bmp", good)
    assert done.returncode == 1
    assert f"{tmp_path / name}: {said}" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert good.exists()


def test_a_block_that_fails_leaves_no_process_and_its_own_error(tmp_path: Path) -> None:
    done = run(tmp_path / "a.png", fault='raise InputError("as it was")')
    assert (done.returncode, done.stderr) == (1, "as it was\n")


@pytest.fixture
def second(monkeypatch):
    """A second process, as a command has one."""
    monkeypatch.delitem(sys.modules, "matplotlib.figure", raising=False)
    with Beside("fdjax.plan.trace") as beside:
        assert beside.shares
        yield beside


def test_values_come_to_who_asked_whatever_the_order(second):
    waits = [second.ask("math:hypot", 3.0, each) for each in (4.0, 0.0, -4.0)]
    assert [wait() for wait in reversed(waits)] == [5.0, 3.0, 5.0]


def test_a_fault_is_told_to_who_waits_and_to_nobody_else(second):
    wait = second.ask("fdjax.units:length", "3 parsecs", "window")
    with pytest.raises(InputError, match="window"):
        wait()
    assert second.ask("math:sqrt", 4.0)() == 2.0


def test_a_process_that_ends_is_an_error_and_no_hang(monkeypatch):
    monkeypatch.delitem(sys.modules, "matplotlib.figure", raising=False)
    with pytest.raises(RuntimeError, match="ended with"), Beside() as beside:
        beside.ask("os:_exit", 3)()


def test_layers_laid_by_two_are_those_laid_by_one(second):
    def lines(shift):
        xy = [np.array([[-1.0, y + shift], [41.0, y + shift]]) for y in np.arange(1.0, 29.0, 1.5)]
        return [Lines("eta", 0, np.arange(len(xy)), xy, [np.full(1, 0.4)] * len(xy))]

    holed = shapely.box(0, 0, 40, 30).difference(shapely.Point(20, 15).buffer(5))
    part = Part.stack([shapely.box(0, 0, 40, 30)] * 3 + [holed] * 2, 0.2)
    layers = [lines(0.1 * number) for number in range(5)]
    alone = lay(layers, part, lift_length=4.0)
    shared = lay(layers, part, lift_length=4.0, beside=second)
    for one, other in zip(alone.layers, shared.layers, strict=True):
        assert one.volume == other.volume
        for first, again in zip(one.roads, other.roads, strict=True):
            assert np.array_equal(first.path, again.path)
