"""Ports by their names: serial lines, and virtual machines."""

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.machine import virtual
from fdjax.machine.port import AbstractPort
from fdjax.machine.serial_port import NoPort, SerialPort, present

VIRTUAL = "virtual:"


def listing() -> str:
    """The ports that are there, with what they say of themselves; for people."""
    found = [f"{port.device} ({port.description})" for port in present()]
    return ", ".join([*found, *(VIRTUAL + name for name in virtual.MACHINES)])


def open_port(name: str, machine: Machine) -> AbstractPort:
    """The port of a name such as `/dev/ttyUSB0`, `COM3` or `virtual:marlin`, for a machine.

    Raises `InputError` where it cannot be opened.
    """
    if name.startswith(VIRTUAL):
        return virtual.open_port(name.removeprefix(VIRTUAL), machine)
    try:
        return SerialPort(name, machine.stream)
    except NoPort as error:
        raise InputError(f"{error}; there are {listing()}") from None
