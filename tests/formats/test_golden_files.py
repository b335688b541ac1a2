"""Files as they were written once; FDJAX_REGENERATE_GOLDEN=1 writes them anew."""

import dataclasses
import os
from pathlib import Path

import pytest
from format_samples import small_build

from fdjax.formats import gcode, profile, sml, ssl

GOLDEN = Path(__file__).parent / "golden"
MARLIN = profile.load("marlin-0.4")
MARLIN_ABSOLUTE = dataclasses.replace(
    MARLIN,
    gcode=dataclasses.replace(
        MARLIN.gcode,
        tools=2,
        relative_e=False,
        retraction=dataclasses.replace(MARLIN.gcode.retraction, hop=0.2),
    ),
)
WRITTEN = {
    "relative.gcode": lambda: gcode.write(small_build(), MARLIN),
    "absolute_two_tools.gcode": lambda: gcode.write(small_build(2), MARLIN_ABSOLUTE),
    "fdm1650.sml": lambda: sml.write(small_build(2), profile.load("stratasys-fdm1650")),
    "outlines.ssl": lambda: ssl.write(small_build()),
}


def compare(name: str, text: str) -> None:
    golden = (GOLDEN / name).read_text().splitlines()
    for number, (found, expected) in enumerate(zip(text.splitlines(), golden, strict=False), 1):
        assert found == expected, f"{name} line {number}"
    assert len(text.splitlines()) == len(golden), name


@pytest.mark.parametrize("name", WRITTEN)
def test_files_are_as_before(name):
    text = WRITTEN[name]()
    if os.environ.get("FDJAX_REGENERATE_GOLDEN"):
        (GOLDEN / name).write_text(text)
    compare(name, text)


@pytest.mark.parametrize("name", WRITTEN)
def test_the_comparison_can_fail(name):
    text = (GOLDEN / name).read_text()
    place = text.rindex("0", 0, len(text) // 2)
    with pytest.raises(AssertionError, match=name):
        compare(name, text[:place] + "7" + text[place + 1 :])
    with pytest.raises(AssertionError, match=name):
        compare(name, "".join(text.splitlines(keepends=True)[:-1]))
