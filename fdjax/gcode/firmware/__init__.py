"""What firmwares make of the same G-code, where they differ: a table, one file a firmware.

Check, stream, time, measure and virtual machine all read by it.
"""

from fdjax.gcode.firmware.base import Firmware, Kept
from fdjax.gcode.firmware.grbl import GRBL
from fdjax.gcode.firmware.klipper import KLIPPER
from fdjax.gcode.firmware.marlin import MARLIN
from fdjax.gcode.firmware.rrf import REPRAP

__all__ = ["GRBL", "KLIPPER", "MARLIN", "REPRAP", "Firmware", "Kept", "firmware_of"]

_BY_NAME = {firmware.name: firmware for firmware in (MARLIN, KLIPPER, REPRAP, GRBL)}


def firmware_of(name: str) -> Firmware:
    """The firmware that a profile names; Marlin where it leaves that open.

    >>> firmware_of("klipper").e_mode, firmware_of("auto").name
    ('while', 'marlin')
    """
    return _BY_NAME.get(name, MARLIN)
