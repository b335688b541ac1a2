"""The script that draws the catalogue: a picture, and a page with errors."""

import re
import runpy
from pathlib import Path

from PIL import Image

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_catalogue_is_drawn_and_measured(tmp_path):
    script = runpy.run_path(str(EXAMPLES / "catalogue.py"))
    script["main"](["--out", str(tmp_path), "--only", "rasters", "contours"])
    page = (tmp_path / "catalogue.md").read_text()
    rows = re.findall(
        r"^\| (\w+) \| `kind = .*` \| ([\d.]+) \| ([\d.]+) \| (\S+) % \|$", page, re.M
    )
    assert [row[0] for row in rows] == ["rasters", "contours"]
    assert all(float(row[1]) < 0.1 and float(row[3]) < 0.5 for row in rows)
    with Image.open(tmp_path / "catalogue.png") as picture:
        assert min(picture.size) > 300


def test_the_page_holds_every_pattern():
    names = runpy.run_path(str(EXAMPLES / "catalogue.py"))["PATTERNS"]
    page = (EXAMPLES / "catalogue.md").read_text()
    assert [row.split(" | ")[0][2:] for row in page.splitlines() if "`kind = " in row] == list(
        names
    )


def test_its_picture_is_small():
    assert (EXAMPLES / "catalogue.png").stat().st_size < 800_000
