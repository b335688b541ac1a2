"""Job files: what is read, and one clear line for everything that is wrong."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from fdjax.app import config
from fdjax.app.config import Job
from fdjax.app.part import Circle, Part, Ring, Side
from fdjax.errors import InputError
from fdjax.pattern import PATTERNS, settings_of

PLATE = """
name = "graded_plate"
machine = "marlin-0.4"
[part]
shape = "rectangle"
size = ["80mm", "80mm"]
layers = 10
layer_height = "0.2mm"
[target]
solid = "0.1 + 0.4*x/80"
tolerance = 0.02
[pattern]
map = "transfinite"
road_width = "0.014in"
lines = [110, 35]
[design]
controls = ["spacing", "width"]
"""


def write(folder: Path, text: str, name: str = "job.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def fault(folder: Path, text: str) -> str:
    with pytest.raises(InputError) as caught:
        config.load(write(folder, text))
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_job_becomes_frozen_data_in_mm(tmp_path):
    job = config.load(write(tmp_path, PLATE))
    assert job.name == "graded_plate"
    assert job.part.size == (80.0, 80.0)
    assert job.target.solid == "0.1 + 0.4*x/80"
    assert job.pattern.road_width == pytest.approx(0.3556)
    assert job.pattern.lines == (110, 35)
    assert job.pattern.mode == "alternate-staggered"
    assert job.outputs[0] == "graded_plate.gcode"
    with pytest.raises(dataclasses.FrozenInstanceError):
        job.name = "other"  # type: ignore[misc]


def test_the_file_names_the_part_where_the_job_does_not(tmp_path):
    text = '[part]\nshape = "cosine_top"\n[target]\nporosity = 0.65\n'
    assert config.load(write(tmp_path, text, "my plate.toml")).name == "my_plate"
    job = config.load(write(tmp_path, "\ufeff" + text.replace("\n", "\r\n")))
    assert (job.name, job.target.porosity) == ("job", "0.65")


def test_shapes_holes_and_units():
    corners = [[0, 0], [2, 0], ["50.8mm", 1], [0, 1]]
    target = {"porosity": "0.5"}
    part = {
        "shape": "polygon",
        "points": corners,
        "unit": "in",
        "holes": [{"circle": [1, 0.5], "radius": "2mm"}, {"points": corners[:3]}],
    }
    read = config.parse({"part": part, "target": target}).part
    np.testing.assert_allclose(read.points, [[0, 0], [50.8, 0], [50.8, 25.4], [0, 25.4]])
    circle, ring = read.holes
    assert isinstance(circle, Circle)
    assert isinstance(ring, Ring)
    np.testing.assert_allclose([*circle.centre, circle.radius], [25.4, 12.7, 2.0])
    np.testing.assert_allclose(ring.points, read.points[:3])

    part = {
        "shape": "curves",
        "bottom": {"polyline": [[0, 0], [4, 0]]},
        "right": {"arc": [[4, 0], [5, 1], [4, 2]]},
        "top": {"spline": [[0, 2], [2, 3], [4, 2]]},
        "left": {"polyline": [[0, 0], [0, 2]]},
    }
    read = config.parse({"part": part, "target": target}).part
    assert read.right == Side("arc", ((4.0, 0.0), (5.0, 1.0), (4.0, 2.0)))


def test_paths_start_at_the_job(tmp_path, monkeypatch):
    folder = tmp_path / "jobs"
    folder.mkdir()
    np.save(folder / "f.npy", np.zeros((2, 2)))
    write(folder, "", "mine.toml")
    text = PLATE.replace('solid = "0.1 + 0.4*x/80"', 'array = "f.npy"\nquantity = "solid"')
    job = write(folder, text.replace("marlin-0.4", "mine.toml"))
    monkeypatch.chdir(tmp_path)
    read = config.load(os.path.relpath(job))
    assert read.target.array is not None
    assert read.target.array.samefile(folder / "f.npy")
    assert Path(read.machine).samefile(folder / "mine.toml")


def test_phi_of_the_paper_and_of_the_unit_square():
    table = {
        "part": {"shape": "cosine_top"},
        "target": {"porosity": 0.5},
        "pattern": {"map": "elliptic", "nodes": [51, 31], "phi_index": 0.03, "psi": 0.9},
    }
    assert config.parse(table).pattern.phi_psi == pytest.approx((1.5, 0.9))


def test_lines_of_a_map_may_be_laid_as_they_are(tmp_path):
    job = config.load(write(tmp_path, PLATE.replace('["spacing", "width"]', "[]")))
    assert job.pattern.controls == ()
    text = fault(tmp_path, PLATE.split("[pattern]")[0] + "[design]\ncontrols = []\n")
    assert "controls: is empty; give some of coefficients" in text


def test_a_key_of_a_pattern_that_stands_in_another_table_is_named_there(tmp_path):
    both = '[design]\ncontrols = ["width"]\n[pattern]\nangle = 20\n'
    text = fault(tmp_path, PLATE.split("[pattern]")[0] + both)
    assert '[design]: controls: one of "coefficients", "p", "q" is needed' in text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        # keys and tables
        ("machine =", "machin =", ': unknown key "machin" (did you mean "machine"?)'),
        ("[pattern]", "[patern]", ': unknown key "patern" (did you mean "pattern"?)'),
        ("size =", "siez =", ': [part]: unknown key "siez" (did you mean "size"?)'),
        ("map =", "window = 1\nmap =", '[pattern]: unknown key "window" (it belongs in [target])'),
        ("[target]", "[design.x]\n[ttarget]", 'unknown key "ttarget" (did you mean "target"?)'),
        ("size =", "# size =", "[part]: size is missing"),
        ('shape = "rectangle"', "", "[part]: shape is missing"),
        ("[part]", "part = 1\n[target.part]", ": [part]: must be a table of keys"),
        # lengths and numbers
        ('"0.2mm"', '"0.2mn"', '[part] layer_height: unknown unit "mn"'),
        ('"0.2mm"', "-0.2", "[part] layer_height: -0.2 must be more than 0"),
        ('"0.2mm"', "nan", "[part] layer_height: nan is not finite"),
        ('"0.2mm"', "true", "[part] layer_height: True is no length"),
        ('"0.2mm"', "1" + "0" * 400, "is not finite"),
        ('["80mm", "80mm"]', '"80mm"', '[part] size: "80mm" must be a list in [ ]'),
        ('["80mm", "80mm"]', "[80]", "[part] size: has 1 values; 2 are needed"),
        ('["80mm", "80mm"]', "[80, 0]", "[part] size[1]: 0 must be more than 0"),
        ("layers = 10", "layers = 0", "[part] layers: 0 is out of range; 1 to 10000 is possible"),
        ("layers = 10", "layers = 1.5", "[part] layers: 1.5 is no whole number"),
        ("layers = 10", "layers = true", "[part] layers: true is no whole number"),
        ("tolerance = 0.02", "tolerance = 2", "[target] tolerance: 2 is out of range; 0 to 1"),
        ("tolerance = 0.02", "tolerance = inf", "[target] tolerance: inf is not finite"),
        ("tolerance = 0.02", 'tolerance = "2%"', '[target] tolerance: "2%" is no number'),
        ("[110, 35]", "[110, 3.5]", "[pattern] lines[1]: 3.5 is no whole number"),
        # words
        ('"transfinite"', '"transfinit"', 'map: "transfinit" is not one of uniform, '),
        ('"transfinite"', '"transfinit"', '(did you mean "transfinite"?)'),
        ('"transfinite"', "3", "[pattern] map: 3 is not one of uniform, "),
        ('["spacing", "width"]', '["spacing", "wide"]', 'controls: "wide" is not one of'),
        ('["spacing", "width"]', '["width", "width"]', 'controls: "width" is given twice'),
        ('"graded_plate"', '"../plate"', 'name: "../plate" cannot name files'),
        ('"graded_plate"', '""', 'name: "" cannot name files'),
        ('"graded_plate"', "2020-01-01", "name: 2020-01-01 cannot name files"),
        ('"marlin-0.4"', '"mine.toml"', "mine.toml: no such file"),
        ('machine = "marlin-0.4"', 'files = ["stl"]', 'files: "stl" is not one of gcode, sml, ssl'),
        ("[design]", "[design]\nspan_limit = 1", "[design] span_limit: 1 must be true or false"),
        # the target
        ("0.4*x/80", "0.4*w/80", '[target] solid: expression "0.1 + 0.4*w/80": unknown name "w"'),
        ("0.4*x/80", "open(x)", 'unknown function "open" at column 7'),
        ('"0.1 + 0.4*x/80"', "false", '[target] solid: expression "false": unknown name'),
        ("tolerance", 'porosity = "0.5"\ntolerance', "needs exactly one of porosity, solid, image"),
        ("solid =", "# solid =", "[target]: a target needs exactly one of"),
        ("solid =", 'image = "no.png"\n# solid =', "no.png: no such file"),
        ("tolerance", "low = 0.1\ntolerance", "[target]: low is for an image or array"),
        ("tolerance", 'unit = "furlong"\ntolerance', '[target] unit: unknown unit "furlong"'),
        # keys that do not go together
        ("layers", 'wkt = "POLYGON EMPTY"\nlayers', 'wkt is for shape "polygon", and shape is'),
        ("layers", "smooth = true\nlayers", 'smooth is for shape "polygon"'),
        ('"rectangle"', '"polygon"', 'size is for shape "rectangle", and shape is "polygon"'),
        ('"rectangle"\nsize = ["80mm", "80mm"]', '"polygon"', "one of file, wkt, points"),
        ('"rectangle"\nsize = ["80mm", "80mm"]', '"curves"', "[part]: bottom is missing"),
        ("map =", "phi = 1\nphi_index = 0.1\nmap =", "[pattern]: give phi or phi_index, not both"),
        ("map =", "beta = [1, 2]\nmap =", "[pattern]: beta: both must be more than 1"),
        ("map =", "alpha = [0.3, 0]\nmap =", "[pattern]: alpha: each must be 0 or 0.5"),
        # places
        ("layers", "holes = [{circle = [1, 2]}]\nlayers", "holes[0]: {circle = [1, 2]} is no hole"),
        ("layers", "holes = [{circle = [1], radius = 2}]\nlayers", "circle: has 1 coordinates"),
        ("layers", "holes = [{circle = [1, 2], radius = -2}]\nlayers", "radius -2 must be more"),
        ("layers", "holes = [{points = [[1, 2]]}]\nlayers", "[0].points: has 1 points; 3 or more"),
        ("layers", "holes = 3\nlayers", "[part] holes: 3 must be a list"),
        ("layers", "corners = [[0, 0]]\nlayers", "[part] corners: has 1 points; 4 are needed"),
        ("layers", "bottom = {line = []}\nlayers", "[part] bottom: {line = []} is no side"),
        ("layers", "points = [[0, 0], [1, true], [1, 1]]\nlayers", "points[1]: true is no number"),
        ("layers", "points = [[0, 0], [1, nan], [1, 1]]\nlayers", "points[1]: nan is not finite"),
        # TOML itself
        ("[part]", "[part", "job.toml: is not TOML: Expected ']'"),
        ("layers = 10", "layers = 10\nlayers = 11", "is not TOML: Cannot overwrite a value"),
        ("layers = 10", "layers = " + "9" * 5000, "is not TOML"),
        ("layers = 10", "holes = " + "[" * 5000, "is not TOML"),
    ],
)  # fmt: skip
def test_every_fault_is_one_clear_line(tmp_path, old, new, words):
    assert old in PLATE
    message = fault(tmp_path, PLATE.replace(old, new, 1))
    assert words in message
    assert "job.toml: " in message
    assert len(message) < 400


def test_tables_that_are_missing(tmp_path):
    assert "table [part] is missing" in fault(tmp_path, "")
    assert "table [target] is missing" in fault(tmp_path, '[part]\nshape = "cosine_top"\n')


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.toml: cannot be read: No such file"):
        config.load(tmp_path / "nowhere.toml")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        config.load(tmp_path)
    (tmp_path / "x.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(InputError, match="is no text in UTF-8"):
        config.load(tmp_path / "x.toml")


def test_the_table_documents_every_key():
    rows = config.table().splitlines()
    assert rows[0] == "| key | value | default | meaning |"
    assert all(row.count("|") == 5 for row in rows)
    keys = [row.split("`")[1] for row in rows[2:]]
    tables = {
        "part": Part,
        "target": config.TargetSource,
        "design": config.Design,
        "materials": config.Materials,
    }
    own = ("pattern", "kind", *tables)
    wanted = [f.name for f in dataclasses.fields(Job) if f.name not in own]
    for name, kind in tables.items():
        wanted += [f"{name}.{f.name}" for f in dataclasses.fields(kind)]
    wanted += ["pattern.kind"]
    assert keys[: len(wanted)] == wanted
    patterns = [name.split(".")[1] for name in keys[len(wanted) :]]
    given = [f.name for kind in PATTERNS for f in dataclasses.fields(settings_of(kind))]
    assert sorted(patterns) == sorted(given)
    assert '| `pattern.road_width` | length such as "0.4mm" | `"0.4mm"` |' in config.table()
