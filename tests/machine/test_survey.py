"""What a survey tells of a file, and that each fault in one is found."""

import dataclasses
import math
import subprocess
import sys
from pathlib import Path

import pytest

from fdjax.errors import InputError
from fdjax.formats import profile, read_file, write_file
from fdjax.machine.findings import LONGEST
from fdjax.machine.program import Program
from fdjax.machine.survey import survey

sys.path.append(str(Path(__file__).parents[1] / "formats"))
from format_samples import small_build

MARLIN = profile.load("marlin-0.4")
BARE = dataclasses.replace(MARLIN, gcode=dataclasses.replace(MARLIN.gcode, tools=2, prime=()))
STRATASYS = profile.load("stratasys-fdm1650")

GOOD = """\
; a small good file
G21
G90
M83
G28
M140 S60
M109 S210
G0 Z0.2 F600
G0 X10 Y10 F6000
G1 X60 Y10 E2 F1200
G1 X60 Y60 E2
G0 Z0.4
G1 X10 Y60 E2
M104 S0
M140 S0
"""
GOOD_SML = "FH;\nAZ8;\nSR800;\nMA1000,1000;\nMM;MM6,100;\nMA2000,1000;\nMM;\n"


def look(tmp_path, text, machine=MARLIN, suffix=".gcode", **options):
    path = tmp_path / f"part{suffix}"
    path.write_bytes(text.encode())
    return survey(Program(path, machine), **options)


def of_firmware(name, machine=MARLIN, **changes):
    stream = dataclasses.replace(machine.stream, firmware=name, **changes)
    return dataclasses.replace(machine, stream=stream)


def kinds(found, severity="error"):
    return [(f.kind, f.line) for f in found.findings if f.severity == severity]


def test_a_good_file_has_no_findings(tmp_path):
    found = look(tmp_path, GOOD)
    assert found.findings == ()
    assert (found.lines, found.commands) == (15, 14)
    assert (found.nozzle, found.bed) == (210, 60)


def test_layers_are_where_material_lies_higher(tmp_path):
    found = look(tmp_path, GOOD.replace("G1 X60 Y60", "G1 Z0.21\nG1 X60 Y60"))
    assert [(layer.line, layer.z) for layer in found.layers] == [(10, 0.2), (14, 0.4)]
    assert [found.layer_of(line) for line in (1, 9, 10, 13, 14, 99)] == [0, 0, 1, 1, 2, 2]
    assert 0 < found.layers[0].seconds < found.layers[1].seconds < found.seconds


@pytest.mark.parametrize("mark", [";LAYER:7", "; LAYER_CHANGE", "; fdjax layer z=1 height=0.2"])
def test_layers_are_where_comments_say(tmp_path, mark):
    lines = GOOD.splitlines()
    lines[10:10] = [mark]
    lines[8:8] = [mark]
    found = look(tmp_path, "\n".join(lines))
    assert [(layer.line, layer.z) for layer in found.layers] == [(9, 0.2), (12, 0.2)]


def test_time_of_layers_does_not_depend_on_looking_ahead(tmp_path):
    lines = [f"G1 X{100 + 50 * math.cos(a / 9)} Y{100 + 50 * math.sin(a / 9)}" for a in range(2000)]
    whole = look(tmp_path, "G21\nG28\n" + "\n".join([*lines, ";LAYER:1", *lines]))
    part = look(tmp_path, "G21\nG28\n" + "\n".join(lines))
    assert whole.layers[0].seconds == pytest.approx(part.seconds, abs=0.2)
    assert whole.seconds == pytest.approx(2 * part.seconds, rel=0.01)


def test_homing_and_heating_take_no_time_here(tmp_path):
    found = look(tmp_path, "G21\nG28\nM190 S60\nM109 S210\nG28\nG4 S2\n")
    assert found.seconds == 2
    assert found.moves is None


@pytest.mark.parametrize("machine", [BARE, STRATASYS])
def test_material_is_what_the_file_holds(tmp_path, machine):
    path = tmp_path / f"part.{machine.format}"
    write_file(small_build(materials=2), path, machine)
    build = read_file(path, machine=machine)
    volume = math.fsum(
        road.segment_volumes(layer.height).sum() for layer in build.layers for road in layer.roads
    )
    found = survey(Program(path, machine))
    assert kinds(found) == []
    assert found.volume == pytest.approx(volume, rel=1e-9)
    assert found.grams == pytest.approx(volume / 1000 * machine.stream.density)
    assert [layer.z for layer in found.layers] == pytest.approx([x.z for x in build.layers])
    if machine is BARE:
        assert found.filament == pytest.approx(volume / (math.pi / 4 * 1.75**2))


def test_what_is_pulled_back_and_returned_counts_once(tmp_path):
    text = GOOD.replace("G0 Z0.4", "G1 E-3\nG0 Z0.4\nG1 E3")
    assert look(tmp_path, text).filament == pytest.approx(6)


@pytest.mark.parametrize(
    ("lines", "share"), [("M221 S50", 0.5), ("M220 S50", 1), ("M200 D1.75", 1 / 2.405281875)]
)
def test_flow_and_volumetric_e_scale_the_material(tmp_path, lines, share):
    found = look(tmp_path, GOOD.replace("M83", f"M83\n{lines}"))
    assert found.volume == pytest.approx(share * look(tmp_path, GOOD).volume)


def test_speed_factor_and_accelerations_change_the_time(tmp_path):
    plain = look(tmp_path, GOOD).seconds
    assert look(tmp_path, GOOD.replace("M83", "M83\nM220 S50")).seconds > 1.8 * plain
    assert look(tmp_path, GOOD.replace("M83", "M83\nM204 P20")).seconds > plain + 1
    assert look(tmp_path, GOOD.replace("M83", "M83\nM204 P1000 T1000")).seconds == plain


def test_a_file_in_utf_16_is_named_as_such(tmp_path):
    path = tmp_path / "part.gcode"
    path.write_text(GOOD, encoding="utf-16")
    with pytest.raises(InputError, match="UTF-16"):
        Program(path, MARLIN)
    path.write_text(GOOD, encoding="utf-8-sig")
    assert survey(Program(path, MARLIN)).findings == ()


def test_boxes(tmp_path):
    found = look(tmp_path, GOOD.replace("G0 Z0.4", "G0 X0 Y200 Z0.4"))
    assert found.deposits == ((0, 10, 0.2), (60, 200, 0.4))
    assert found.moves == ((0, 0, 0.2), (60, 200, 0.4))
    assert look(tmp_path, "G21\nG28\n").deposits is None


@pytest.mark.parametrize(
    ("old", "new", "kind", "line"),
    [
        ("G1 X60 Y60", "G1 X60 Y221", "bed", 11),
        ("G1 X60 Y60", "G1 X-0.1 Y60", "bed", 11),
        ("G0 Z0.4", "G0 Z251", "bed", 12),
        ("G1 X60 Y60", "G2 X60 Y60 I0 J200", "bed", 11),
        ("S210", "S300", "heat", 7),
        ("S60", "S130", "heat", 6),
        ("G0 Z0.4", "M117 " + "x" * 90, "long line", 12),
        ("G0 Z0.4", "M117 " + "ä" * 45, "long line", 12),
        ("G0 Z0.4", "M112", "forbidden", 12),
        ("G0 Z0.4", "M0", "forbidden", 12),
        ("G0 Z0.4", "M01", "forbidden", 12),
        ("G0 Z0.4", "M0 Insert the nuts", "forbidden", 12),
        ("G0 Z0.4", "G91 G1 X5", "unknown", 12),
        ("G0 Z0.4", "G1 X20 A0.6", "unknown", 12),
        ("G0 Z0.4", "G1 X20 E6.65e-01", "unknown", 12),
        ("G0 Z0.4", "M28 a.gco", "forbidden", 12),
        ("G0 Z0.4", "M30 a.gco", "forbidden", 12),
        ("G0 Z0.4", "M502", "forbidden", 12),
        ("G28", "G91\nG1 X5\nG90\nG28", "homing", 6),
        ("G28", "G1 Z5", "homing", 5),
        ("G28", "G28 Z", "homing", 9),
        ("M109 S210", "M109 S140", "cold", 10),
        ("M109 S210", "G4 P1", "cold", 10),
        ("G0 Z0.4", "garbage 17", "unknown", 12),
        ("G0 Z0.4", "G0 Z0.4.1", "unknown", 12),
        ("G0 Z0.4", "X10", "unknown", 12),
        ("G0 Z0.4", "%", "unknown", 12),
        ("G0 Z0.4", "; far\n" * 1000 + "G1 X\0\0\0", "binary", 1012),
        ("G0 Z0.4", "T1", "tool", 12),
        ("; a small", "T1\n; a small", "tool", 1),
        ("G0 Z0.4", "G2 X50 Y50 I1" + "0" * 40, "unknown", 12),
        ("G0 Z0.4", "M104 T3 S0", "tool", 12),
        ("; a small", "; fdjax machine = other\n; a small", "machine", 0),
        ("; a small", "; fdjax version = 1\n; a small", "truncated", 16),
    ],
)
def test_errors(tmp_path, old, new, kind, line):
    found = look(tmp_path, GOOD.replace(old, new, 1))
    assert kinds(found)[:1] == [(kind, line)]
    assert found.errors[0].message.isprintable()
    assert str(found.errors[0]).startswith(f"error: {kind}{f', line {line}' if line else ''}: ")


def test_a_tool_may_share_the_heater_of_another(tmp_path):
    text = GOOD.replace("G0 Z0.4", "T1\nG0 Z0.4").replace("M104 S0", "M104 T0 S0")
    assert kinds(look(tmp_path, text, BARE), "warning") == [("cold", 14)]
    text = text.replace("T1\n", "M104 T1 S20\nT1\n")
    assert kinds(look(tmp_path, text, BARE)) == [("cold", 15)]


@pytest.mark.parametrize(
    ("old", "new", "kind", "line"),
    [
        ("G21\n", "", "units", 0),
        ("M104 S0\n", "", "left on", 14),
        ("M140 S0\n", "", "left on", 14),
    ],
)
def test_warnings(tmp_path, old, new, kind, line):
    found = look(tmp_path, GOOD.replace(old, new))
    assert kinds(found) == []
    assert kinds(found, "warning") == [(kind, line)]


@pytest.mark.parametrize(
    "new", ["G91\nG1 Z5 F600\nG90\nG28", "G28 X Y\nG28 Z", "G92 E0\nG28", "G28\nG20\nG21"]
)
def test_what_may_stand_before_homing(tmp_path, new):
    assert look(tmp_path, GOOD.replace("G28", new)).findings == ()


def test_inches_are_fine_and_meant(tmp_path):
    text = GOOD.replace("G21", "G20").replace("X60", "X9")
    assert kinds(look(tmp_path, text)) == [("bed", 9)]


def test_findings_of_one_kind_are_one(tmp_path):
    text = GOOD.replace("G0 Z0.4", "G0 Z0.4\n" + "G1 X300 Y3\nG1 X3 Y3\n" * 1000)
    (finding,) = look(tmp_path, text).findings
    assert (finding.line, finding.count) == (13, 1000)
    assert str(finding).endswith("(and in 999 more)")


def test_an_empty_file(tmp_path):
    assert kinds(look(tmp_path, "")) == [("empty", 0)]
    assert kinds(look(tmp_path, "; nothing\n\n")) == [("empty", 0)]


@pytest.mark.parametrize("change", [(" E2", ""), (" E2", " E-2"), ("M83\n", "M83\nM221 S0\n")])
def test_a_file_that_deposits_nothing(tmp_path, change):
    assert kinds(look(tmp_path, GOOD.replace(*change))) == [("empty", 0)]
    grbl = of_firmware("grbl")
    assert ("empty", 0) not in kinds(look(tmp_path, GOOD.replace(*change), machine=grbl))


def test_a_truncated_file_of_fdjax(tmp_path):
    for machine in (BARE, STRATASYS):
        path = tmp_path / f"part.{machine.format}"
        write_file(small_build(), path, machine)
        text = path.read_text()
        for share in (0.5, 0.9):
            found = look(tmp_path, text[: int(share * len(text))], machine, path.suffix)
            assert "truncated" in [kind for kind, _ in kinds(found)]


@pytest.mark.parametrize(
    ("firmware", "length", "kind"),
    [("marlin", 76, []), ("marlin", 100, ["long line"]), ("rrf", 100, []), ("klipper", 900, [])],
)
def test_long_lines_depend_on_the_firmware(tmp_path, firmware, length, kind):
    text = GOOD.replace("G0 Z0.4", "M117 " + "x" * length)
    assert [k for k, _ in kinds(look(tmp_path, text, of_firmware(firmware)))] == kind


def test_a_frame_counts_for_the_length(tmp_path):
    """`N110 M117 ...*255` and a newline: numbers may run ahead of the file's."""
    for length, count in ((LONGEST["marlin"] - 10, 0), (LONGEST["marlin"] - 9, 1)):
        text = GOOD.replace("G0 Z0.4", "M117 ".ljust(length, "x"))
        assert len(look(tmp_path, text).errors) == count
    assert len(look(tmp_path, text, longest=200).errors) == 0


def test_grbl_may_run_without_homing_and_ends_with_m30(tmp_path):
    grbl = of_firmware("grbl")
    text = "G21G90\nM3S100\nG1X5Y5F100\nX-0.5\nM5\nM30\n"
    found = look(tmp_path, text, grbl)
    assert kinds(found) == [("bed", 4)]
    assert kinds(found, "warning") == [("homing", 3)]
    assert look(tmp_path, "$H\n" + text.replace("-0", ""), grbl).findings == ()


def test_macros_may_home_and_heat(tmp_path):
    text = GOOD.replace("G28", "START_PRINT BED=60").replace("M109 S210\n", "")
    assert kinds(look(tmp_path, text)) != []
    found = look(tmp_path, text, of_firmware("klipper"))
    assert kinds(found) == []
    assert [kind for kind, _ in kinds(found, "warning")] == ["homing", "cold"]


def test_sml(tmp_path):
    found = look(tmp_path, GOOD_SML, STRATASYS, ".sml")
    assert found.findings == ()
    assert found.deposits is not None
    assert found.deposits[0] == pytest.approx((25.4, 25.4, 0.2032))
    assert found.deposits[1] == pytest.approx((50.8, 25.4, 0.2032))
    assert found.seconds > 0


@pytest.mark.parametrize(
    ("old", "new", "kind", "line"),
    [
        ("MA2000,", "MA10001,", "bed", 6),
        ("MA2000,", "MA-1,", "bed", 6),
        ("AZ8", "AZ10001", "bed", 2),
        ("FH;", "MM;", "homing", 2),
        ("MA2000", "QQ2000", "unknown", 6),
        ("SR800;", "SR" + "0" * 300 + "800;", "long line", 3),
        ("MM;\n", "BC;\n", "truncated", 7),
        ("MM;\n", "MM", "truncated", 7),
    ],
)
def test_errors_in_sml(tmp_path, old, new, kind, line):
    text = GOOD_SML[:-4] + GOOD_SML[-4:].replace(old, new) if old == "MM;\n" else GOOD_SML
    found = look(tmp_path, text.replace(old, new, 1), STRATASYS, ".sml")
    assert kinds(found)[:1] == [(kind, line)]


def test_sml_homed_in_the_middle_of_a_line(tmp_path):
    text = GOOD_SML.replace("FH;\n", "WA1;FH;").replace("SR", "FH;SR")
    found = look(tmp_path, text, STRATASYS, ".sml")
    assert found.findings == ()
    assert found.seconds > 1


def large(path):
    with path.open("w") as file:
        file.write(GOOD + "M109 S210\n")
        for k in range(200_000):
            if k % 4000 == 0:
                file.write(f";LAYER:{k // 4000}\n")
            file.write(f"G1 X{100 + k % 97} Y{100 + k % 89} E0.1\n")
        file.write("M104 S0\n")
    return path


def test_progress(tmp_path):
    shares = []
    found = survey(Program(large(tmp_path / "large.gcode"), MARLIN), progress=shares.append)
    assert found.findings == ()
    assert len(found.layers) == 50
    assert len(shares) == 10
    assert shares == sorted(shares)
    assert 0 < shares[0] < shares[-1] <= 1


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="tells memory on Linux only")
def test_memory_does_not_grow_with_the_file(tmp_path):
    script = """
import re, sys
from pathlib import Path
from fdjax.formats import profile
from fdjax.machine.program import Program
from fdjax.machine.survey import survey

def peak():
    return int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1])

seen = []
small, large = (Program(Path(each), profile.load("marlin-0.4")) for each in sys.argv[1:])
survey(small)
assert "numpy" not in sys.modules
survey(large, progress=lambda _: seen.append(peak()))
assert not {"shapely", "jax", "matplotlib"} & sys.modules.keys()
print(seen[0], seen[-1])
"""
    path = large(tmp_path / "large.gcode")
    small = tmp_path / "small.gcode"
    small.write_text(GOOD)
    run = subprocess.run(
        [sys.executable, "-c", script, str(small), str(path)],
        capture_output=True,
        text=True,
        check=True,
    )
    first, last = map(int, run.stdout.split())  # kB, after a tenth of the file and at its end
    assert last < 60_000
    assert last - first < 2_000


def test_a_file_of_another_kind_is_refused(tmp_path):
    with pytest.raises(InputError):
        look(tmp_path, GOOD, MARLIN, ".sml")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("G2 X50 Y10 R30", "no arcs with R"),
        ("G91\nG3 X5 I2.5\nG90", "no arcs with G91"),
        ("G20", "millimetres only"),
        ("G1 E60 F300", "60.000 mm of filament in one move: Klipper takes 50 mm"),
        ("G1 Z9 E-51", "stream.longest_push"),
        ("G1 X11 E0.6", "a section of 1.443 mm"),
        ("G1 X9 Y61 E.5", "stream.largest_section"),
        ("G1 X50 F0", "F0 is no speed"),
        ("RESTORE_GCODE_STATE NAME=none", "no state of that name was saved"),
    ],
)
def test_what_klipper_refuses_is_found_beforehand(tmp_path, line, message):
    text = GOOD.replace("M104 S0", f"{line}\nM104 S0")
    found = look(tmp_path, text, of_firmware("klipper"))
    assert kinds(found)[0] == ("refused", 14 + line.startswith("G91"))
    assert message in found.errors[0].message
    marlin = look(tmp_path, text, of_firmware("marlin"))
    assert "refused" not in {finding.kind for finding in marlin.errors} or "RESTORE" in line


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"longest_push": 80.0}, "G1 E60 F300"),
        ({"largest_section": 2.0}, "G1 X61 E0.6"),
        ({}, "G1 X60.05 E0.1"),  # so little may be laid anywhere
        ({}, "M221 S50\nG1 X61 E0.5"),
    ],
)
def test_klippers_limits_are_the_profiles(tmp_path, changes, line):
    text = GOOD.replace("G0 Z0.4", f"{line}\nG0 Z0.4").replace("Y60 E2\nG1 X6", "Y60 E2\nG1 X6")
    text = text.replace("G1 X60 Y60 E2\n", "")
    assert kinds(look(tmp_path, text, of_firmware("klipper", **changes))) == []


def test_what_a_firmware_passes_over_is_a_warning(tmp_path):
    text = GOOD.replace("M83", "M83\nM205 X5\nM201 X500\nG4 S2")
    found = look(tmp_path, text, of_firmware("klipper"))
    assert kinds(found, "warning") == [("unknown", 5), ("unknown", 6), ("wait", 7)]
    assert look(tmp_path, text).findings == ()
    assert found.seconds == pytest.approx(look(tmp_path, text).seconds - 2, rel=0.01)


CENTRED = GOOD.replace("X10", "X-40").replace("Y10", "Y-10")


@pytest.mark.parametrize(
    ("text", "changes", "key"),
    [
        (CENTRED, {"bed_origin": (-110.0, -110.0)}, "bed_origin"),
        (GOOD.replace("G0 X10", "G0 Y-3\nG0 X10"), {"lowest": (0.0, -3.0, 0.0)}, "lowest"),
        (GOOD.replace("Z0.2", "Z-.1\nG0 Z.2"), {"lowest": (0.0, 0.0, -0.2)}, "lowest"),
        (GOOD.replace("S210", "S100"), {"stream": {"coldest": 80.0}}, "stream.coldest"),
        (GOOD.replace("M109 S210\n", ""), {"stream": {"coldest": 0.0}}, "stream.coldest"),
    ],
)
def test_keys_of_the_profile_let_other_machines_through(tmp_path, text, changes, key):
    refused = look(tmp_path, text)
    assert key in refused.errors[0].message
    stream = dataclasses.replace(MARLIN.stream, **changes.pop("stream", {}))
    machine = dataclasses.replace(MARLIN, **changes, stream=stream)
    assert look(tmp_path, text, machine).errors == ()


@pytest.mark.parametrize(
    ("line", "firmware", "passes"),
    [
        ("M302 S80", "marlin", True),
        ("M302 P1", "marlin", True),
        ("M302 S110", "marlin", False),
        ("M302 P1", "rrf", True),
        ("M302 P1", "klipper", False),  # it does not know it
    ],
)
def test_m302_is_respected(tmp_path, line, firmware, passes):
    text = GOOD.replace("S210", "S100").replace("M83", f"M83\n{line}")
    errors = look(tmp_path, text, of_firmware(firmware)).errors
    assert (errors == ()) is passes
    assert passes or ("M302" in errors[0].message) is (firmware == "marlin")
