"""Ports: a serial line to a machine, or a machine that is not there, behind one interface."""

import time
from abc import ABC, abstractmethod

from fdjax.errors import FdjaxError, InputError
from fdjax.formats.profile import Machine, Stream

try:
    import termios

    _REFUSALS: tuple[type[Exception], ...] = (OSError, ValueError, termios.error)
except ImportError:  # Windows
    _REFUSALS = (OSError, ValueError)

VIRTUAL = "virtual:"


class PortLost(FdjaxError):
    """The port is gone: the cable, the machine's power, or its driver."""


class AbstractPort(ABC):
    """Bytes to and from a machine, and the clock by which waits are meant.

    Every method that touches the line raises `PortLost` once it is gone.
    """

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send bytes."""

    @abstractmethod
    def read(self, seconds: float) -> bytes:
        """What has arrived; waits for at most so long where there is nothing."""

    @abstractmethod
    def now(self) -> float:
        """Seconds since some moment."""

    @abstractmethod
    def wait(self, seconds: float) -> None:
        """Let time pass."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the port; harmless if it is gone."""

    @abstractmethod
    def reopen(self) -> bool:
        """Look once for the same machine after it was lost; whether the port is open again."""


_PARITIES = {"none": "N", "even": "E", "odd": "O"}


class SerialPort(AbstractPort):
    """A serial line, opened for one program alone and without a reset where that can be avoided.

    Raises `InputError` for a port that is not there, may not be used or is in use; the message
    says what would help.
    """

    def __init__(self, name: str, stream: Stream) -> None:
        self._name = name
        self._settings = stream
        self._serial_number = _serial_number(name)
        self._line = self._open(name)

    def _open(self, name: str):
        import serial

        line = serial.serial_for_url(name, do_not_open=True)
        settings = self._settings
        line.baudrate = settings.baud
        line.bytesize = settings.bytesize
        line.parity = _PARITIES[settings.parity]
        line.xonxoff = "xon-xoff" in settings.handshake
        line.dsrdtr = "dtr" in settings.handshake
        line.timeout = 0
        line.write_timeout = 10
        if "dtr" not in settings.handshake:
            line.dtr = False  # boards of the Arduino kind reset when it is raised
        line.exclusive = True
        try:
            line.open()
        except _REFUSALS as error:
            raise InputError(_explained(name, error)) from None
        return line

    def write(self, data: bytes) -> None:
        try:
            self._line.write(data)
        except OSError as error:
            raise PortLost(f"{self._name} is gone ({error})") from None

    def read(self, seconds: float) -> bytes:
        try:
            self._line.timeout = seconds
            first = self._line.read(1)
            return first + self._line.read(self._line.in_waiting) if first else b""
        except (OSError, TypeError) as error:
            raise PortLost(f"{self._name} is gone ({error})") from None

    def now(self) -> float:
        return time.monotonic()

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)

    def close(self) -> None:
        self._line.close()

    def reopen(self) -> bool:
        self._line.close()
        for port in _present():
            same = self._serial_number is not None and port.serial_number == self._serial_number
            if same or port.device == self._name:
                try:
                    self._line = self._open(port.device)
                except InputError:
                    return False
                self._name = port.device
                return True
        return False


def _present() -> list:
    from serial.tools import list_ports

    return list(list_ports.comports())


def _serial_number(name: str) -> str | None:
    return next((port.serial_number for port in _present() if port.device == name), None)


def listing() -> str:
    """The ports that are there, with what they say of themselves; for people."""
    found = [f"{port.device} ({port.description})" for port in _present()]
    return ", ".join([*found, *_virtual_names()])


def _virtual_names() -> list[str]:
    from fdjax.machine.virtual import MACHINES

    return [VIRTUAL + name for name in MACHINES]


def _explained(name: str, error: Exception) -> str:
    import errno

    number = getattr(error, "errno", None)
    if number in (errno.EACCES, errno.EPERM):
        return (
            f"port {name}: no permission; on Linux add yourself to the group that owns it "
            "(usually `sudo usermod -aG dialout $USER`, then log in again)"
        )
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return f"port {name}: another program is using it; close that first"
    if number == errno.ENOENT or isinstance(error, ValueError):
        return f"port {name}: there is none of that name; there are {listing()}"
    if number == errno.ENOTTY or f"({errno.ENOTTY}," in str(error):
        return f"port {name}: is no serial port; there are {listing()}"
    return f"port {name}: cannot be opened ({error})"


def open_port(name: str, machine: Machine) -> AbstractPort:
    """The port of a name such as `/dev/ttyUSB0`, `COM3` or `virtual:marlin`, for a machine.

    Raises `InputError` where it cannot be opened.
    """
    if name.startswith(VIRTUAL):
        from fdjax.machine import virtual

        return virtual.open_port(name.removeprefix(VIRTUAL), machine)
    return SerialPort(name, machine.stream)
