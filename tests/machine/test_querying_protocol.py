"""Where answers to lines without numbers do not come: what the position tells, line by line."""

import pytest
from streams import gcode, send

from fdjax.errors import StreamError
from fdjax.machine.entry import Entry
from fdjax.machine.program import Program
from fdjax.machine.protocols.klipper import KlipperProtocol
from fdjax.machine.protocols.rrf import RrfProtocol

START, END = (0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0)


class Talk:
    """A protocol after its greeting, and its clock."""

    def __init__(self, protocol):
        self.now = 0.0
        self.protocol = protocol
        protocol.open(self.now)
        self.sent()
        self.hear("ok", "ok", "FIRMWARE_NAME: Klipper", "ok")
        assert protocol.ready

    def hear(self, *answers):
        self.protocol.feed("".join(f"{answer}\n" for answer in answers).encode(), self.now)

    def push(self, text="G1 X1 E1", before=START, after=END, **more):
        self.protocol.push(Entry(text, 5, before=before, after=after, **more), self.now)
        return self.sent()

    def sent(self):
        """Commands that were sent, without frames."""
        data = bytes(self.protocol.out).decode()
        self.protocol.out.clear()
        lines = [line.partition("*")[0] for line in data.split("\n") if line]
        return [line.partition(" ")[2] if line[0] == "N" else line for line in lines]

    def wait(self, seconds):
        self.now += seconds
        self.protocol.tick(self.now)
        return self.sent()

    def report(self, place):
        """Answer position queries until there are none left; what is sent then."""
        sent = ["M114"]
        while sent == ["M114"]:
            x, y, z, e = place
            self.hear(f"X:{x:.3f} Y:{y:.3f} Z:{z:.3f} E:{e:.3f}", "ok")
            sent = self.sent()
        return sent


def test_a_line_that_was_dropped_is_sent_again():
    talk = Talk(RrfProtocol())
    assert talk.push() == ["G1 X1 E1"]
    assert talk.wait(4) == ["M114"]
    assert talk.report(START) == ["G1 X1 E1"]


def test_a_line_that_was_run_is_not():
    talk = Talk(RrfProtocol())
    talk.push()
    talk.wait(4)
    assert talk.report(END) == []
    assert not talk.protocol.pending


def test_a_machine_that_stands_elsewhere_ends_the_stream():
    talk = Talk(RrfProtocol())
    talk.push()
    talk.wait(4)
    with pytest.raises(StreamError, match=r"the machine is at 7\.000"):
        talk.report((7.0, 0.0, 0.0, 0.0))


def test_where_the_position_cannot_tell_there_is_no_blind_retry():
    talk = Talk(RrfProtocol())
    talk.push("G1 E0.0001", START, (0.0, 0.0, 0.0, 0.0001))
    talk.wait(4)
    with pytest.raises(StreamError, match="does not tell"):
        talk.report(START)


def test_a_setting_is_said_again():
    talk = Talk(RrfProtocol())
    talk.push("M106 S100", START, START, repeatable=True)
    talk.wait(4)
    assert talk.report(START) == ["M106 S100"]


def test_a_machine_that_never_runs_a_line_ends_the_stream():
    talk = Talk(RrfProtocol())
    talk.push()

    def refuse():
        for _ in range(100):
            if talk.wait(10) == ["M114"]:
                talk.report(START)

    with pytest.raises(StreamError, match="does not run"):
        refuse()


def test_one_damaged_report_is_no_bad_news():
    talk = Talk(KlipperProtocol())
    talk.push()
    talk.wait(11)
    talk.hear("X:9.000 Y:0.000 Z:0.000 E:1.000", "ok")
    assert talk.sent() == ["M114"]
    assert talk.report(END) == []
    assert not talk.protocol.pending


@pytest.mark.parametrize("answer", ["!! Move out of range", "// Klipper state: Shutdown"])
def test_klipper_says_what_is_fatal_although_an_ok_follows(answer):
    talk = Talk(KlipperProtocol())
    talk.push()
    with pytest.raises(StreamError, match=r"refused|shut down"):
        talk.hear(answer, "ok")


def test_filament_summed_in_single_precision_is_no_other_place():
    talk = Talk(KlipperProtocol())
    e = 0.0
    for _ in range(300):
        talk.push("G1 X1 E30", (0.0, 0.0, 0.0, e), (0.0, 0.0, 0.0, e + 30))
        e += 30
        talk.hear("ok")
        talk.protocol.tick(talk.now)
        if talk.sent() == ["M114"]:
            drifted = e * (1 + 2e-6)
            talk.hear(f"X:0.000 Y:0.000 Z:0.000 E:{drifted:.3f}", "ok")
    assert talk.protocol.proven > 200


@pytest.mark.parametrize("line", [6, 100])
def test_a_refused_line_is_named(tmp_path, line):
    job = gcode(tmp_path / "job.gcode", 200)
    lines = job.path.read_text().splitlines()
    lines[line - 1] = "G1 X999 Y999" if line > 6 else "G1 X1"  # before homing, or out of its room
    job.path.write_text("\n".join(lines) + "\n")
    run = send(Program(job.path, job.machine), "klipper")
    assert "refused a line: !!" in str(run.error)
    assert run.error.line == line


@pytest.mark.parametrize(
    ("answer", "values"),
    [
        ("ok B:60.0 /60.0 T0:205.0 /210.0", {"B": (60, 60), "T0": (205, 210)}),
        ("ok T:0", None),
        (
            "B:21.0 /0.0 T0:20.5 /180.0 T1:19.0 /0.0",
            {"B": (21, 0), "T0": (20.5, 180), "T1": (19, 0)},
        ),
        ("ok C:35.0 /40.0 T0:1.0 /2.0 T11:3.0 /4.0", {"C": (35, 40), "T0": (1, 2), "T11": (3, 4)}),
    ],
)
def test_temperatures_of_all_tools_are_noted(answer, values):
    talk = Talk(KlipperProtocol())
    talk.push("M105")
    talk.protocol.notes.clear()
    talk.hear(answer)
    noted = [note.values for note in talk.protocol.notes if note.kind == "temperature"]
    assert noted == ([] if values is None else [values])
