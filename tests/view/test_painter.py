"""Pictures drawn by a process of their own."""

import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import sys
from pathlib import Path
import numpy as np
from shapely import box
from fdjax.errors import InputError
from fdjax.view.painter import Painter

edges = np.arange(4.0)
asked = got = np.full((3, 3), 0.5)
try:
    with Painter() as painter:
        for name in sys.argv[1:]:
            picture = edges, edges, asked, got
            around = box(0, 0, 3, 3)
            painter.draw(Path(name), "porosity_figure", *picture, outline=around, title="plate")
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
