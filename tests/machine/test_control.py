"""Pause, resume, abort, emergency stop, and what the machine is like after each."""

import dataclasses
import math

import pytest
from streams import PRINTER, gcode, program, send, stream

from fdjax.errors import StreamError
from fdjax.gcode.state import GcodeState
from fdjax.machine.program import Program
from fdjax.machine.protocols.marlin import MarlinProtocol
from fdjax.machine.stream import Stream
from fdjax.machine.virtual.marlin import VirtualMarlin
from fdjax.machine.virtual.port import VirtualPort


def at_line(order, number):
    """A run that is given an order when a line has been acknowledged; and its events."""
    events = []
    run = None

    def on_event(event):
        events.append(event)
        if event.kind == "line" and event.line >= number and order is not None:
            orders, run.order = run.order, None
            for name in orders or ():
                getattr(run.stream, name)()

    def begin(program, machine, **options):
        nonlocal run
        run = stream(program, machine, listen={"on_event": on_event}, **options)
        run.order = order
        return run

    return begin, events


@pytest.mark.parametrize("machine", ["marlin", "klipper", "rrf"])
def test_pause_and_resume_lay_down_what_the_file_says(tmp_path, machine):
    job = program(tmp_path, machine, 300)
    plain = send(job, machine)
    begin, events = at_line(("pause", "resume"), 150)
    paused = begin(job, machine)
    paused.stream.run()
    told = [event.text for event in events if event.kind == "state"]
    assert told == ["paused", "resumed"]
    roads = [move for move in paused.machine.print.moves() if move.start != move.end]
    assert roads == [move for move in plain.machine.print.moves() if move.start != move.end]
    state, wanted = paused.machine.state, plain.machine.state
    assert isinstance(state, GcodeState)
    assert state.position == pytest.approx(wanted.position, abs=1e-4)
    assert (state.nozzle, state.fan, state.speed) == (wanted.nozzle, wanted.fan, wanted.speed)


def test_a_pause_parks_off_the_part_and_cools_the_nozzle(tmp_path):
    stands = []

    def on_event(event):
        if event.kind == "line" and event.line >= 150 and not stands:
            run.stream.pause()

    run = stream(gcode(tmp_path / "job.gcode", 300), "marlin", listen={"on_event": on_event})
    read = run.port.read

    def look(seconds):
        data = read(seconds)
        state = run.machine.state
        if run.stream.paused and not run.stream.protocol.pending and state.nozzle < 200:
            stands.append((state.x, state.y, state.z, state.nozzle))
            run.stream.resume()
        return data

    run.port.read = look
    run.stream.run()
    assert stands[0] == (0.0, 220.0, 10.0, 140.0)
    assert run.machine.state.nozzle == 200


@pytest.mark.parametrize("machine", ["marlin", "klipper", "rrf", "grbl", "fdm1650"])
def test_abort_ends_with_heaters_and_flow_off(tmp_path, machine):
    begin, _ = at_line(("abort",), 150)
    run = begin(program(tmp_path, machine, 300), machine)
    with pytest.raises(StreamError, match="aborted") as caught:
        run.stream.run()
    assert 100 <= caught.value.line <= caught.value.sent + 1 < 250
    state = run.machine.state
    if isinstance(state, GcodeState):
        assert (state.nozzle, state.bed, state.fan, state.power) == (0, 0, 0, 0)
    else:
        assert state.outputs == ()
        assert state.path is None


class Impatient(VirtualPort):
    """A port whose user gives up after ten seconds."""

    order = staticmethod(lambda: None)

    def read(self, seconds):
        if self.now() > 10:
            self.order()
        return super().read(seconds)


@pytest.mark.parametrize(("parser", "most"), [(True, 30), (False, 200)])
def test_abort_breaks_off_a_heat_up_where_marlin_can(tmp_path, parser, most):
    path = tmp_path / "job.gcode"
    path.write_text("G28\nM109 S200\nG1 X10 F3000\n")
    events = []
    machine = VirtualMarlin(PRINTER, pace=1.0, emergency_parser=parser)
    port = Impatient(machine)
    stream = Stream(Program(path, PRINTER), port, MarlinProtocol(), on_event=events.append)
    port.order = stream.abort
    with pytest.raises(StreamError, match="aborted"):
        stream.run()
    assert port.now() < most
    assert any("cannot be interrupted" in event.text for event in events) is not parser
    assert machine.heaters["T0"].target == 0


def test_emergency_stop_halts_at_once(tmp_path):
    begin, _ = at_line(("emergency_stop",), 150)
    run = begin(gcode(tmp_path / "job.gcode", 300), "marlin")
    with pytest.raises(StreamError, match="emergency stop"):
        run.stream.run()
    assert all(heater.target == 0 for heater in run.machine.heaters.values())


def test_a_lost_port_that_comes_back_is_gone_on_with(tmp_path):
    run = send(gcode(tmp_path / "job.gcode", 500), "marlin", port={"accident": (200, "unplug")})
    assert run.error is None
    assert run.verdict() == "whole"


def test_a_lost_port_that_stays_away_ends_the_stream(tmp_path):
    port = {"accident": (200, "unplug"), "returns": False}
    run = send(gcode(tmp_path / "job.gcode", 500), "marlin", port=port)
    assert "has not come back" in str(run.error)
    assert run.verdict() == "stopped"


def test_events_tell_lines_layers_temperatures_and_the_end(tmp_path):
    events = []
    job = gcode(tmp_path / "job.gcode", 300)
    listen = {"starts": [50, 100, 200], "on_event": events.append}
    run = stream(job, "marlin", listen=listen, pace=0.2)
    run.stream.run()
    kinds = {event.kind for event in events}
    assert {"line", "layer", "temperature", "message", "done"} <= kinds
    assert [event.layer for event in events if event.kind == "layer"] == [1, 2, 3]
    assert events[-1].kind == "done"
    lines = [event.line for event in events]
    assert lines == sorted(lines)


def test_heaters_go_off_whatever_ends_the_stream(tmp_path):
    def on_event(event):
        if event.line >= 150:
            raise RuntimeError("a listener fails")

    run = stream(gcode(tmp_path / "job.gcode", 300), "marlin", listen={"on_event": on_event})
    with pytest.raises(RuntimeError, match="a listener fails"):
        run.stream.run()
    assert all(heater.target == 0 for heater in run.machine.heaters.values())


@pytest.mark.parametrize("machine", ["marlin", "klipper", "rrf"])
def test_temperatures_asked_for_after_a_pause_do_no_harm(tmp_path, machine):
    begin, events = at_line(("pause", "resume"), 100)
    run = begin(program(tmp_path, machine, 400), machine, pace=0.2)
    run.stream.run()
    assert sum(event.kind == "temperature" for event in events) > 3


def test_nobody_waits_for_ever(tmp_path):
    run = stream(
        gcode(tmp_path / "job.gcode", 300),
        "marlin",
        port={"accident": (150, "stall"), "seconds": 1e9},
    )
    with pytest.raises(StreamError, match="no answer"):
        run.stream.run()
    assert run.port.now() < 600


def test_a_pause_before_homing_moves_nothing(tmp_path):
    run = stream(gcode(tmp_path / "job.gcode", 300), "marlin")
    run.stream.pause()
    run.stream.resume()
    run.stream.run()
    assert run.verdict() == "whole"


def test_a_file_that_changes_during_the_print_stops_it(tmp_path):
    path = tmp_path / "job.gcode"

    def on_event(event):
        if event.kind == "line" and event.line >= 300 and path.stat().st_size > 100:
            path.write_text("G28\n")

    run = stream(gcode(path, 3000), "marlin", listen={"on_event": on_event})
    with pytest.raises(StreamError, match="has changed"):
        run.stream.run()
    assert all(heater.target == 0 for heater in run.machine.heaters.values())


def test_an_abort_in_inches_lifts_by_millimetres(tmp_path):
    path = tmp_path / "job.gcode"
    job = gcode(path, 300)
    path.write_text(path.read_text().replace("G1 F3000", "G0 Z10\nG20\nG1 X1 Y1 F100"))
    begin, _ = at_line(("abort",), 20)
    run = begin(Program(path, job.machine), "marlin")
    with pytest.raises(StreamError, match="aborted"):
        run.stream.run()
    assert run.machine.state.z == pytest.approx(15.0)


def test_one_lost_ok_after_a_heat_up_costs_seconds(tmp_path):
    lost = []

    class Deaf(VirtualPort):
        def read(self, seconds):
            data = super().read(seconds)
            if data.count(b"ok") == 1 and len(lost) < 20:
                lost.append(data)
                return b"" if len(lost) == 20 else data
            return data

    machine = VirtualMarlin(PRINTER, advanced=False, keep=True)
    job = gcode(tmp_path / "job.gcode", 200)
    port = Deaf(machine)
    Stream(job, port, MarlinProtocol()).run()
    assert len(lost) == 20
    assert port.now() < 400


def test_a_machine_that_stopped_itself_is_no_good_print(tmp_path):
    job = gcode(tmp_path / "job.gcode", 200)
    run = stream(job, "marlin")
    begin = run.machine._begin

    def stopped(line):
        if line.startswith("N60 "):
            run.machine.say("Error:Printer stopped due to errors. Fix the error and use M999")
        return begin(line)

    run.machine._begin = stopped
    with pytest.raises(StreamError, match="halted"):
        run.stream.run()


def test_a_dispenser_is_off_during_a_pause_homed_or_not(tmp_path):
    path = tmp_path / "job.gcode"
    job = gcode(path, 60, extruder=False)
    path.write_text("G21\nG90\nG1 F3000\nM4 S500\n" + "G1 X10\nG1 X20\n" * 30)
    begin, _ = at_line(("pause", "resume"), 20)
    run = begin(Program(path, job.machine), "grbl")
    run.stream.run()
    settings = [text for text in run.machine.executed if text.startswith("M")]
    assert settings == ["M4 S500", "M5", "M4 S500"]


def towers(path, firmware="marlin"):
    """Two objects printed one after the other: the first one is 30 mm high."""
    text = ["G21", "G90", "M83", "M104 S200", "G28", "M109 S200"]
    for x, height in ((20, 30.0), (120, 1.0)):
        text += ["G1 Z40 F600"]
        for k in range(1, 6):
            z = height * k / 5
            text += [f";LAYER:{k}", f"G0 X{x} Y{x} F6000", f"G1 Z{z:g} F600"]
            text += [f"G1 X{x + 10} E1 F1200", f"G1 X{x} E1", f"G1 Y{x + 10} E1"]
    path.write_text("\n".join([*text, "M104 S0"]) + "\n")
    stream = dataclasses.replace(PRINTER.stream, firmware=firmware)
    return Program(path, dataclasses.replace(PRINTER, stream=stream))


@pytest.mark.parametrize("machine", ["marlin", "klipper", "rrf"])
def test_a_pause_travels_above_all_that_stands(tmp_path, machine):
    job = towers(tmp_path / "job.gcode", machine)
    begin, _ = at_line(("pause", "resume"), 45)
    run = begin(job, machine)
    made, make = [], run.machine._make
    run.machine._make = lambda moves: made.extend(moves) or make(moves)
    run.stream.run()
    paused = [k for k, move in enumerate(made) if move.end[:2] == (0, 220)]
    assert made[paused[0]].end[2] == pytest.approx(40)  # 30 and the lift
    assert made[paused[0]].start[2] == pytest.approx(40)
    assert made[paused[0] + 1].end[2] == pytest.approx(40)


@pytest.mark.parametrize("machine", ["marlin", "klipper", "rrf"])
def test_an_abort_ends_above_all_that_stands(tmp_path, machine):
    begin, _ = at_line(("abort",), 45)
    run = begin(towers(tmp_path / "job.gcode", machine), machine)
    with pytest.raises(StreamError, match="aborted"):
        run.stream.run()
    assert run.machine.state.z == pytest.approx(35)


def test_going_on_pushes_what_a_pause_pulled_back(tmp_path):
    """Marlin's G90 makes E absolute; whatever was said in the pause, modes are said anew."""
    path = tmp_path / "job.gcode"
    job = gcode(path, 100)
    text = path.read_text().replace("G1 F3000", "M82\nG92 E21\nG1 F3000\nG1 X1 Y1 Z1 E21", 1)
    path.write_text(text)
    job = Program(path, job.machine)
    begin, _ = at_line(("pause",), 60)
    run = begin(job, "marlin")
    pauses = []

    def interfere(seconds, read=run.port.read):
        data = read(seconds)
        if run.stream.paused and not run.stream.protocol.pending and not pauses:
            pauses.append(run.machine.state.e)
            run.machine.state.run("G90")
            run.machine.state.run("G91")
            run.stream.resume()
        return data

    run.port.read = interfere
    run.stream.run()
    plain = send(job, "marlin")
    assert run.machine.print.volume == pytest.approx(plain.machine.print.volume, abs=1e-6)
    assert run.machine.state.e == pytest.approx(plain.machine.state.e)


@pytest.mark.parametrize("motion", ["G1", "G3"])
def test_words_alone_go_on_with_their_motion_after_a_pause(tmp_path, motion):
    path = tmp_path / "job.gcode"
    head = "G21\nG90\nM83\nM104 S200\nG28\nM109 S200\nG1 X50 Y50 Z1 F3000\n"
    words = "I5 J0 X60" if motion == "G3" else "X60"
    path.write_text(head + f"{motion} {words} E1\n" + f"{words} E1\nG1 X50\n" * 2 + "M117 x\n" * 9)
    text = path.read_text().replace("G1 X50\n", "X50 I-5\n" if motion == "G3" else "X50\n")
    path.write_text(text)
    job = Program(path, PRINTER)
    plain = send(job, "marlin")
    for line in (8, 9, 10):
        begin, _ = at_line(("pause", "resume"), line)
        run = begin(job, "marlin")
        run.stream.run()
        roads = [[m for m in r.machine.print.moves() if m.start != m.end] for r in (plain, run)]
        assert roads[0] == roads[1]


def test_volumetric_filament_is_pulled_back_by_its_length(tmp_path):
    path = tmp_path / "job.gcode"
    job = gcode(path, 100)
    path.write_text(path.read_text().replace("G1 F3000", "M200 D1.75\nG0 Z1\nG1 X1 Y1 F3000", 1))
    begin, _ = at_line(("pause", "resume"), 60)
    run = begin(Program(path, job.machine), "marlin")
    run.stream.run()
    back = [move.volume for move in run.machine.print.moves() if move.volume < 0]
    assert back == pytest.approx([-2 * math.pi / 4 * 1.75**2], rel=1e-5)
