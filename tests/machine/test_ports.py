"""Serial ports: what can be wrong with one is said in a line, and two senders keep apart."""

import contextlib
import os
import socket
import threading
import time
import types
from dataclasses import replace

import pytest
import serial
from serial import rfc2217
from streams import FIRMWARE, PRINTER, STRATASYS, gcode, program, rates_once, units

from fdjax.errors import InputError
from fdjax.machine import connect, serial_port, virtual
from fdjax.machine.port import PortLost
from fdjax.machine.ports import open_port
from fdjax.machine.program import Program
from fdjax.machine.protocols import protocol
from fdjax.machine.serial_port import SerialPort
from fdjax.machine.stream import Stream
from fdjax.machine.virtual.serve import PseudoTerminal

DEPRECATED = pytest.mark.filterwarnings(r"ignore:set\w+\(\) is deprecated")
"""What pyserial 3.5 does in its rfc2217."""


@pytest.fixture
def line():
    """A pseudo-terminal that is served by nobody, and the far end's descriptor."""
    terminal = PseudoTerminal()
    yield terminal
    terminal.close()


class Served:
    """A virtual machine at a pseudo-terminal."""

    def __init__(self, name):
        profile = STRATASYS if name == "fdm1650" else PRINTER
        self.machine = virtual.MACHINES[name](profile, keep=True)
        self.terminal = PseudoTerminal()
        self.over = False
        self.thread = threading.Thread(
            target=self.terminal.serve, args=(self.machine,), kwargs={"until": lambda: self.over}
        )
        self.thread.start()

    def close(self):
        self.over = True
        self.thread.join()
        self.terminal.close()


@pytest.mark.parametrize("name", virtual.MACHINES)
def test_every_protocol_over_a_serial_line(tmp_path, name):
    served = Served(name)
    job = program(tmp_path, name, 200)
    # A pseudo-terminal has 8 bits and no parity.
    plain = replace(job.machine.stream, bytesize=8, parity="none")
    job = Program(job.path, replace(job.machine, stream=plain))
    try:
        port = open_port(served.terminal.name, job.machine)
        stream = Stream(job, port, protocol(FIRMWARE[name], job.machine.stream))
        stream.run()
        port.close()
    finally:
        served.close()
    assert stream.protocol.proven_line == max(command.line for command in job.commands())
    ran = [t for t in served.machine.executed if not t.startswith(("M11", "M575", "M105"))]
    wanted = [text for text, _ in units(job)]
    if name == "fdm1650":
        ran, wanted = rates_once(ran), rates_once(wanted)
    assert "".join(ran) == "".join(wanted)


@pytest.mark.parametrize("name", [n for n in virtual.MACHINES if n != "fdm1650"])
def test_the_firmware_is_recognised(name):
    port = virtual.open_port(name, PRINTER)
    assert connect.recognise(port) == FIRMWARE[name]


def test_sml_is_recognised_by_its_enquiry():
    assert connect.recognise(virtual.open_port("fdm1650", STRATASYS)) == "sml"


def test_a_port_that_is_not_there_lists_those_that_are():
    with pytest.raises(InputError, match=r"/dev/nowhere: there is none.*virtual:marlin"):
        open_port("/dev/nowhere", PRINTER)
    with pytest.raises(InputError, match="/dev/null: is no serial port"):
        open_port("/dev/null", PRINTER)
    with pytest.raises(InputError, match="no such machine; known are marlin"):
        open_port("virtual:reprap", PRINTER)
    with pytest.raises(InputError, match="unknown setting 'speed'"):
        open_port("virtual:marlin?speed=3", PRINTER)


def test_no_permission_says_the_remedy(line, monkeypatch):
    import serial

    def refuse(self):
        raise serial.SerialException(13, "could not open port: Permission denied")

    monkeypatch.setattr(serial.Serial, "open", refuse)
    with pytest.raises(InputError, match="usermod -aG dialout"):
        open_port(line.name, PRINTER)


def test_a_second_sender_is_kept_out(line):
    first = SerialPort(line.name, PRINTER.stream)
    with pytest.raises(InputError, match="another program is using it"):
        SerialPort(line.name, PRINTER.stream)
    first.close()
    SerialPort(line.name, PRINTER.stream).close()


def test_dtr_stays_low_so_that_boards_do_not_reset(line, monkeypatch):
    import serial

    opened = []
    open_line = serial.Serial.open

    def note(self):
        opened.append((self.dtr, self.exclusive))
        open_line(self)

    monkeypatch.setattr(serial.Serial, "open", note)
    SerialPort(line.name, PRINTER.stream).close()
    assert opened == [(False, True)]


def test_a_line_that_goes_away_is_a_lost_port():
    terminal = PseudoTerminal()
    port = SerialPort(terminal.name, PRINTER.stream)
    terminal.close()

    def use():
        for _ in range(20):
            port.write(b"M105\n")
            port.read(0.05)

    with pytest.raises(PortLost, match="is gone"):
        use()


def test_a_port_that_returns_under_another_name_is_found_by_its_number(monkeypatch):
    from types import SimpleNamespace

    first, second = PseudoTerminal(), PseudoTerminal()
    here = [SimpleNamespace(device=first.name, serial_number="A1", description="")]
    monkeypatch.setattr(serial_port, "present", lambda: here)
    port = SerialPort(first.name, PRINTER.stream)
    first.close()
    here.clear()
    assert not port.reopen()
    here.append(SimpleNamespace(device="/dev/other", serial_number="B2", description=""))
    here.append(SimpleNamespace(device=second.name, serial_number="A1", description=""))
    assert port.reopen()
    port.write(b"x")
    assert os.read(second._master, 1) == b"x"
    port.close()
    second.close()


class Mute(virtual.VirtualPort):
    """A port at which something else than the machine answers."""

    said = b""

    def read(self, seconds):
        super().read(seconds)
        return self.said


@pytest.mark.parametrize(
    ("said", "message"),
    [
        (b"", "no answer from marlin: is the machine on"),
        (b"\xf1\x80\xff\x00\xe3\x9c" * 3, "the baud rate is another one"),
        (b"Grbl 1.1h ['$' for help]\nerror:20\n", "no machine that speaks marlin"),
    ],
)
def test_who_does_not_answer_as_expected_is_not_sent_to(tmp_path, said, message):
    port = Mute(virtual.VirtualMarlin(PRINTER))
    port.said = said
    job = gcode(tmp_path / "job.gcode", 50)
    with pytest.raises(InputError, match=message):
        Stream(job, port, protocol("marlin", PRINTER.stream)).run()


def test_another_machine_than_the_profiles_is_refused(tmp_path):
    job = gcode(tmp_path / "job.gcode", 50)
    port = virtual.open_port("klipper", PRINTER)
    with pytest.raises(InputError, match="says it runs 'Klipper', but marlin"):
        Stream(job, port, protocol("marlin", PRINTER.stream)).run()


@pytest.mark.skipif("FDJAX_TEST_PORT" not in os.environ, reason="no printer at FDJAX_TEST_PORT")
def test_a_printer_of_somebody_else_takes_a_file(tmp_path):
    """FDJAX_TEST_PORT names its port, FDJAX_TEST_FIRMWARE what it speaks (default: recognised)."""
    port = open_port(os.environ["FDJAX_TEST_PORT"], PRINTER)
    firmware = os.environ.get("FDJAX_TEST_FIRMWARE") or connect.recognise(port)
    job = gcode(tmp_path / "job.gcode", 300, extruder=False)
    stream = Stream(job, port, protocol(firmware, PRINTER.stream))
    stream.run()
    port.close()
    assert stream.protocol.proven_line == 300


class Networked:
    """A virtual machine behind a socket, plain or as RFC 2217 has it."""

    def __init__(self, name, scheme, profile=PRINTER):
        self.machine = virtual.MACHINES[name](profile, keep=True, record=True)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._over = False
        self._scheme = scheme
        self.cut_after = None  # bytes taken, after which the connection is closed once
        self.name = f"{scheme}://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self):
        self._listener.settimeout(0.05)
        began = time.monotonic()
        while not self._over:
            with contextlib.suppress(TimeoutError):
                line, _ = self._listener.accept()
                with line:
                    self._talk(line, began)

    def _talk(self, line, began):
        line.settimeout(0.005)
        manager = None
        if self._scheme == "rfc2217":
            out = types.SimpleNamespace(write=line.sendall)
            manager = rfc2217.PortManager(serial.serial_for_url("loop://"), out)
        while not self._over:
            data = b""
            with contextlib.suppress(TimeoutError):
                data = line.recv(4096)
                if not data:
                    return
            data = b"".join(manager.filter(data)) if manager else data
            now = time.monotonic() - began
            self.machine.receive(data, now)
            self.machine.advance(now)
            for _, answer in self.machine.answers():
                line.sendall(b"".join(manager.escape(answer)) if manager else answer)
            if self.cut_after is not None:
                self.cut_after -= len(data)
                if self.cut_after < 0:
                    self.cut_after = None
                    return

    def close(self):
        self._over = True
        self._thread.join()
        self._listener.close()


@pytest.fixture(params=["socket", "rfc2217"])
def networked(request):
    served = Networked("marlin", request.param)
    yield served
    served.close()


@DEPRECATED
def test_a_machine_in_the_network_prints(tmp_path, networked):
    job = gcode(tmp_path / "job.gcode", 150)
    stream = Stream.open(job.path, PRINTER, networked.name)
    stream.pause()
    stream.resume()
    stream.run()
    stream.port.close()
    ran = [text for text in networked.machine.executed if not text.startswith(("M11", "M105"))]
    assert ran == [command.text for command in job.commands()]


@DEPRECATED
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a socket, by it
def test_a_connection_that_breaks_is_opened_again(tmp_path, networked):
    job = gcode(tmp_path / "job.gcode", 150)
    networked.cut_after = 2500
    stream = Stream.open(job.path, PRINTER, networked.name)
    stream.run()
    stream.port.close()
    assert networked.cut_after is None
    ran = [text for text in networked.machine.executed if not text.startswith(("M11", "M105"))]
    assert ran == [command.text for command in job.commands()]


def test_a_spied_line_prints(tmp_path, capsys):
    served = Served("marlin")
    try:
        job = gcode(tmp_path / "job.gcode", 60)
        stream = Stream.open(job.path, PRINTER, f"spy://{served.terminal.name}")
        stream.run()
        stream.port.close()
    finally:
        served.close()
    assert "M109 S200" in served.machine.executed
    assert "G28" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("rfc2217://127.0.0.1:1", "Connection refused"),
        ("rfc2217://", "a host and a port must follow"),
        ("socket://printer", "a host and a port must follow"),
        ("socket://127.0.0.1:99999", "a host and a port must follow"),
        ("socket://127.0.0.1:1", "Connection refused"),
        ("nothing://here", "protocol 'nothing' not known"),
        ("hwgrep://no such thing", "no ports found"),
        ("spy:///dev/nowhere", "there is none of that name"),
    ],
)
def test_a_url_that_leads_nowhere_is_one_line(name, message):
    with pytest.raises(InputError, match=message) as caught:
        open_port(name, PRINTER)
    assert "\n" not in str(caught.value)


def test_nobody_answers_at_a_loop(tmp_path, monkeypatch):
    monkeypatch.setattr(protocol("klipper", PRINTER.stream).__class__, "tries", 1)
    job = gcode(tmp_path / "job.gcode", 50)
    port = open_port("loop://", PRINTER)
    with pytest.raises(InputError, match="no machine that speaks klipper"):
        Stream(job, port, protocol("klipper", PRINTER.stream)).run()
    port.close()


def test_a_pseudo_terminal_can_be_opened_again(line):
    port = SerialPort(line.name, PRINTER.stream)
    assert port.reopen()
    port.write(b"x")
    assert os.read(line._master, 1) == b"x"
    port.close()


@pytest.mark.parametrize(
    ("said", "firmware"),
    [
        (b"ok FIRMWARE_NAME:Kalico FIRMWARE_VERSION:2026.10\n", "klipper"),
        (b"FIRMWARE_VERSION:v0.13 FIRMWARE_NAME:Klipper\nok\n", "klipper"),
        (b"FIRMWARE_NAME:Marlin bugfix-2.1 SOURCE_CODE_URL:x\n", "marlin"),
        (b"FIRMWARE_NAME: RepRapFirmware for Duet 3 MB6HC\n", "rrf"),
        (b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\n", "grbl"),
    ],
)
def test_answers_give_the_firmware_away(said, firmware):
    port = Mute(virtual.VirtualMarlin(PRINTER))
    port.said = said
    assert connect.recognise(port) == firmware


def test_a_file_is_read_again_once_the_firmware_is_known(tmp_path):
    job = gcode(tmp_path / "job.gcode", 50)
    job.path.write_text(job.path.read_text() + "G1 X10 F0\n")
    auto = replace(PRINTER, stream=replace(PRINTER.stream, firmware="auto"))
    with pytest.raises(InputError, match="no speed to klipper"):
        Stream.open(job.path, auto, "virtual:klipper")
    Stream.open(job.path, auto, "virtual:marlin").run()
