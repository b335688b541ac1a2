"""The failures that senders of numbered lines are known for, one by one, without a machine."""

import pytest

from fdjax.errors import StreamError
from fdjax.machine.entry import Entry
from fdjax.machine.protocols.base import checksum, is_ok, temperatures
from fdjax.machine.protocols.marlin import BUFFER, MarlinProtocol


class Talk:
    """A protocol and its clock."""

    def __init__(self, *, ready=True):
        self.now = 0.0
        self.protocol = MarlinProtocol()
        self.protocol.open(self.now)
        self.sent()
        if ready:
            self.hear("ok")
            self.sent()
            self.hear("FIRMWARE_NAME:Marlin 2.1", "Cap:EMERGENCY_PARSER:1", "ok")

    def hear(self, *answers):
        self.protocol.feed("".join(f"{answer}\n" for answer in answers).encode(), self.now)

    def push(self, text, line=0, **more):
        assert self.protocol.room(text)
        self.protocol.push(Entry(text, line, **more), self.now)
        return self.sent()

    def sent(self):
        data = bytes(self.protocol.out).decode()
        self.protocol.out.clear()
        return [line for line in data.split("\n") if line]

    def wait(self, seconds):
        """Let time pass; what is sent meanwhile."""
        self.now += seconds
        self.protocol.tick(self.now)
        return self.sent()


def repeat(count, act):
    for _ in range(count):
        act()


def framed(number, text):
    body = f"N{number} {text}"
    return f"{body}*{checksum(body)}"


def test_frames_of_the_reference():
    assert framed(7, "M105") == "N7 M105*32"
    assert framed(13, "G1 X1 Y20 Z0.35 F5000.0") == "N13 G1 X1 Y20 Z0.35 F5000.0*55"
    assert framed(65055, "G0 X138.513 Y158.877 F9000") == "N65055 G0 X138.513 Y158.877 F9000*77"
    assert framed(0, "M110 N0") == "N0 M110 N0*125"


def test_greeting_resets_the_numbers_and_proves_that_they_hold():
    talk = Talk(ready=False)
    assert not talk.protocol.ready
    talk.hear("ok")
    assert talk.sent() == [framed(1, "M115")]
    talk.hear("ok")
    assert talk.protocol.pending, "an ok alone proves nothing"
    talk.hear("FIRMWARE_NAME:Marlin 2.1", "Cap:EMERGENCY_PARSER:1", "ok")
    assert not talk.protocol.pending
    assert talk.protocol.facts["Cap:EMERGENCY_PARSER"] == "1"


def test_a_board_that_resets_at_opening_is_greeted_again():
    talk = Talk(ready=False)
    talk.hear("ok")
    assert talk.sent() == [framed(1, "M115")]
    talk.hear("start")
    assert talk.sent() == [framed(0, "M110 N0")]
    talk.hear("ok")
    assert talk.sent() == [framed(1, "M115")]
    talk.hear("FIRMWARE_NAME:Marlin 2.1", "ok")
    assert talk.push("G1 X1") == [framed(2, "G1 X1")]


def test_a_lost_ok_is_asked_for_and_not_waited_for():
    talk = Talk()
    assert talk.push("G1 X1") == [framed(2, "G1 X1")]
    assert talk.wait(11) == [framed(2, "G1 X1")]
    talk.hear("Error:Line Number is not Last Line Number+1, Last Line: 2", "Resend: 3", "ok")
    talk.wait(0.2)
    assert not talk.protocol.pending
    assert talk.protocol.proven == 2
    assert talk.push("G1 X2") == [framed(3, "G1 X2")]


def test_wait_says_that_an_ok_was_lost():
    talk = Talk()
    talk.push("G1 X1")
    talk.hear("wait")
    assert talk.wait(0.2) == [framed(2, "G1 X1")]


def test_no_answer_at_all_ends_the_stream():
    talk = Talk()
    talk.push("G1 X1")
    with pytest.raises(StreamError, match="no answer"):
        repeat(20, lambda: talk.wait(60))


def test_an_ok_inside_a_report_is_none():
    talk = Talk()
    talk.push("G1 X1")
    talk.hear("T:200.0 /200.0 ok B:60.0 /60.0")
    assert len(talk.protocol.pending) == 1
    assert is_ok("ok T:200.0 /200.0")
    assert not is_ok("okay")


def test_busy_and_heating_keep_it_patient():
    talk = Talk()
    talk.push("M109 S200", waits=1800.0)
    for _ in range(30):
        assert talk.wait(9) == []
        talk.hear("echo:busy: processing")
    for _ in range(30):
        assert talk.wait(9) == []
        talk.hear(" T:150.0 /200.0 B:60.0 /60.0 @:127")
    assert talk.protocol.notes[-1].values["T"] == (150.0, 200.0)


def test_a_silent_heat_up_is_waited_for():
    talk = Talk()
    talk.push("M109 S200", waits=1800.0)
    assert not talk.protocol.room("G1 X1"), "nothing stands behind it"
    assert talk.wait(600) == []


def test_a_resend_goes_back_one_by_one():
    talk = Talk()
    talk.hear("ok")
    talk.push("G1 X1")
    talk.hear("ok N2 P15 B3")
    talk.push("G1 X2")
    talk.push("G1 X3")
    talk.push("G1 X4")
    talk.hear("Error:checksum mismatch, Last Line: 2", "Resend: 3", "ok")
    assert not talk.protocol.room("G1 X5")
    assert talk.wait(0.2) == [framed(3, "G1 X2")]
    talk.hear("ok N3 P15 B3")
    assert talk.sent() == [framed(4, "G1 X3")]
    talk.hear("ok N4 P15 B3")
    assert talk.sent() == [framed(5, "G1 X4")]
    talk.hear("ok N5 P15 B3")
    assert talk.push("G1 X5") == [framed(6, "G1 X5")]


def test_a_storm_of_resends_brings_one_line():
    talk = Talk()
    talk.push("G1 X1")
    for _ in range(10):
        talk.hear("Error:checksum mismatch, Last Line: 1", "Resend: 2", "ok")
        assert talk.wait(0.05) == []
    assert talk.wait(0.2) == [framed(2, "G1 X1")]


def test_resends_without_end_stop_the_stream():
    talk = Talk()
    talk.push("G1 X1")

    def ask_again():
        talk.hear("Error:checksum mismatch, Last Line: 1", "Resend: 2", "ok")
        talk.wait(0.2)

    with pytest.raises(StreamError, match="again and again"):
        repeat(100, ask_again)


@pytest.mark.parametrize("number", ["034497", "99999", "7", "0"])
def test_a_resend_with_another_number_than_the_error_is_not_believed(number):
    talk = Talk()
    talk.push("G1 X1")
    talk.hear("Error:checksum mismatch, Last Line: 1", f"Resend: {number}", "ok")
    assert talk.wait(0.2) == [framed(2, "G1 X1")], "the oldest line asks for the truth"


def test_a_resend_without_an_ok_after_it():
    talk = Talk()
    talk.push("G1 X1")
    talk.hear("Error:checksum mismatch, Last Line: 1", "Resend: 2")
    assert talk.wait(0.2) == [framed(2, "G1 X1")]


def test_a_made_up_ok_is_taken_back():
    talk = Talk()
    talk.push("G1 X1")
    talk.hear("ok")
    assert not talk.protocol.pending
    talk.push("G1 X2")
    talk.hear("Error:Line Number is not Last Line Number+1, Last Line: 1", "Resend: 2", "ok")
    assert talk.wait(0.2) == [framed(2, "G1 X1")]
    talk.hear("ok")
    assert talk.sent() == [framed(3, "G1 X2")]


@pytest.mark.parametrize(
    "answers",
    [
        ("Error:Line Number is not Last Line Number+1, Last Line: 2", "Resend: 3", "ok"),
        ("Error: expected line 3 got 2", "Resend:3"),
    ],
)
def test_the_end_is_proven_by_the_line_that_was_expected(answers):
    talk = Talk()
    talk.push("G1 X1")
    talk.hear("ok")
    assert not talk.protocol.finished
    talk.protocol.finish(talk.now)
    assert talk.sent() == [framed(2, "G1 X1")]
    talk.hear(*answers)
    talk.wait(0.2)
    assert talk.protocol.finished


def test_the_end_is_proven_to_kin_that_name_no_last_line():
    talk = Talk()
    talk.push("G1 X1")
    talk.hear("ok")
    for _ in range(2):
        talk.protocol.finish(talk.now)
        assert talk.sent() == [framed(2, "G1 X1")]
        assert not talk.protocol.finished
        talk.hear("Error: wrong line", "Resend:3")
        talk.wait(0.2)
    assert talk.protocol.finished


def test_reports_that_come_by_themselves_do_not_hide_a_lost_ok():
    talk = Talk()
    talk.push("G1 X1")
    resent = []
    for _ in range(20):
        resent += talk.wait(1)
        talk.hear("T:200.0 /200.0 B:60.0 /60.0")
    assert resent[0] == framed(2, "G1 X1")


def test_an_answer_to_m105_is_proof():
    talk = Talk()
    talk.push("G1 X1", 7)
    talk.hear("ok")
    talk.push("M105")
    talk.hear("ok T:200.0 /200.0")
    assert (talk.protocol.proven, talk.protocol.proven_line) == (3, 7)


def test_a_reboot_of_such_kin_ends_the_stream():
    talk = Talk()
    talk.push("G1 X1")
    with pytest.raises(StreamError, match="rebooted"):
        talk.hear("Error: expected line 1 got 2", "Resend:1")


@pytest.mark.parametrize(
    "answers",
    [
        ["start"],
        ["Error:Line Number is not Last Line Number+1, Last Line: 0", "Resend: 1", "ok"],
    ],
)
def test_a_reboot_ends_the_stream(answers):
    talk = Talk()
    talk.push("G1 X1")
    with pytest.raises(StreamError, match="rebooted"):
        talk.hear(*answers)


def test_a_halted_machine_ends_the_stream():
    talk = Talk()
    talk.push("G1 X1")
    with pytest.raises(StreamError, match="halted"):
        talk.hear("Error:Printer halted. kill() called!")


@pytest.mark.parametrize("answer", ["echo: cold extrusion prevented", 'echo:Unknown command: "G7"'])
def test_what_marlin_only_echoes_is_a_fault(answer):
    talk = Talk()
    talk.hear(answer)
    assert talk.protocol.notes[-1].kind == "fault"


def test_lines_in_flight_fit_the_receive_buffer():
    talk = Talk()
    talk.push("G1 X1")
    talk.hear("ok N2 P15 B7")
    text, count = "G1 X100.000 Y100.000 E1.00000", 0
    total = 0
    while talk.protocol.room(text):
        total += sum(len(line) + 1 for line in talk.push(text))
        count += 1
    assert 1 < count <= 7
    assert total <= BUFFER


def cut(talk, where):
    """A line comes in two pieces; the machine stands somewhere."""
    talk.push("G1 X1 E1", before=(0, 0, 0, 0), after=(1, 0, 0, 1))
    talk.hear("Error:No Checksum with line number, Last Line: 1", "Resend: 2", "ok")
    assert talk.wait(0.2) == [framed(2, "M114")]
    talk.hear(where, "ok")
    assert talk.sent() == [framed(3, "M114")]
    talk.hear(where, "ok")
    return talk.sent()


def test_a_line_cut_in_two_is_not_run_twice():
    assert cut(Talk(), "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0") == [framed(4, "G1 X1 E1")]
    talk = Talk()
    assert cut(talk, "X:1.00 Y:0.00 Z:0.00 E:1.00 Count X:80") == []
    assert not talk.protocol.pending
    with pytest.raises(StreamError, match="elsewhere"):
        cut(Talk(), "X:5.00 Y:0.00 Z:0.00 E:0.00 Count X:400")


def test_temperatures_are_read():
    assert temperatures("ok T:20.5 /0.0 B:21.0 /60.0 T0:20.5 /0.0 @:0") == {
        "T": (20.5, 0.0),
        "B": (21.0, 60.0),
        "T0": (20.5, 0.0),
    }
