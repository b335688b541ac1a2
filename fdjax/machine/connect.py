"""Finding out who answers at a port, and whether it is the machine of the profile."""

from dataclasses import replace

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.machine.port import AbstractPort
from fdjax.machine.protocols import PROTOCOLS, AbstractProtocol, protocol
from fdjax.machine.protocols.base import LISTEN

_ASK = 2.0

_NAMES = (
    ("klipper", "klipper"),
    ("kalico", "klipper"),
    ("reprapfirmware", "rrf"),
    ("grbl", "grbl"),
    ("|wpos:", "grbl"),
    ("|mpos:", "grbl"),
    ("marlin", "marlin"),
    ("firmware_name", "marlin"),
)
"""What an answer holds, in lower case, and what it tells; the last is any kin of Marlin."""


def firmware_of(text: str) -> str | None:
    """The firmware that an answer gives away, if it does.

    >>> firmware_of("FIRMWARE_NAME:Klipper"), firmware_of("start")
    ('klipper', None)
    """
    low = text.lower()
    return next((name for sign, name in _NAMES if sign in low), None)


def recognise(port: AbstractPort) -> str:
    """The firmware behind a port: what its banner says, or its answer to M115, `?` or ENQ.

    Raises `InputError` where nothing or nothing known answers.
    """
    heard = b""
    for question, seconds in ((b"", LISTEN), (b"\nM115\n", _ASK), (b"?", _ASK), (b"\x05", _ASK)):
        if question:
            port.write(question)
        until = port.now() + seconds
        while port.now() < until:
            heard += port.read(until - port.now())
            found = firmware_of(heard.decode("ascii", "replace"))
            if found is not None:
                return found
            if question == b"\x05" and b"\x06" in heard:
                return "sml"
    raise InputError(unanswered(heard, "any firmware that is known", 0))


def settled(port: AbstractPort, machine: Machine) -> Machine:
    """The machine, with the firmware that answers at its port if the profile leaves that open."""
    if machine.stream.firmware != "auto":
        return machine
    return replace(machine, stream=replace(machine.stream, firmware=recognise(port)))


def protocol_of(machine: Machine) -> AbstractProtocol:
    """The protocol of a machine whose firmware is settled."""
    return protocol(machine.stream.firmware, machine.stream)


def unanswered(heard: bytes, wanted: str, baud: int) -> str:
    """Why a conversation did not begin, from what was heard; for people."""
    if not heard:
        return f"no answer from {wanted}: is the machine on, and is this its port?"
    printable = sum(32 <= byte < 127 or byte in b"\r\n\t" for byte in heard)
    if printable < 0.7 * len(heard):
        speed = f" (not {baud})" if baud else ""
        return f"garbage from the port: the baud rate is another one{speed}; often 115200 or 250000"
    said = heard.decode("ascii", "replace").split("\n")[-2:]
    return f"no machine that speaks {wanted}; it says {' '.join(said).strip()[-60:]!r}"


def check(firmware: str, facts: dict[str, str], machine: Machine) -> None:
    """Raise `InputError` where what the machine says of itself is not what the profile says."""
    name = facts.get("FIRMWARE_NAME", "")
    found = firmware_of(name) if name else None
    if found is not None and found != firmware and firmware in PROTOCOLS:
        raise InputError(
            f"the machine says it runs {name!r}, but {machine.name} is a machine with {firmware}; "
            "name the profile of this machine, or give --firmware"
        )
