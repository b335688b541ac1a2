"""After a crash: the layer to go on from is right, the state is rebuilt, Z is never homed."""

import dataclasses
import random
import re
import signal
import subprocess
import sys
import threading
import time

import pytest
from streams import PRINTER, gcode, sml, stream, units

from fdjax.errors import InputError
from fdjax.machine import journal, resume
from fdjax.machine.journal import Job, Journal
from fdjax.machine.program import Program, switched_on
from fdjax.machine.resume import Standing
from fdjax.machine.virtual.marlin import VirtualMarlin
from fdjax.machine.virtual.serve import PseudoTerminal

OWN = ("M105", "M110", "M114", "M115")


def layered(path, layers=8, lines=60):
    """A program with marked layers, each at its own height."""
    chance = random.Random(layers)
    text = ["G21", "G90", "M83", "M140 S60", "M104 S200", "G28", "M109 S200", "G92 E0"]
    for layer in range(layers):
        text += [f";LAYER:{layer}", f"G0 Z{0.2 * (layer + 1):.3f} F600", f"M106 S{30 * layer}"]
        for _ in range(lines):
            x, y = chance.uniform(10, 200), chance.uniform(10, 200)
            text.append(f"G1 X{x:.3f} Y{y:.3f} E{chance.uniform(0.1, 1):.4f} F3000")
    path.write_text("\n".join([*text, "M104 S0", "M140 S0"]) + "\n")
    return Program(path, PRINTER)


def starts(program):
    return [number for number, line in program.lines() if program.is_layer(line)]


class Bench:
    """A virtual Marlin at a pseudo-terminal, and senders in processes of their own."""

    def __init__(self):
        self.machine = VirtualMarlin(PRINTER, keep=True, record=True)
        self.terminal = PseudoTerminal()
        self._over = False
        self._thread = threading.Thread(
            target=self.terminal.serve, args=(self.machine,), kwargs={"until": lambda: self._over}
        )
        self._thread.start()

    def sender(self, program, *options):
        command = [sys.executable, "-m", "fdjax", "send", str(program.path), "--yes"]
        command += ["--machine", "marlin-0.4", "--port", self.terminal.name, *options]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def kill_when(self, sender, lines):
        """Kill it once the machine has run so many of the file's lines."""
        until = time.monotonic() + 30
        while len(self.ran()) < lines and time.monotonic() < until:
            time.sleep(0.0005)
        sender.send_signal(signal.SIGKILL)
        sender.wait()
        sender.communicate()
        time.sleep(0.15)  # what was written still arrives
        return len(self.ran())

    def ran(self):
        return [text for text in list(self.machine.executed) if not text.startswith(OWN)]

    def close(self):
        self._over = True
        self._thread.join()
        self.terminal.close()


@pytest.fixture
def bench():
    bench = Bench()
    yield bench
    bench.close()


def killed_and_resumed(bench, program, lines, *, power_lost=False):
    """How many lines had been run at the kill, what was said at resuming, and what ran then."""
    bench.machine.executed.clear()
    done = bench.kill_when(bench.sender(program), lines)
    before = bench.ran()
    if power_lost:
        bench.machine.reset(bench.machine.now)
        time.sleep(1.2)
    bench.machine.executed.clear()
    sender = bench.sender(program, "--resume")
    said, errors = sender.communicate(timeout=60)
    assert sender.returncode == 0, errors
    assert before == [text for text, _ in units(program)][:done]
    return done, said, bench.ran()


def check(bench, program, moment):
    done, said, ran = killed_and_resumed(bench, program, moment)
    wanted = units(program)
    layer = int(re.search(r"going on in layer (\d+)", said)[1])
    following = wanted[min(done, len(wanted) - 1)][1]
    marks = starts(program)
    assert layer in {sum(mark <= line for mark in marks) for line in (following, following - 1)}
    rest = [text for text, _ in wanted[done:]]
    assert "stands where the print broke off" in said
    # What is left runs once; settings just before may be said again.
    again = len(ran) - len(rest)
    assert ran[again:] == rest or ran[-len(rest) :] == rest
    assert not any(text.startswith("G28") for text in ran)


@pytest.mark.parametrize("seed", range(3))
def test_a_killed_print_goes_on_where_it_was(tmp_path, bench, seed):
    program = layered(tmp_path / "job.gcode")
    check(bench, program, random.Random(seed).randrange(15, 460))


@pytest.mark.slow
def test_fifty_kills(tmp_path, bench):
    program = layered(tmp_path / "job.gcode")
    chance = random.Random(50)
    for _ in range(50):
        check(bench, program, chance.randrange(15, 460))


def test_after_a_power_cut_x_and_y_are_homed_and_z_never(tmp_path, bench):
    program = layered(tmp_path / "job.gcode")
    done, said, ran = killed_and_resumed(bench, program, 250, power_lost=True)
    assert "has lost its position" in said
    assert [text for text in ran if text.startswith("G28")] == ["G28 X Y"]
    z = float(re.search(r"stopped, at z = ([\d.]+) mm", said)[1])
    assert f"G92 Z{z:.3f}" in ran
    heights = [float(found[1]) for text in ran if (found := re.search(r" Z([\d.]+)", text))]
    assert min(heights) >= z
    assert ran.index("M109 S200") < next(k for k, text in enumerate(ran) if " E0." in text)
    rest = [text for text, _ in units(program)]
    assert ran[-(len(rest) - done) :] == rest[done:]


def test_the_way_back_rebuilds_the_state(tmp_path):
    program = gcode(tmp_path / "job.gcode", 400)
    point = resume.Points(program, [], 300).kept
    for stands in Standing:
        state = switched_on(PRINTER, "marlin")
        height = point.state.on_bed[2]
        lines = resume.way_back(point, PRINTER, stands, height=height)
        assert not any(text.startswith("G28") and text != "G28 X Y" for text in lines)
        for text in ["G91", "M82", "G20", *lines]:
            state.run(text)
        wanted = point.state
        for name in ("absolute", "relative_e", "scale", "fan", "bed", "nozzles", "tool"):
            assert getattr(state, name) == getattr(wanted, name), name
        assert state.on_bed == pytest.approx(wanted.on_bed, abs=1e-3)
        assert state.e == pytest.approx(wanted.e, abs=1e-5)
        assert state.speed == pytest.approx(wanted.speed)


IN_FORCE = """\
M420 S1 Z3
M201 X900 Y900
M204 P500 T800
M205 X6 Y6
M900 K0.06
M220 S80
M221 S92
M106 P0 S128
M106 P2 S255
M141 S35
"""


@pytest.mark.parametrize("stands", [Standing.LOST, Standing.ELSEWHERE])
def test_the_way_back_brings_all_that_was_in_force(tmp_path, stands):
    program = layered(tmp_path / "job.gcode")
    text = program.path.read_text().replace("G28\n", f"G28\n{IN_FORCE}", 1)
    program.path.write_text(text)
    program = Program(program.path, PRINTER)
    point = resume.at_layer(program, starts(program), 4)
    lines = resume.way_back(point, PRINTER, stands, height=0.8)
    wanted = set(IN_FORCE.splitlines()) - {"M106 P0 S128"} | {"M106 S60"}
    assert wanted <= set(lines)
    assert lines.index("G28 X Y") < lines.index("M420 S1 Z3")  # homing turns the mesh off
    moved = next(k for k, line in enumerate(lines) if line.startswith("G1 Z"))
    assert lines.index("M205 X6 Y6") < moved


@pytest.mark.parametrize(
    ("fans", "said"),
    [
        (["M106 P2 S0"], ["M107", "M106 P2 S0"]),
        (["M106 S204", "M106 P2 S0"], ["M106 S204", "M106 P2 S0"]),
        (["M106 P1 S90", "M107 P1", "M106 S9"], ["M106 S9", "M106 P1 S0"]),
    ],
)
def test_all_fans_come_back_by_their_numbers(tmp_path, fans, said):
    path = tmp_path / "job.gcode"
    text = ["G28", "M109 S200", "M83", *fans, "G1 X10 Y10 Z1 E1 F600", ";LAYER:1", "G1 X20 E1"]
    path.write_text("\n".join(text))
    program = Program(path, PRINTER)
    point = resume.at_layer(program, starts(program), 1)
    lines = resume.way_back(point, PRINTER, Standing.HERE, height=0.8)
    assert sorted(line for line in lines if line.startswith(("M106", "M107"))) == sorted(said)


def test_a_layer_of_a_second_object_is_reached_above_the_first(tmp_path):
    path = tmp_path / "job.gcode"
    text = ["G28", "M109 S200", "M83", "G1 X10 Y10 Z30 F600", "G1 X20 E1", "G1 Z50"]
    text += ["G1 X90 Y90", ";LAYER:0", "G1 Z0.2", "G1 X99 E1"]
    path.write_text("\n".join(text))
    program = Program(path, PRINTER)
    point = resume.at_layer(program, starts(program), 1)
    for stands in Standing:
        lines = resume.way_back(point, PRINTER, stands, height=0.2)
        assert next(line for line in lines if line.startswith("G1 Z")) == "G1 Z60.000 F600"
        # What stands now may be higher than the layer that is begun anew.
        lines = resume.way_back(point, PRINTER, stands, height=0.2, top=70)
        assert "G1 Z80.000 F600" in lines


@pytest.mark.parametrize(
    ("firmware", "save", "back", "lost"),
    [
        ("marlin", "G60 S1", "G61 S1", True),
        ("klipper", "SAVE_GCODE_STATE NAME=a", "RESTORE_GCODE_STATE NAME=a MOVE=1", True),
        ("klipper", "SAVE_GCODE_STATE NAME=a", "RESTORE_GCODE_STATE NAME=a", False),
        ("rrf", "M120", "M121", False),
    ],
)
def test_a_place_that_the_machine_has_lost_is_not_gone_back_to(
    tmp_path, firmware, save, back, lost
):
    path = tmp_path / "job.gcode"
    text = ["G28", "M109 S200", "M83", "G1 X10 Y10 Z1 E1 F600", save, ";LAYER:1", "G1 X20 E1", back]
    path.write_text("\n".join(text))
    stream = dataclasses.replace(PRINTER.stream, firmware=firmware)
    program = Program(path, dataclasses.replace(PRINTER, stream=stream))
    point = resume.at_layer(program, starts(program), 1)
    if lost:
        with pytest.raises(InputError, match=r"line 8: .* a place that the machine has lost"):
            resume.must_be_saved(program, point)
    else:
        resume.must_be_saved(program, point)
        lines = resume.way_back(point, program.machine, Standing.LOST, height=1)
        assert save in lines


def test_sml_goes_on_between_roads_and_only_with_power(tmp_path):
    program = sml(tmp_path / "job.sml", 300)
    lines = list(program.commands())
    for reached in (50, 51, 52, 53, 54, 55):
        point = resume.Points(program, [], lines[reached].line).kept
        assert point.state.path is None
        assert point.state.outputs == ()
        back = resume.way_back(point, program.machine, Standing.HERE, height=0.0)
        assert back[0] == "PD;MM;"
        with pytest.raises(InputError, match="kept its power"):
            resume.way_back(point, program.machine, Standing.LOST, height=0.0)


def test_the_first_line_of_the_file_is_not_said_again(tmp_path):
    program = layered(tmp_path / "job.gcode")
    program.path.write_text("G28\n" + program.path.read_text())
    program = Program(program.path, PRINTER)
    run = stream(program, "marlin")
    run.stream.connect()
    run.stream.ask_position()
    point = resume.at_layer(program, starts(program), 3)
    run.stream.go_on(point, ["M105"])
    run.stream.run()
    assert run.ran() == [text for text, line in units(program) if line > point.line]


def test_a_layer_can_be_named(tmp_path):
    program = layered(tmp_path / "job.gcode")
    marks = starts(program)
    point = resume.at_layer(program, marks, 3)
    assert point.line == marks[2] - 1
    assert point.state.z == pytest.approx(0.4)
    with pytest.raises(InputError, match="layers 1 to 8"):
        resume.at_layer(program, marks, 9)


JOB = Job("job.gcode", "0123", "marlin-0.4", "/dev/ttyUSB0")


def test_the_journal_holds_the_last_line(tmp_path):
    path = tmp_path / "job.journal"
    kept = Journal(path, JOB)
    for line in range(1, 1000):
        kept.reached(line, line // 100, line / 10)
        if line in (1, 7, 500):
            assert journal.read(path) == (JOB, line, line // 100)
    kept.close()
    assert journal.read(path) == (JOB, 999, 9)


def test_a_write_that_was_broken_off_leaves_the_one_before(tmp_path):
    path = tmp_path / "job.journal"
    kept = Journal(path, JOB)
    for line in (1, 2, 3):
        kept.reached(line, 1, 0.0)
    kept.close()
    whole = path.read_bytes()
    place = whole.index(b" 3 1 ")
    path.write_bytes(whole[:place] + b"xxxx" + whole[place + 4 :])
    assert journal.read(path)[1] == 2
    path.write_bytes(whole[:20])
    with pytest.raises(InputError, match="damaged"):
        journal.read(path)
    with pytest.raises(InputError, match="there is none"):
        journal.read(tmp_path / "none")


def test_a_log_can_be_read_back(tmp_path):
    path = tmp_path / "job.log"
    log = journal.Log(path)
    entries = [(0.5, ">", b"N1 G28*18\n"), (0.75, "<", b"ok \\ \x00\xff\r\n"), (1.0, "<", b"")]
    for entry in entries:
        log(*entry)
    log.close()
    assert journal.read_log(path) == entries
    path.write_text("nonsense\n")
    with pytest.raises(InputError, match="line 1"):
        journal.read_log(path)


def test_after_an_abort_the_height_is_the_machines_own(tmp_path, bench):
    program = layered(tmp_path / "job.gcode")
    sender = bench.sender(program)
    until = time.monotonic() + 30
    while len(bench.ran()) < 200 and time.monotonic() < until:
        time.sleep(0.0005)
    sender.send_signal(signal.SIGINT)
    _, errors = sender.communicate(timeout=60)
    assert sender.returncode == 4, errors
    assert "aborted" in errors
    lifted = bench.machine.state.z
    bench.machine.executed.clear()
    sender = bench.sender(program, "--resume")
    said, errors = sender.communicate(timeout=60)
    assert sender.returncode == 0, errors
    assert "has kept its height" in said
    ran = bench.ran()
    assert not any(text.startswith("G92 Z") for text in ran)
    first = next(float(text.split("Z")[1].split()[0]) for text in ran if text.startswith("G1 Z"))
    assert first > lifted
    assert bench.machine.state.on_bed[2] == pytest.approx(1.6)


def hopping(path):
    """A program that hops between roads."""
    text = ["G21", "G90", "M83", "M104 S200", "G28", "M109 S200", "G92 E0", "G0 Z0.2 F600"]
    for k in range(60):
        text += [f"G1 X{10 + k} Y10 E0.5 F3000", "G0 Z0.8", f"G0 X{11 + k} Y60", "G0 Z0.2"]
    path.write_text("\n".join(text) + "\n")
    return Program(path, PRINTER)


def test_where_it_hopped_the_lowest_height_is_taken(tmp_path):
    program = hopping(tmp_path / "job.gcode")
    for reached in range(100, 110):
        assert resume.Points(program, [], reached).lowest == pytest.approx(0.2)


def test_nothing_is_gone_on_with_before_homing_or_the_first_road(tmp_path):
    program = hopping(tmp_path / "job.gcode")
    with pytest.raises(InputError, match="begin anew"):
        resume.Points(program, [], 8)
    for reached in range(9, 30):
        assert resume.Points(program, [], reached).lost.line >= 5
