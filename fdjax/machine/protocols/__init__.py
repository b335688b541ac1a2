"""Protocols: one small file for each firmware, and a line in the table below."""

from fdjax.formats.profile import Stream
from fdjax.machine.protocols.base import AbstractProtocol
from fdjax.machine.protocols.grbl import GrblProtocol
from fdjax.machine.protocols.klipper import KlipperProtocol
from fdjax.machine.protocols.marlin import MarlinProtocol
from fdjax.machine.protocols.rrf import RrfProtocol
from fdjax.machine.protocols.sml import SmlProtocol

PROTOCOLS: dict[str, type[AbstractProtocol]] = {
    "marlin": MarlinProtocol,
    "klipper": KlipperProtocol,
    "rrf": RrfProtocol,
    "grbl": GrblProtocol,
    "sml": SmlProtocol,
}
"""By the name of the firmware in a profile."""


def protocol(firmware: str, settings: Stream) -> AbstractProtocol:
    """A protocol for a firmware of the table."""
    if firmware == "sml":
        return SmlProtocol(settings.handshake)
    return PROTOCOLS[firmware]()
