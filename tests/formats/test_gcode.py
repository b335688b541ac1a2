import dataclasses
import math
import re

import numpy as np
import pytest
from format_samples import builds, pairs, small_build
from hypothesis import given, settings

from fdjax.errors import InputError
from fdjax.formats import gcode, profile
from fdjax.plan.toolpath import Build, Layer, Road

MARLIN = profile.load("marlin-0.4")


def machine(**changes):
    return dataclasses.replace(MARLIN, gcode=dataclasses.replace(MARLIN.gcode, **changes))


RELATIVE = machine(tools=2)
ABSOLUTE = machine(
    tools=2,
    relative_e=False,
    extrusion=dataclasses.replace(MARLIN.gcode.extrusion, filament=2.85, flow=0.95),
    retraction=dataclasses.replace(MARLIN.gcode.retraction, hop=0.3),
)
MACHINES = pytest.mark.parametrize("made_for", [RELATIVE, ABSOLUTE], ids=["M83", "M82"])


def after_priming(text: str) -> list[str]:
    return text.split("\n; fdjax prime end\n")[1].splitlines()


def filament_of(text: str) -> float:
    """Filament that roads take, mm: the positive steps of E on moves in XY, summed naively."""
    relative, before, total = True, 0.0, 0.0
    for line in after_priming(text):
        relative = {"M83": True, "M82": False}.get(line, relative)
        if line == "G92 E0":
            before = 0.0
        word = re.search(r" E(-?[\d.]+)", line)
        if word and not line.startswith("G92"):
            e = float(word[1])
            if "X" in line:
                total += e if relative else e - before
            before = e
    return total


@MACHINES
@settings(max_examples=40, deadline=None)
@given(build=builds())
def test_what_is_written_is_read_back(made_for, build):
    fitted = gcode.fit(build, made_for)
    if not any(layer.roads for layer in fitted.layers):
        return
    text = gcode.write(build, made_for)
    assert text == gcode.write(fitted, made_for)
    again = gcode.read(text)
    area = math.pi / 4 * made_for.gcode.extrusion.filament**2 / made_for.gcode.extrusion.flow
    for planned, found, height in pairs(fitted, again):
        difference = planned.segment_volumes(height) - found.segment_volumes(height)
        assert np.abs(difference).max() < 1.01e-5 * area
    assert again.volume == pytest.approx(filament_of(text) * area, rel=1e-9)
    assert abs(again.volume - fitted.volume) < 2 * 0.51e-5 * area  # two tools


@settings(max_examples=20, deadline=None)
@given(build=builds())
def test_points_are_rounded_on_the_bed(build):
    fitted = gcode.fit(build, RELATIVE)
    for layer in fitted.layers:
        for road in layer.roads:
            on_bed = road.xy + np.asarray(build.origin)
            assert np.abs(on_bed * 1000 - np.rint(on_bed * 1000)).max() < 1e-6
            assert road.segment_lengths.min() > 0.0005
    assert pairs(fitted, gcode.fit(fitted, RELATIVE)) is not None


def test_nothing_drifts_over_many_short_segments():
    angle = np.linspace(0, 200 * np.pi, 20_001)
    xy = 100 + np.outer(angle / 10, [1, 1]) * np.stack([np.cos(angle), np.sin(angle)], 1)
    build = Build((Layer(0.2, 0.2, (Road(xy, 0.4),)),))
    for made_for in (RELATIVE, ABSOLUTE):
        fitted = gcode.fit(build, made_for)
        again = gcode.read(gcode.write(fitted, made_for))
        assert again.volume == pytest.approx(fitted.volume, rel=1e-7)
        np.testing.assert_array_equal(again.layers[0].roads[0].xy, fitted.layers[0].roads[0].xy)


def test_volume_is_the_filaments():
    build = Build((Layer(0.2, 0.2, (Road([(0, 0), (100, 0)], 0.4),)),))
    volume = (0.2 * 0.2 + math.pi * 0.01) * 100
    assert filament_of(gcode.write(build, MARLIN)) * math.pi / 4 * 1.75**2 == pytest.approx(
        volume, rel=1e-6
    )


def test_no_travel_where_roads_touch():
    touching = [Road([(0, 0), (10, 0)], 0.4), Road([(10, 0), (10, 10)], 0.4)]
    build = Build((Layer(0.2, 0.2, tuple(touching)),))
    lines = after_priming(gcode.write(build, MARLIN))
    assert sum(line.startswith("G0 X") for line in lines) == 2  # to the part, and parking
    assert len(gcode.read("\n".join(gcode.write(build, MARLIN).splitlines())).layers[0].roads) == 2


def test_retraction_surrounds_long_travel_only():
    roads = [Road([(0, y), (10, y)], 0.4) for y in (0, 20)]
    near = [*roads, Road([(10, 21), (0, 21)], 0.4)]
    lines = after_priming(gcode.write(Build((Layer(0.2, 0.2, tuple(near)),)), MARLIN))
    travels = [k for k, line in enumerate(lines) if line.startswith("G0 X")][:-1]
    assert [lines[k - 1].startswith("G1 E-0.8") for k in travels[1:]] == [True, False]
    assert [lines[k + 1].startswith("G1 E0.8") for k in travels[1:]] == [True, False]


def test_everything_is_turned_off_at_the_end():
    end = gcode.write(small_build(), MARLIN).splitlines()[-12:]
    assert {"M104 S0", "M140 S0", "M107", "M84"} <= set(end)
    assert end[-1] == "; fdjax end"


def test_lines_are_short_ascii():
    text = gcode.write(small_build(), MARLIN)
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 90


def test_options_replace_what_the_file_says():
    build = Build((Layer(0.2, 0.2, (Road([(0, 0), (100, 0)], 0.4),)),))
    text = gcode.write(build, MARLIN)
    assert gcode.read(text, filament=3.5).volume == pytest.approx(4 * gcode.read(text).volume)
    lower = gcode.read(text, layer_height=0.1)
    assert lower.layers[0].height == 0.1
    assert lower.volume == pytest.approx(gcode.read(text).volume)
    outline = small_build().layers[0].outline
    assert gcode.read(text, outline=outline).layers[0].outline is outline


@pytest.mark.parametrize(
    ("road", "made_for", "message"),
    [
        (Road([(0, 0), (1, 0)], 0.0), MARLIN, "layer 1: .* width of 0"),
        (Road([(0, 0), (1, 0)], 0.4, material=1), MARLIN, "layer 1: material 1, but .* 1 tool,"),
        (Road([(0, 0), (1, 0)], 0.4, family="x y"), MARLIN, "family 'x y'"),
        (Road([(0, 0), (1, 0)], 0.4), profile.load("stratasys-fdm1650"), "writes no G-code"),
    ],
)
def test_what_cannot_be_written(road, made_for, message):
    with pytest.raises(InputError, match=message):
        gcode.write(Build((Layer(0.2, 0.2, (road,)),)), made_for)


def test_a_truncated_file_is_refused_wherever_it_is_cut():
    text = gcode.write(small_build(), MARLIN)
    rng = np.random.default_rng(1)
    first = text.index("fdjax name")
    for cut in rng.integers(first, len(text) - len("; fdjax end\n"), 40):
        with pytest.raises(InputError):
            gcode.read(text[:cut])
    with pytest.raises(InputError, match=r"line \d+: the file is truncated"):
        gcode.read(text[: text.index("M84")])


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda t: t.replace("G1 X70.000", "G1 X70.0.0", 1), r"line \d+: '.0 Y.*' is no letter"),
        (lambda t: t.replace("G1 X70.000", "G1 X", 1), r"line \d+: 'X Y.*' is no letter"),
        (lambda t: t.replace("z=0.254", "z=abc", 1), r"line \d+: .*z= and a positive"),
        (lambda t: t.replace("material=1", "material=b", 1), r"line \d+: material 'b'"),
        (lambda t: t.replace("version = 1", "version = 7", 1), "version '7' is not known"),
        (lambda t: t.replace("filament = 1.75", "filament = 0", 1), "filament: 0 is not"),
    ],
)
def test_damage_is_named_with_its_line(damage, message):
    text = gcode.write(small_build(materials=2), RELATIVE)
    assert damage(text) != text
    with pytest.raises(InputError, match=message):
        gcode.read(damage(text))


def said(text, key):
    (value,) = re.findall(rf"^; {key} = (.*)$", text, re.MULTILINE)
    return value


def test_hosts_are_told_time_filament_and_layers():
    text = gcode.write(small_build(), MARLIN)
    assert re.search(r"; generated by fdjax [\d.]+ on \d{4}-\d\d-\d\d at \d\d:\d\d:\d\d\n", text)
    assert float(said(text, r"filament used \[mm\]")) == pytest.approx(
        filament_of(text) + 8.5,
        abs=0.01,  # and priming
    )
    assert said(text, "total layers count") == "2"
    assert (said(text, "layer_height"), said(text, "first_layer_height")) == ("0.254", "0.254")
    assert re.fullmatch(r"\d+h \d+m \d+s", said(text, r"estimated printing time \(normal mode\)"))


@pytest.mark.parametrize("relative", [True, False])
def test_hosts_take_z_for_layers_and_the_mode_of_e_behind_g90(relative):
    machine = dataclasses.replace(
        MARLIN, gcode=dataclasses.replace(MARLIN.gcode, relative_e=relative)
    )
    text = gcode.write(small_build(), machine)
    body = text[text.index("fdjax prime begin") : text.index("; filament used")]
    assert "G0 Z" not in body
    heights = {float(z) for z in re.findall(r"^G1 Z([\d.]+) F", text, re.MULTILINE)}
    assert heights == {0.254, 0.508}  # the priming line too
    modes = [line for line in text.splitlines() if line in ("G90", "M82", "M83")]
    assert modes[-2:] == ["G90", "M83"]
    assert modes[modes.index("G90") :][:3] == ["G90", "G90", "M83"]  # start code, and behind it


def test_the_same_build_gives_the_same_file():
    assert gcode.write(small_build(), MARLIN) == gcode.write(small_build(), MARLIN)


def test_start_code_that_cannot_be_followed_can_be_written():
    tables = dataclasses.replace(MARLIN.gcode, start=("START_PRINT BED=60", "G5 X1 E1", "G2 X5 R0"))
    text = gcode.write(small_build(), dataclasses.replace(MARLIN, gcode=tables))
    assert said(text, "total layers count") == "2"
