"""A serial line to a machine, or what pyserial's URLs name: socket://, rfc2217://, loop://, spy://.

Sources: pyserial 3.5. Its rfc2217 has no timeout for writing and negotiates anew whenever a setting
is changed, the timeout of reading included; socket:// says of any number of bytes that one waits.
"""

import errno
import time
from urllib.parse import urlsplit

from fdjax.errors import InputError
from fdjax.formats.profile import Stream
from fdjax.machine.port import AbstractPort, PortLost

try:
    import termios

    _REFUSALS: tuple[type[Exception], ...] = (OSError, ValueError, termios.error)
except ImportError:  # Windows
    _REFUSALS = (OSError, ValueError)


class NoPort(InputError):
    """There is no serial port of that name."""


_WRITE_TIMEOUT = 10.0
_GLANCE = 0.02
"""Seconds of one read where its timeout is not to be changed: callers ask again."""
_OVER_NET = ("socket", "rfc2217")

_PARITIES = {"none": "N", "even": "E", "odd": "O"}


class SerialPort(AbstractPort):
    """A serial line, opened for one program alone and without a reset where that can be avoided.

    Raises `NoPort` for a port that is not there, and `InputError` for one that may not be used or
    is in use; the message says what would help.
    """

    def __init__(self, name: str, stream: Stream) -> None:
        self._name = name
        self._settings = stream
        self._serial_number = _serial_number(name)
        self._line = self._open(name)

    def _open(self, name: str):
        import serial

        _check_url(name)
        try:
            line = serial.serial_for_url(name, do_not_open=True)
        except (ValueError, serial.SerialException) as error:
            raise NoPort(f"port {name}: {error}") from None
        settings = self._settings
        line.baudrate = settings.baud
        line.bytesize = settings.bytesize
        line.parity = _PARITIES[settings.parity]
        line.xonxoff = "xon-xoff" in settings.handshake
        line.dsrdtr = "dtr" in settings.handshake
        self._negotiates = name.lower().startswith("rfc2217:")
        line.timeout = _GLANCE if self._negotiates else 0
        if not self._negotiates:
            line.write_timeout = _WRITE_TIMEOUT
        if "dtr" not in settings.handshake:
            line.dtr = False  # boards of the Arduino kind reset when it is raised
        line.exclusive = True
        try:
            line.open()
        except _REFUSALS as error:
            raise _explained(name, error) from None
        return line

    def write(self, data: bytes) -> None:
        try:
            self._line.write(data)
        except OSError as error:
            raise PortLost(f"{self._name} is gone ({error})") from None

    def read(self, seconds: float) -> bytes:
        try:
            if self._negotiates:
                if seconds <= 0 and not self._line.in_waiting:
                    return b""
            else:
                self._line.timeout = seconds
            first = self._line.read(1)
            return first + self._rest() if first else b""
        except (OSError, TypeError) as error:
            raise PortLost(f"{self._name} is gone ({error})") from None

    def _rest(self) -> bytes:
        """All that waits behind a byte."""
        found = b""
        while count := self._line.in_waiting:
            found += self._line.read(count)
        return found

    def now(self) -> float:
        return time.monotonic()

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)

    def close(self) -> None:
        self._line.close()

    def reopen(self) -> bool:
        self._line.close()
        number = self._serial_number
        found = [port.device for port in present() if number and port.serial_number == number]
        for name in (*found, self._name):
            try:
                self._line = self._open(name)
            except InputError:
                continue
            self._name = name
            return True
        return False


def present() -> list:
    """The serial ports that are there."""
    from serial.tools import list_ports

    return list(list_ports.comports())


def _serial_number(name: str) -> str | None:
    return next((port.serial_number for port in present() if port.device == name), None)


def _check_url(name: str) -> None:
    """Raise `NoPort` for a URL without a host and a port, where these are needed."""
    try:
        parts = urlsplit(name)
        lacks = parts.scheme.lower() in _OVER_NET and not (parts.hostname and parts.port)
    except ValueError:
        lacks = True
    if lacks:
        scheme = name.partition(":")[0]
        raise NoPort(f"port {name}: a host and a port must follow, as in {scheme}://printer:7000")


def _explained(name: str, error: Exception) -> InputError:
    number = getattr(error, "errno", None)
    if number in (errno.EACCES, errno.EPERM):
        return InputError(
            f"port {name}: no permission; on Linux add yourself to the group that owns it "
            "(usually `sudo usermod -aG dialout $USER`, then log in again)"
        )
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return InputError(f"port {name}: another program is using it; close that first")
    if number == errno.ENOENT or isinstance(error, ValueError):
        return NoPort(f"port {name}: there is none of that name")
    if number == errno.ENOTTY or f"({errno.ENOTTY}," in str(error):
        return NoPort(f"port {name}: is no serial port")
    return InputError(f"port {name}: cannot be opened ({error})")
