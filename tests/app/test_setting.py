"""Jobs that cannot be, named by what the user wrote before long computing."""

from unittest import mock

import pytest

from fdjax.app import config, planning, setting
from fdjax.app.cli import main

JOB = """{head}
[part]
{part}
layers = 4
[target]
{target}
[pattern]
{pattern}
"""
STRIP = 'shape = "rectangle"\nsize = [60, 6]'
CURVES = """shape = "curves"
bottom = {bottom}
right = {right}
top = {{ polyline = [[0, 40], [60, 40]] }}
left = {{ polyline = [[0, 0], [0, 40]] }}"""
LINE, SIDE = "{ polyline = [[0, 0], [60, 0]] }", "{ polyline = [[60, 0], [60, 40]] }"


def refused(tmp_path, capsys, **tables):
    job = tmp_path / "job.toml"
    job.write_text(JOB.format(**{"head": "", "target": 'solid = "0.2"', "pattern": "", **tables}))
    with mock.patch.object(planning, "solve", side_effect=AssertionError("computing has begun")):
        assert main(["design", str(job), "--out", str(tmp_path / "out"), "--quiet"]) == 2
    assert not (tmp_path / "out").exists()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


@pytest.mark.parametrize(
    ("solid", "pattern", "enough"),
    [
        ("0.03", 'road_width = "0.45mm"', "can give 0.068"),
        ("0.02 + 0.0004*x", 'map = "transfinite"\nroad_width = "0.45mm"', "can give 0.068"),
        ("0.05", 'mode = "both"\nroad_width = "0.4mm"', "can give 0.12"),
    ],
)
def test_less_than_one_line_a_layer(tmp_path, capsys, solid, pattern, enough):
    said = refused(tmp_path, capsys, part=STRIP, target=f'solid = "{solid}"', pattern=pattern)
    assert "the part is 6 mm wide: less than one line" in said
    assert enough in said
    assert "pattern.road_width" in said


@pytest.mark.parametrize(
    "solid",
    ["0.003 + 0.4*exp(-((x-21)**2 + (y-3)**2)/0.5)", "0.001 + 0.2*z"],
    ids=["spot", "rising"],
)
def test_a_target_with_lines_somewhere_is_let_through(tmp_path, solid):
    path = tmp_path / "job.toml"
    path.write_text(JOB.format(head="", part=STRIP, target=f'solid = "{solid}"', pattern=""))
    job = config.load(path)
    part = setting.part_of(job.part)
    target = setting.target_of(job.target, part)
    setting.check_lines(job, part, target, setting.machine_of(job, "ssl"))


FINE = 'road_width = "0.32mm"'
"""As the G-code's machine lays it; the one of the SML lays 0.3556 mm or more."""


def test_a_file_that_is_asked_for_and_cannot_be_laid_is_refused_before_the_design(tmp_path, capsys):
    files = 'files = ["sml"]\n'
    said = refused(tmp_path, capsys, part=STRIP, pattern=FINE, head=files)
    assert "job.sml: road_width: 0.32 mm; stratasys-fdm1650 lays 0.3556" in said
    assert "leave it out of files" in said


def test_a_file_that_nobody_named_and_cannot_be_laid_is_left_out_and_told_of(tmp_path):
    path = tmp_path / "job.toml"
    path.write_text(JOB.format(head="", part=STRIP, target='solid = "0.2"', pattern=FINE))
    job = config.load(path)
    machines, left_out = setting.machines_of(job, setting.part_of(job.part))
    assert list(machines) == ["gcode", "ssl"]
    assert left_out == [
        "job.sml: not written: road_width: 0.32 mm; stratasys-fdm1650 lays 0.3556 to 1.016 mm"
    ]


@pytest.mark.parametrize(
    ("sides", "words"),
    [
        ({"bottom": "{ arc = [[0, 0], [30, 0], [60, 0]] }"}, "part.bottom: arc: (0, 0), (30, 0)"),
        (
            {"bottom": "{ arc = [[5, 4], [1, 0], [5, 4]] }"},
            "part.bottom: arc: ends where it starts",
        ),
        ({"right": "{ arc = [[60, 0], [60, 0], [60, 40]] }"}, "part.right: arc:"),
        ({"right": "{ polyline = [[60, 0], [60, 0]] }"}, "part.right: polyline: points 0 and 1"),
    ],
)
def test_sides_that_are_none_are_named(tmp_path, capsys, sides, words):
    part = CURVES.format(**{"bottom": LINE, "right": SIDE, **sides})
    assert words in refused(tmp_path, capsys, part=part)
