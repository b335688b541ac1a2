"""The virtual machines say what theirs say: sources are in `fdjax.gcode.firmware`."""

import pytest
from streams import PRINTER

from fdjax.machine import virtual
from fdjax.machine.protocols.grbl import GrblProtocol


def told(machine, *lines, profile=PRINTER, **options):
    """What a machine answers to lines, and the machine."""
    player = virtual.MACHINES[machine](profile, keep=True, record=True, **options)
    said = []
    for second, line in enumerate(lines):
        player.receive(f"{line}\n".encode(), float(second))
        player.advance(second + 0.5)
        said += [data.decode().strip() for _, data in player.answers()]
    return said, player


@pytest.mark.parametrize("line", ["N5", "N-1 M110 N-1*125", "N0 M110 N0*125", "N17 *33"])
def test_klipper_takes_numbers_alone(line):
    assert told("klipper", line)[0] == ["ok"]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("G2 X9 R1", "!! klipper makes no arcs with R"),
        ("G2 X9", "!! an arc needs I and J"),
        ("G20", "!! G20 is refused"),
        ("G1 X1 F0", "!! F0 is no speed"),
        ("G1 E60 F100", "!! 60.000 mm of filament"),
        ("G1 X1 E1", "!! a section of"),
        ("G1 X999", "!! Move out of range"),
        ("RESTORE_GCODE_STATE NAME=x", "!! RESTORE_GCODE_STATE x"),
    ],
)
def test_klipper_refuses_and_lives(line, why):
    head = ("G28", "M104 S200", "M109 S200", "M83", "G1 X0 Y0 Z1 F600")
    said, player = told("klipper", *head, line, "G1 X5")
    assert said[5].startswith(why)
    assert said[6:] == ["ok", "ok"]
    assert player.state.x == 5
    assert player.executed[-2] == head[-1]


def test_klipper_says_what_it_does_not_know():
    for line, name in (("M205 X5", "M205"), ("T1", "T1"), ("X10", "X10"), ("M200 D2", "M200")):
        assert told("klipper", line)[0] == [f'// Unknown command:"{name}"', "ok"]


@pytest.mark.parametrize(
    ("machine", "answers"),
    [
        ("klipper", ["ok B:21.0 /0.0 T0:21.0 /0.0"]),
        ("marlin", ["ok T:21.0 /0.0 B:21.0 /0.0 @:0 B@:0"]),
        ("rrf", ["ok T:21.0 /0.0 B:21.0 /0.0"]),
    ],
)
def test_a_question_for_heat_is_answered_once(machine, answers):
    assert told(machine, "M105")[0] == answers


@pytest.mark.parametrize(
    ("line", "end", "says"),
    [
        ("G1 X10 (c) Y12", (10, 12), []),
        ("G1 (to the left) X3 Y4", (3, 4), []),
        ("T0", (0, 0), []),
        ("T1", (0, 0), ["echo:T1 Invalid extruder"]),
        ("T7", (0, 0), ["echo:T7 Invalid extruder"]),
        ("X10", (0, 0), ['echo:Unknown command: "X10"']),
        ("G4 P1 S0", (0, 0), []),
        ("\tN7 G1 X10", (0, 0), ['echo:Unknown command: "\tN7 G1 X10"']),  # damaged before its N
    ],
)
def test_marlin_reads_as_it_does(line, end, says):
    said, player = told("marlin", "G28", line)
    assert said == ["ok", *says, "ok"]
    assert player.state.on_bed[:2] == end


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("M21", []),
        ("M999.9", ["Warning: M999.9: Command is not supported"]),
        ("M1234 S1", ["Warning: M1234 S1: Command is not supported"]),
        ("M572 D0 S0.1", []),
        ("N-1 M110 N-1*125", []),
        ("G61", ["Error: Bad command: G61"]),
    ],
)
def test_rrf_warns_of_what_it_does_not_know(line, says):
    assert told("rrf", line)[0] == [*says, "ok"]


@pytest.mark.parametrize(
    ("line", "first"),
    [
        ("$I", "[VER:1.1h"),
        ("$G", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"),
        ("$$", "$0=10"),
        ("$#", "[G54:0.000,0.000,0.000]"),
        ("$N", "$N0="),
        ("$X", "[MSG:Caution: Unlocked]"),
        ("$", "[HLP:"),
        ("", "ok"),
        ("(nothing)", "ok"),
        ("; nothing", "ok"),
        ("$10=3", "ok"),
        ("N12 G0 X1", "ok"),
        ("G0 (fast) X1 ; there", "ok"),
        ("G4 P0.1", "ok"),
        ("G1 X3", "error:22"),
        ("G4 S1", "error:28"),
        ("G1 X1 E1 F100", "error:20"),
        ("G1 X2 F0", "error:22"),
        ("G2 X5 R1 F100", "error:33"),
        ("M104 S200", "error:20"),
        ("$77=1", "error:3"),
        ("%%", "error:1"),
    ],
)
def test_grbl_answers(line, first):
    said, player = told("grbl", line)
    assert said[0].startswith(first)
    assert said[-1] == (first if first.startswith("error") else "ok")
    assert len([text for text in said if text == "ok" or text.startswith("error")]) == 1
    assert player.state.x == (1 if "X1" in line and "E1" not in line else 0)


def test_grbls_status_is_the_machines_place_and_no_buffer():
    player = virtual.MACHINES["grbl"](PRINTER)
    player.receive(b"G92 X5\nG0 X7\n?", 0.0)
    *_, said = (data.decode() for _, data in player.answers())
    assert said == "<Idle|MPos:2.000,0.000,0.000|FS:0,0|WCO:-5.000,0.000,0.000>\n"
    player.receive(b"$10=2\n?", 0.0)
    *_, said = (data.decode() for _, data in player.answers())
    assert said.startswith("<Idle|WPos:7.000,0.000,0.000|Bf:15,128|")


@pytest.mark.parametrize(
    "status",
    [
        "<Idle|MPos:..000,0.000,0.000|FS:0,0>",
        "<Idle|MPos:1.000,2.000,3.000|WCO:-.-,0,0>",
        "<Idle|>",
    ],
)
def test_a_damaged_status_tells_no_place(status):
    protocol = GrblProtocol()
    protocol.open(0.0)
    protocol.feed(f"{status}\n".encode(), 0.0)
    assert protocol.ready
