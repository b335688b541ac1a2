"""Pause, resume, abort, emergency stop, and what the machine is like after each."""

import pytest
from streams import gcode, program, send, stream

from fdjax.errors import StreamError
from fdjax.machine.gcode_state import GcodeState


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
        run = stream(program, machine, on_event=on_event, **options)
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
    begin, _ = at_line(("pause",), 150)
    run = begin(gcode(tmp_path / "job.gcode", 300), "marlin")
    lines = run.stream._control.park(run.stream.state, run.stream.program.machine)
    assert lines[0] == "M400"
    assert any(line.startswith("G1 E-") for line in lines)
    assert lines.index("G90") < next(k for k, line in enumerate(lines) if line.startswith("G1 Z"))


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


def test_abort_breaks_off_a_heat_up_where_marlin_can(tmp_path):
    path = tmp_path / "job.gcode"
    path.write_text("G28\nM109 S200\nG1 X10 F3000\n")
    job = gcode(tmp_path / "other.gcode", 10).__class__(path, gcode(path, 10).machine)
    path.write_text("G28\nM109 S200\nG1 X10 F3000\n")
    for parser, most in ((True, 30.0), (False, 200.0)):
        events = []
        run = stream(job, "marlin", pace=1.0, emergency_parser=parser, on_event=events.append)
        run.port._realtime = False
        waiting = run.port.read
        run.port.read = lambda seconds, read=waiting, run=run: _aborting(run, read, seconds)
        with pytest.raises(StreamError, match="aborted"):
            run.stream.run()
        assert run.port.now() < most
        said = any("cannot be interrupted" in event.text for event in events)
        assert said is not parser
        assert run.machine.heaters["T"].target == 0


def _aborting(run, read, seconds):
    if 10 < run.port.now() and not run.stream._aborting:
        run.stream.abort()
    return read(seconds)


def test_emergency_stop_halts_at_once(tmp_path):
    begin, _ = at_line(("emergency_stop",), 150)
    run = begin(gcode(tmp_path / "job.gcode", 300), "marlin")
    with pytest.raises(StreamError, match="emergency stop"):
        run.stream.run()
    assert all(heater.target == 0 for heater in run.machine.heaters.values())


def test_a_lost_port_that_comes_back_is_gone_on_with(tmp_path):
    run = send(gcode(tmp_path / "job.gcode", 500), "marlin", accident=(200, "unplug"))
    assert run.error is None
    assert run.verdict() == "whole"


def test_a_lost_port_that_stays_away_ends_the_stream(tmp_path):
    run = send(
        gcode(tmp_path / "job.gcode", 500), "marlin", accident=(200, "unplug"), returns=False
    )
    assert "has not come back" in str(run.error)
    assert run.verdict() == "stopped"


def test_events_tell_lines_layers_temperatures_and_the_end(tmp_path):
    events = []
    job = gcode(tmp_path / "job.gcode", 300)
    run = stream(job, "marlin", starts=[50, 100, 200], on_event=events.append, pace=0.2)
    run.stream.run()
    kinds = {event.kind for event in events}
    assert {"line", "layer", "temperature", "message", "done"} <= kinds
    assert [event.layer for event in events if event.kind == "layer"] == [1, 2, 3]
    assert events[-1].kind == "done"
    lines = [event.line for event in events]
    assert lines == sorted(lines)
