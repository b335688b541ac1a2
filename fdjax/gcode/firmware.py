"""What firmwares make of the same G-code, where they differ; one row a firmware."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Firmware:
    """How a firmware reads G-code.

    - `e_mode`: what G90 and G91 do to E. "set": they set its mode too, and M82, M83 set it again
      (Marlin, `GcodeSuite::set_relative_mode` clears the E bits). "while": G91 makes it relative
      for as long as it is in force (Klipper, gcode_move.py: `if not self.absolute_coord or not
      self.absolute_extrude`). "apart": only M82 and M83 do (RepRapFirmware, `drivesRelative`).
    - `first_motion`: what words alone go on with before any motion; none with most.
    - `runs_all`: whether it runs all commands of a line, or the first only.
    - `splines`: whether it may have G5 (Marlin, where it is built with BEZIER_CURVE_SUPPORT).
    """

    name: str
    e_mode: str = "set"
    first_motion: str = ""
    runs_all: bool = False
    splines: bool = False


MARLIN = Firmware("marlin", splines=True)
KLIPPER = Firmware("klipper", e_mode="while")
REPRAP = Firmware("rrf", e_mode="apart", runs_all=True)
GRBL = Firmware("grbl", e_mode="while", first_motion="G0", runs_all=True)

_BY_NAME = {firmware.name: firmware for firmware in (MARLIN, KLIPPER, REPRAP, GRBL)}


def firmware_of(name: str) -> Firmware:
    """The firmware that a profile names; Marlin where it leaves that open.

    >>> firmware_of("klipper").e_mode, firmware_of("auto").name
    ('while', 'marlin')
    """
    return _BY_NAME.get(name, MARLIN)
