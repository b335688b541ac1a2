"""What slicers' comments say, and what is told from the roads where they say nothing."""

import math

import numpy as np
import pytest
from shapely import box

from fdjax.errors import InputError
from fdjax.formats import gcode
from fdjax.formats.footprint import outlined
from fdjax.formats.gcode_layers import Choice
from fdjax.formats.slicers import ROLES, Comments, settings_of
from fdjax.road.bead import section_area

AREA = math.pi / 4 * 1.75**2


def read(text, **options):
    return gcode.read(text, **{"filament": 1.75, **options})


def line(x, y, *, width=0.45, height=0.2, long=20.0):
    """A road along x, by its width and height."""
    push = section_area(width, height) * long / AREA
    return f"G1 X{x} Y{y}\nG1 X{x + long} E{push:.6f}\n"


def widths(build):
    return [float(road.width[0]) for layer in build.layers for road in layer.roads]


SUPPORTS = (
    "M83\n;LAYER_CHANGE\nG1 Z.2\n;HEIGHT:0.2\n" + line(10, 10)
    + ";LAYER_CHANGE\nG1 Z.35\n;HEIGHT:0.35\n" + line(10, 40, height=0.35)
    + ";LAYER_CHANGE\nG1 Z.4\n;HEIGHT:0.2\n" + line(10, 12)
)  # fmt: skip


def test_each_road_has_the_height_that_the_file_says():
    build = read(SUPPORTS)
    assert widths(build) == pytest.approx([0.45] * 3, abs=1e-5)
    assert [layer.height for layer in build.layers] == pytest.approx([0.2, 0.15, 0.05])
    assert build.reading["heights"] == "the file's word on each road"
    volume = 20 * (2 * section_area(0.45, 0.2) + section_area(0.45, 0.35))
    assert build.volume == pytest.approx(volume, rel=1e-5)


@pytest.mark.parametrize("told", [True, False])
def test_the_height_that_comes_with_a_layer_is_a_gap(told):
    """Where the road's own follows or is carried on, its width says which of them holds."""
    text = (
        "M83\n;LAYER_CHANGE\n;Z:.2\n;HEIGHT:0.2\nG1 Z.2\n;TYPE:Perimeter\n;WIDTH:0.45\n"
        + line(10, 10)
        + ";LAYER_CHANGE\n;Z:.25\n;HEIGHT:0.05\nG1 Z.25\n;TYPE:Support material\n;HEIGHT:0.25\n"
        + line(10, 40, height=0.25)
        + ";LAYER_CHANGE\n;Z:.4\n;HEIGHT:0.15\nG1 Z.4\n;TYPE:Perimeter\n"
        + ";HEIGHT:0.2\n" * told
        + line(10, 10, height=0.2 if told else 0.25)
    )
    build = read(text)
    assert widths(build) == pytest.approx([0.45] * 2, abs=1e-5)
    assert [layer.height for layer in build.layers] == pytest.approx([0.2, 0.2])
    assert build.reading["left out"].startswith("support")


@pytest.mark.parametrize(
    ("head", "wide", "said"),
    [
        (";Layer height: 0.2\n", 0.4429, "the file's setting of the layer height"),
        ("; layer_height = 0.2\n", 0.4429, "the file's setting of the layer height"),
        ("", 0.4429, "not told: roads taken to be twice as wide as high (0.2 mm)"),
        (
            ";Layer height: 0.2\n;Generated with Cura_SteamEngine 4.13.0\n",
            0.4,
            "the file's setting of the layer height",
        ),
    ],
)
def test_layers_stand_in_the_files_order(head, wide, said):
    push = f"E{0.4 * 0.2 * 20 / AREA:.6f}"
    text = (
        head
        + "M83\n"
        + "".join(
            f";LAYER:{n}\nG1 Z{z}\nG1 X10 Y{10 + n}\nG1 X30 {push}\n"
            for n, z in enumerate((1.15, 1.13))
        )
    )
    build = read(text)
    assert [layer.z for layer in build.layers] == [1.15, 1.13]
    assert widths(build) == pytest.approx([wide] * 2, abs=1e-3)
    assert [layer.height for layer in build.layers] == pytest.approx([0.2] * 2, abs=1e-3)
    assert build.reading["heights"] == said


@pytest.mark.parametrize(
    ("tops", "heights"),
    [
        ((0.2, 0.4, 0.6), (0.2, 0.2, 0.2)),
        ((0.35, 0.55, 0.75), (0.35, 0.2, 0.2)),
        ((0.1, 0.3, 0.5), (0.2, 0.2, 0.2)),  # as much filament: the bed lies lower
        ((3.1, 3.3, 3.5), (0.2, 0.2, 0.2)),  # on a board
        ((0.2, 0.5, 0.6), (0.2, 0.3, 0.1)),
    ],
)
def test_heights_from_differences_of_z(tops, heights):
    text = "M83\n" + "".join(f"G1 Z{z}\n" + line(10, 10) for z in tops)
    assert [layer.height for layer in read(text).layers] == pytest.approx(heights)


def test_a_thin_first_layer_is_told_by_its_filament():
    text = "M83\nG1 Z.1\n" + line(10, 10, height=0.1) + "G1 Z.3\n" + line(10, 10)
    build = read(text)
    assert [layer.height for layer in build.layers] == pytest.approx([0.1, 0.2])
    assert widths(build) == pytest.approx([0.45] * 2, abs=1e-5)


def test_supports_between_layers_are_no_layers():
    text = "M83\n" + "".join(
        f";LAYER_CHANGE\nG1 Z{z}\n;TYPE:{role}\n" + line(10, 10)
        for z, role in ((0.2, "Perimeter"), (0.3, "Support material"), (0.4, "Perimeter"))
    )
    assert [layer.height for layer in read(text).layers] == pytest.approx([0.2, 0.2])
    both = read(text, choice=Choice(roles=("all",)))
    assert len(both.layers) == 3
    support = read(text, choice=Choice(roles=("support",)))
    assert [road.role for layer in support.layers for road in layer.roads] == ["support"]


def test_objects_one_after_the_other_share_layers():
    text = "M83\n" + "".join(
        f"; printing object {name}\n" + "".join(f"G1 Z{z}\n" + line(x, 10) for z in (0.2, 0.4))
        for name, x in (("left", 10), ("right", 60))
    )
    build = read(text)
    assert [len(layer.roads) for layer in build.layers] == [2, 2]
    only = read(text, choice=Choice(things=("r*",)))
    assert [layer.roads[0].xy[0, 0] for layer in only.layers] == [60, 60]
    with pytest.raises(InputError, match="the file has left, right"):
        read(text, choice=Choice(things=("middle",)))


def spiral(mark):
    text = f"M83\n{mark}G1 Z.2\nG1 X10 Y10\n"
    for turn in range(3):
        text += mark if turn else ""
        for k, (x, y) in enumerate(((30, 10), (30, 30), (10, 30), (10, 10)), 1):
            text += f"G1 X{x} Y{y} Z{0.2 + 0.2 * turn + 0.05 * k:.3f} E0.6\n"
    return text


def test_vases_are_read_by_marks_or_pitch():
    marked = read(spiral(";LAYER_CHANGE\n"))
    assert [layer.z for layer in marked.layers] == pytest.approx([0.4, 0.6, 0.8])
    assert [layer.height for layer in marked.layers] == pytest.approx([0.4, 0.2, 0.2])
    pitch = read(spiral(""), layer_height=0.2)
    assert [layer.height for layer in pitch.layers] == [0.2] * 3
    assert pitch.volume == pytest.approx(12 * 0.6 * AREA)
    with pytest.raises(InputError, match="line 4: deposits while Z moves; the layer height tells"):
        read(spiral(""))


@pytest.mark.parametrize(
    ("comments", "role"),
    [
        (";TYPE:External perimeter", "outer perimeter"),
        (";TYPE:WALL-OUTER", "outer perimeter"),
        ("; FEATURE: Outer wall", "outer perimeter"),
        ("; feature outer perimeter", "outer perimeter"),
        ("; outer perimeter", "outer perimeter"),
        ("; 'Perimeter Path', 0.6 [feed mm/s], 25.0 [head mm/s]", "outer perimeter"),
        (";TYPE:Internal infill", "infill"),
        (";TYPE:FILL", "infill"),
        ("; FEATURE: Sparse infill", "infill"),
        ("; 'Sparse Infill Path'", "infill"),
        (";segType:Infill", "infill"),
        (";TYPE:Top solid infill", "skin"),
        (";TYPE:SKIN", "skin"),
        (";TYPE:Bridge infill", "bridge"),
        ("; FEATURE: Bottom surface", "solid"),
        (";TYPE:SUPPORT-INTERFACE", "support"),
        (";TYPE:Skirt/Brim", "skirt"),
        ("; FEATURE: Prime tower", "wipe tower"),
        (";TYPE:Custom", "custom"),
        ("; FEATURE: Gap infill", "perimeter"),
        (";TYPE:Odd thing", "Odd thing"),
    ],
)
def test_roles_by_the_names_of_slicers(comments, role):
    found = Comments()
    for number, comment in enumerate(comments.splitlines(), 1):
        found.feed(number, comment)
    assert found.stretches[-1].role == role
    assert role in ROLES or role == "Odd thing"


@pytest.mark.parametrize(
    "comment",
    [
        "; layer_height = 0.2",
        ";LAYER_COUNT:7",
        "; layers 3",
        ";AFTER_LAYER_CHANGE",
        "; type: of it",
    ],
)
def test_other_comments_are_no_layers_or_roles(comment):
    found = Comments()
    found.feed(1, comment)
    assert not found.layered
    assert found.stretches[-1].role in ("", "of it")


def test_roles_that_are_not_known_count_and_are_named():
    build = read("M83\nG1 Z.2\n;TYPE:Lattice\n" + line(10, 10))
    assert build.reading["unknown roles"] == "Lattice: counted as the part"
    assert build.layers[0].roads[0].role == "Lattice"


@pytest.mark.parametrize(
    ("text", "diameters"),
    [
        (b"; filament_diameter = 1.75,2.85\n", (1.75, 2.85)),
        (b"; filament_diameter = 3\n", (3.0,)),
        (b";   filamentDiameters,1.75|1.75|1.75\n", (1.75, 1.75, 1.75)),
        (b"; Filament Diameter #1: 2.85\n; Filament Diameter #2: 1.75\n", (2.85, 1.75)),
        (b"; fiber_dia_mm = 1.75\n", (1.75,)),
        (b"; filament_diameter of the tool\n", ()),
    ],
)
def test_diameters_in_comments(text, diameters):
    assert settings_of(text).diameters == diameters


@pytest.mark.parametrize(
    ("text", "firmware"),
    [
        (b"; gcode_flavor = marlin2\n", "marlin"),
        (b"; gcode_flavor = klipper\n", "klipper"),
        (b"; gcode_flavor = reprapfirmware\n", "rrf"),
        (b";FLAVOR:RepRap (RepRap)\n", "rrf"),
        (b";FLAVOR:Marlin\n", "marlin"),
        (b"; gcode_flavor = reprap\n", ""),
    ],
)
def test_firmware_in_comments_holds(text, firmware):
    assert settings_of(text).firmware == firmware
    body = "M83\nG90\nG1 Z.2\nG1 X10 E1\nG1 X20 E2\n"
    relative = firmware in ("klipper", "rrf")
    assert read(text.decode() + body).volume == pytest.approx((3 if relative else 2) * AREA)


@pytest.mark.parametrize("comment", ["; use_volumetric_e = 1\n", ";FLAVOR:UltiGCode\n"])
def test_volumetric_e_in_comments(comment):
    assert gcode.read(comment + "M83\nG1 Z.2\nG1 X10 E1\n").volume == pytest.approx(1)


def test_both_readings_of_e_are_said():
    apart = read("M83\nG90\nG1 Z.2\nG1 X10 E1\nG1 X20 E2\n").reading["firmware"]
    assert (
        apart
        == "G90 and E as in marlin: 4.8 mm^3; klipper would lay 7.2 mm^3, rrf would lay 7.2 mm^3"
    )
    assert "firmware" not in read("M83\nG90\nM83\nG1 Z.2\nG1 X10 E1\n").reading
    assert "firmware" not in read("M83\nG90\nG1 Z.2\nG1 X10 E1\n", firmware="klipper").reading


def test_what_is_passed_over_is_named():
    text = "START_PRINT BED=60\nM83\nG1 Z.2\nM1234 S5\nG1 X10 E1\nM106 S255\nSET_PIN PIN=a\n"
    assert read(text).reading["passed over"] == "START_PRINT (line 1), M1234 (line 4)"


def test_layers_and_roles_that_there_are_not():
    text = "M83\nG1 Z.2\n" + line(10, 10)
    with pytest.raises(InputError, match="layers: 3:4; the part has 1"):
        read(text, choice=Choice(layers=(3, 4)))
    with pytest.raises(InputError, match="role: 'infil'; one of perimeter, outer perimeter"):
        Choice(roles=("infil",))
    with pytest.raises(InputError, match="layers: 4:2"):
        Choice(layers=(4, 2))
    with pytest.raises(InputError, match=r"nothing is left of the part: outside the outline"):
        read(text, outline=box(100, 100, 120, 120))


def ring(x0, y0, x1, y1, role=""):
    text = f";TYPE:{role}\n" * bool(role) + f"G1 X{x0} Y{y0}\n"
    last = (x0, y0)
    for x, y in ((x1, y0), (x1, y1), (x0, y1), (x0, y0 + 0.1)):
        push = section_area(0.4, 0.2) * math.dist(last, (x, y)) / AREA
        text += f"G1 X{x} Y{y} E{push:.6f}\n"
        last = (x, y)
    return text


def test_outlines_are_those_of_the_outermost_perimeters():
    text = "M83\nG1 Z.2\n" + ring(10, 10, 30, 30, "WALL-OUTER") + ring(11, 11, 29, 29, "WALL-INNER")
    text += ring(15, 15, 20, 20, "WALL-OUTER") + ring(40, 10, 50, 20, "WALL-OUTER")
    build, said = outlined(read(text))
    assert said == "the outermost perimeters"
    wanted = (20.4**2 - 4.6**2) + 10.4**2
    assert build.layers[0].outline.area == pytest.approx(wanted, rel=1e-3)
    assert len(build.layers[0].outline.geoms) == 2


def test_a_perimeter_of_several_pieces_is_one():
    text = "M83\nG1 Z.2\n" + ring(10, 10, 30, 30, "External perimeter").replace(
        "G1 X30 Y30", ";TYPE:Overhang perimeter\nG1 X30 Y30"
    )
    build, _ = outlined(read(text))
    assert build.layers[0].outline.area == pytest.approx(20.4**2, rel=1e-3)


@pytest.mark.parametrize("pitch", [0.4, 2.0, 4.0])
def test_a_footprint_closes_the_gaps_between_roads(pitch):
    count = round(20 / pitch)
    text = "M83\nG1 Z.2\n"
    text += "".join(line(40, 40 + pitch * (k + 0.5), long=20) for k in range(count))
    text += "G1 Z.4\n"
    for k in range(count):
        at = 40 + pitch * (k + 0.5)
        text += f"G1 X{at} Y40\nG1 Y60 E{section_area(0.45, 0.2) * 20 / AREA:.6f}\n"
    build, said = outlined(read(text))
    assert said.startswith("the roads' footprint")
    assert build.layers[0].outline.area == pytest.approx(20.4**2, rel=0.04)
    assert len(build.layers[0].outline.interiors) == 0


def test_flat_roads_are_as_roads_are():
    build = read(SUPPORTS)
    for layer in build.layers:
        roads = tuple(layer.roads)
        again = type(layer)(layer.z, layer.height, roads)
        assert again.volume == pytest.approx(layer.volume)
        assert again.travel == pytest.approx(layer.travel)
        assert len(layer.roads[0:1]) == 1
        np.testing.assert_array_equal(layer.roads[-1].xy, roads[-1].xy)


def test_slic3r_tells_roles_behind_its_lines():
    text = "; generated by Slic3r 1.3.0 on 2026-11-01\nM83\nG1 Z.3 ; move to next layer (0)\n"
    text += "G1 X10 Y10 ; move to first skirt point\nG1 X30 E1 ; skirt\n"
    text += "G1 X10 Y12 ; move to first perimeter point\nG1 X30 E1 ; perimeter\n"
    text += "G1 X10 Y14 ; move to first infill point\nG1 X30 E1 ; infill\nG1 E-1 ; retract\n"
    build = read(text)
    assert [road.role for road in build.layers[0].roads] == ["perimeter", "infill"]
    assert build.reading["left out"] == "skirt 2.4 mm^3"
    other = read(text.replace("Slic3r", "Others"))
    assert len(other.layers[0].roads) == 3
