import dataclasses
import tomllib
from pathlib import Path

import pytest

from fdjax.errors import InputError
from fdjax.formats import profile, template
from fdjax.road.bead import section_area

FOLDER = Path(profile.__file__).parent / "profiles"


def write(tmp_path: Path, base: str, old: str, new: str) -> Path:
    text = (FOLDER / f"{base}.toml").read_text()
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize("name", profile.names())
def test_bundled_profiles_load_under_their_own_name(name):
    machine = profile.load(name)
    assert machine.name == name
    assert getattr(machine, machine.format) is not None


def test_lengths_are_millimetres():
    machine = profile.load("stratasys-fdm1650")
    assert machine.bed == (254.0, 254.0, 254.0)
    assert machine.least_road == pytest.approx(3.302)
    assert machine.longest_span == pytest.approx(3.81)
    assert machine.road_width == pytest.approx((0.3556, 1.016))
    assert machine.least_spacing is None


@pytest.mark.parametrize("name", profile.names())
def test_limits_are_the_machines_own(name):
    machine = profile.load(name)
    for field in dataclasses.fields(machine.limits):
        assert getattr(machine.limits, field.name) == getattr(machine, field.name)


def test_flow_codes_hold_the_whole_legal_range():
    machine = profile.load("stratasys-fdm1650")
    for width in machine.road_width:
        for height in machine.layer_height:
            assert 2 <= section_area(width, height) / machine.sml.area_per_code <= 254


def test_a_profile_can_be_a_file(tmp_path):
    path = write(tmp_path, "marlin-0.4", "bed = [220, 220, 250]", 'bed = ["12in", 220, 250]')
    assert profile.load(path).bed[0] == pytest.approx(304.8)
    assert profile.load(str(path)).gcode == profile.load("marlin-0.4").gcode


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("filament = 1.75", "filament = 0", "gcode.extrusion.filament: 0 mm is absurd"),
        ("filament = 1.75", "filamnt = 1.75", "filamnt: unknown key .did you mean filament"),
        ("filament = 1.75 ", "", "gcode.extrusion.filament: missing value"),
        ("nozzle = 0.4", "nozzle = -0.4", ": nozzle: -0.4 mm is absurd"),
        ("nozzle = 0.4", "nozzle = inf", "nozzle"),
        ("nozzle = 0.4", 'nozzle = "0.4 furlong"', "nozzle: unknown unit"),
        ("nozzle = 0.4", "nozzle = true", "nozzle: True is no length"),
        ("bed = [220, 220, 250]", "bed = [0, 220, 250]", ": bed: 0 mm is absurd"),
        ("bed = [220, 220, 250]", "bed = [220, 220]", "bed: .* 3 lengths"),
        ("road_width = [0.3, 0.8]", "road_width = [0.8, 0.3]", "road_width: the smallest"),
        ("tools = 1", "tools = 1.5", "gcode.tools: 1.5 is no whole number"),
        ("relative_e = true", "relative_e = 1", "gcode.relative_e: 1 is neither"),
        ("flow = 1.0", "flow = nan", "gcode.extrusion.flow: nan is absurd"),
        ("M104 S{nozzle_temperature}", "M104 S{nozle}", "gcode.start: unknown placeholder {nozle}"),
        ("M104 S{nozzle_temperature}", "M104 S{0.__class__}", "unknown placeholder"),
        ("M104 S{nozzle_temperature}", "M104 S{", "gcode.start: stray brace"),
        ('format = "gcode"', 'format = "sml"', "sml: missing table"),
        ('format = "gcode"', 'format = "g"', "format: 'g'; one of gcode, sml"),
        ("unverified = []", 'unverified = ["gcode.nothing"]', "unverified: there is no key"),
        ("[gcode.cooling]", "[gcode.cooling", "cannot be read as TOML"),
    ],
)
def test_a_bad_value_is_named_with_profile_table_and_key(tmp_path, old, new, message):
    path = write(tmp_path, "marlin-0.4", old, new)
    with pytest.raises(InputError, match=message) as caught:
        profile.load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('layer = "AZ{z};"', 'layer = "AZ{zz};"', "sml.layer: unknown placeholder"),
        ('layer = "AZ{z};"', 'layer = "AZ1;"', "sml.layer: .* one command"),
        ('["SP1;", "SP2;"]', '["SP1;", "SP1;"]', "sml.materials: .* different"),
        ('["SP1;", "SP2;"]', '["SP1"]', "sml.materials: .* one command"),
        ("start_code = 53", "start_code = 52", "sml.start_code: 52 is even"),
        ("area_per_code = 0.0015", "area_per_code = 0", "sml.area_per_code: 0 is absurd"),
        ('comment = "#"', 'comment = ";"', "sml.comment"),
        ('"CD0;", "FH;"]', '"CD0"]', "sml.footer: 'CD0' does not end in ;"),
    ],
)
def test_a_bad_sml_value_is_named(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        profile.load(write(tmp_path, "stratasys-fdm1650", old, new))


@pytest.mark.parametrize("given", ["marlin-0.5", "/no/such/file.toml", "."])
def test_a_profile_that_is_not_there(given):
    with pytest.raises(InputError, match="profile"):
        profile.load(given)


def test_every_unverified_key_is_in_the_file():
    data = tomllib.loads((FOLDER / "stratasys-fdm1650.toml").read_text())
    for dotted in data["unverified"]:
        table = data
        for part in dotted.split("."):
            table = table[part]


def test_placeholders_are_filled_by_plain_replacement():
    assert template.fill(["A{x}B{y}{x}"], {"x": "{y}", "y": 2}) == ["A{y}B2{y}"]


def test_machines_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        profile.load("marlin-0.4").nozzle = 1.0


def test_rooms_that_do_not_begin_at_the_beds_corner(tmp_path):
    text = (Path(profile.__file__).parent / "profiles" / "marlin-0.4.toml").read_text()
    delta = text.replace("nozzle = 0.4\n", 'nozzle = 0.4\nbed_origin = [-110, "-110mm"]\n', 1)
    path = tmp_path / "delta.toml"
    path.write_text(delta)
    machine = profile.load(path)
    assert machine.room == ((-110, -110, 0), (110, 110, 250))
    assert machine.parking == (-110, 110)
    path.write_text(delta.replace("[stream]\n", "[stream]\npark = [0, 90]\ncoldest = 0\n"))
    assert (profile.load(path).parking, profile.load(path).stream.coldest) == ((0, 90), 0)
    path.write_text(text.replace("nozzle = 0.4\n", "nozzle = 0.4\nlowest = [0, -3, -0.2]\n", 1))
    assert profile.load(path).room == ((0, -3, -0.2), (220, 220, 250))
    path.write_text(text.replace("nozzle = 0.4\n", "nozzle = 0.4\nlowest = [300, 0, 0]\n", 1))
    with pytest.raises(InputError, match="lowest: must be below"):
        profile.load(path)
