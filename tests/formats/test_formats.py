import subprocess
import sys

import pytest
from format_samples import RING, small_build

from fdjax import formats
from fdjax.errors import InputError
from fdjax.formats import profile

MACHINES = {".sml": "stratasys-fdm1650"}


@pytest.mark.parametrize("suffix", formats.FORMATS)
def test_every_suffix_has_a_writer_and_a_reader(tmp_path, suffix):
    path = tmp_path / f"part{suffix.upper()}"
    machine = profile.load(MACHINES.get(suffix, "marlin-0.4"))
    path.write_text(formats.module(path).write(small_build(), machine))
    build = formats.read_file(path, layer_height=None)
    assert build.name == "small part"
    assert [layer.z for layer in build.layers] == pytest.approx([0.254, 0.508])


@pytest.mark.parametrize("suffix", formats.FORMATS)
def test_a_written_file_holds_what_the_format_writes(tmp_path, suffix):
    path = tmp_path / f"part{suffix}"
    machine = profile.load(MACHINES.get(suffix, "marlin-0.4"))
    path.write_text("older")
    formats.write_file(small_build(), path, machine)
    assert path.read_text() == formats.module(path).write(small_build(), machine)
    formats.write_file(small_build(), str(path), machine.name)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("name", "machine", "message"),
    [
        ("part.stl", "marlin-0.4", "unknown kind of file"),
        ("part.gcode", "marlin", "no such machine or file"),
        ("part.sml", "marlin-0.4", "writes no SML"),
        ("folder.ssl", "marlin-0.4", "folder.ssl: cannot be written"),
        ("missing/part.ssl", "marlin-0.4", "part.ssl: cannot be written"),
        ("file/part.ssl", "marlin-0.4", "part.ssl: cannot be written"),
    ],
)
def test_what_cannot_be_written_leaves_nothing(tmp_path, name, machine, message):
    (tmp_path / "folder.ssl").mkdir()
    (tmp_path / "file").write_text("a file")
    with pytest.raises(InputError, match=message):
        formats.write_file(small_build(), tmp_path / name, machine)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder.ssl"]


def test_options_reach_the_reader(tmp_path):
    path = tmp_path / "part.gcode"
    path.write_text("G1 Z0.2\nG1 X10 E1\n")
    build = formats.read_file(path, machine="marlin-0.4", outline=RING, layer_height=0.3)
    assert build.layers[0].outline is RING
    assert build.layers[0].height == 0.3


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("part.stl", {}, "unknown kind of file; known are .gcode"),
        ("missing.gcode", {}, "missing.gcode: cannot be read"),
        ("folder.sml", {}, "folder.sml: cannot be read"),
        ("broken.gcode", {}, "broken.gcode: not G-code"),
        ("broken.ssl", {}, "broken.ssl: not SSL"),
        ("broken.ssl", {"filament": 1.75}, "a .ssl file has no use for 'filament'"),
        ("broken.gcode", {"machine": "marlin"}, "no such machine or file"),
    ],
)
def test_what_cannot_be_read(tmp_path, name, options, message):
    (tmp_path / "folder.sml").mkdir()
    for broken in ("broken.gcode", "broken.ssl"):
        (tmp_path / broken).write_bytes(b"\x89PNG\xff\xfe\n")
    with pytest.raises(InputError, match=message):
        formats.read_file(tmp_path / name, **options)


def test_neither_jax_nor_numpy_is_loaded_too_early():
    code = (
        "import sys, fdjax.formats.profile as p; p.load('marlin-0.4');"
        "assert not {'numpy', 'shapely', 'jax'} & set(sys.modules);"
        "import fdjax.formats.gcode, fdjax.formats.sml, fdjax.formats.ssl;"
        "assert 'jax' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
