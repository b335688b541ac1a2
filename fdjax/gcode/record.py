"""The record of what is in force in a printer between two lines of G-code."""

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

from fdjax.gcode.firmware import MARLIN, Firmware
from fdjax.gcode.objects import Objects
from fdjax.gcode.settings import Settings
from fdjax.gcode.words import Refused
from fdjax.moves import Point, Position

SLOWEST = 1e-3
"""mm/s; what F0 is taken for, where it is taken."""


class Saved(NamedTuple):
    """What a command that saves the state keeps: the names are those of the record."""

    on_bed: Point
    shift: Point
    offset: Point
    e: float
    absolute: bool
    relative_e: bool
    scale: float
    speed: float
    speed_factor: float
    flows: dict[int, float]


@dataclass(slots=True)
class Record:
    """A printer between two lines; lengths in mm, speeds in mm/s.

    - `firmware`: whose reading of G-code holds.
    - `filament_area`: mm^2 of the filament's section, `areas`: of tools whose filament is another;
      `flow`: mm of filament that are told for each mm that is meant.
    - `area_per_power`: mm^2 deposited for each unit of S, of machines without an extruder.
    - `on_bed`: where the nozzle is. `shift`: what G92 added: bed position = coordinate + shift.
    - `e`: of the filament, in the file's coordinates; all tools share it, as in Marlin.
    - `absolute`, `relative_e`: G90, M83; `scale`: mm of a unit; `plane`: of arcs, G17 to G19;
      `motion`: what words alone go on with.
    - `speed`: of the last F; before any, the firmware's. `speed_factor`: M220, and
      what `M220 B` kept of it.
    - `flows`: M221 of each tool. `volumetric`: whether E is mm^3 (M200).
    - `accelerations`: of M204, mm/s^2, by its letters: P for roads, T for travel, R for filament.
    - `settings`: all others that hold until they are given again, as they were said; `saved`:
      states that the file had saved. `offset`: that of Klipper's SET_GCODE_OFFSET, part of `shift`.
    - `one_nozzle`: whether all tools lay through that of tool 0.
    - `tool`; `nozzles`, `bed`, `chamber`: set temperatures; `fans`: S of each, 0 to 255.
    - `coldest`: the least temperature at which filament is pushed, where M302 said one.
    - `retracted`: whether G10 has pulled filament back and G11 not returned it.
    - `top`: the highest deposit so far, over the whole bed.
    - `objects`: of the plate: where the file is among them, and which are left out. While the moves
      of one are not made, `on_bed` is where the file is, not the head, but with Marlin.
    - `power`: of spindle or laser while on, `spindle`: the command that set it (M3, M4).
    - `homed`: axes that have been homed. `unknown`: axes whose coordinate the machine may have set
      otherwise: since homing, a change of tool or a command of its own, until the file says where
      they are.
    """

    firmware: Firmware = MARLIN
    filament_area: float = math.pi / 4 * 1.75**2
    areas: Mapping[int, float] = field(default_factory=dict)
    flow: float = 1.0
    area_per_power: float = 0.0
    on_bed: Point = (0.0, 0.0, 0.0)
    shift: Point = (0.0, 0.0, 0.0)
    e: float = 0.0
    absolute: bool = True
    relative_e: bool = False
    scale: float = 1.0
    plane: str = "G17"
    motion: str = ""
    speed: float = -1.0
    speed_factor: float = 1.0
    kept_speed_factor: float = 1.0
    flows: dict[int, float] = field(default_factory=dict)
    volumetric: bool = False
    accelerations: dict[str, float] = field(default_factory=dict)
    settings: Settings = field(default_factory=dict)
    saved: dict[str, Saved] = field(default_factory=dict)
    offset: Point = (0.0, 0.0, 0.0)
    tool: int = 0
    one_nozzle: bool = False
    nozzles: dict[int, float] = field(default_factory=dict)
    bed: float = 0.0
    chamber: float = 0.0
    coldest: float | None = None
    retracted: bool = False
    top: float = 0.0
    objects: Objects = field(default_factory=Objects)
    fans: dict[int, float] = field(default_factory=dict)
    power: float = 0.0
    spindle: str = "M3"
    homed: frozenset[str] = frozenset()
    unknown: frozenset[str] = frozenset("XYZE")
    pace: float = field(init=False, default=0.0)
    """Speed of motion: that of F with M220 upon it."""
    gain: float = field(init=False, default=0.0)
    """mm^3 that a unit of E deposits."""
    direct: bool = field(init=False, default=True)
    """Whether coordinates are absolute and in mm, and moves are made as they stand."""
    unsure: bool = field(init=False, default=True)
    """Whether X, Y, Z or an absolute E is unknown."""

    def __post_init__(self) -> None:
        self.motion = self.motion or self.firmware.first_motion
        self.weigh()
        self.speed = self.firmware.first_speed if self.speed < 0 else self.speed
        self.pace = max(self.speed * self.speed_factor, SLOWEST)
        self.measure_by()

    def measure_by(self, **modes: float) -> None:
        """Set some of scale, absolute and relative_e."""
        for name, value in modes.items():
            setattr(self, name, value)
        plain = self.absolute and self.scale == 1.0 and self.speed > 0
        self.direct = bool(plain and not self.objects.followed)
        self._look()

    def know(self, axes: Set[str]) -> None:
        """The file says where these axes are."""
        self.unknown = self.unknown.difference(axes)  # a new one: copies share the old
        self._look()

    def forget(self, axes: str = "XYZE") -> None:
        """The machine may have set these axes otherwise."""
        self.unknown |= frozenset(axes)
        self._look()

    def _look(self) -> None:
        self.unsure = bool(self.unknown - {"E"} if self.relative_e else self.unknown)

    def weigh(self) -> None:
        """Take into account what has changed of tool, filament and flow."""
        area = 1.0 if self.volumetric else self.areas.get(self.tool, self.filament_area)
        self.gain = area / self.flow * self.flow_factor

    def run_at(self, speed: float) -> None:
        """Set the speed of F, mm/s. Raises `Refused` for none, where it is."""
        if speed <= 0:
            if self.firmware.no_speed == "refused":
                raise Refused(f"F{60 * speed:g} is no speed to {self.firmware.name}")
            if self.firmware.no_speed == "ignored":
                speed = self.speed
        self.speed = speed
        self.pace = max(speed * self.speed_factor, SLOWEST)

    def race(self, factor: float) -> None:
        """Set the factor of all speeds (M220)."""
        self.speed_factor = factor
        self.settings[("M220", "", 1.0)] = {"S": f"{100 * factor:.10g}"}
        self.run_at(self.speed)

    def pour(self, factor: float, tool: int) -> None:
        """Set the factor of what a tool deposits (M221)."""
        self.flows[tool] = factor
        letter = self.firmware.flow_tool
        self.settings[("M221", f"{letter}{tool}" if letter else "", 1.0)] = {
            "S": f"{100 * factor:.10g}"
        }
        self.weigh()

    def save(self, name: str) -> None:
        """Keep the state under a name."""
        self.saved[name] = Saved(
            on_bed=self.on_bed,
            shift=self.shift,
            offset=self.offset,
            e=self.e,
            absolute=self.absolute,
            relative_e=self.relative_e,
            scale=self.scale,
            speed=self.speed,
            speed_factor=self.speed_factor,
            flows=dict(self.flows),
        )

    @property
    def x(self) -> float:
        """In the file's coordinates, as the machine reports it (M114); so `y` and `z`."""
        return self.on_bed[0] - self.shift[0]

    @property
    def y(self) -> float:
        return self.on_bed[1] - self.shift[1]

    @property
    def z(self) -> float:
        return self.on_bed[2] - self.shift[2]

    @property
    def heater(self) -> int:
        """Number of the nozzle in use."""
        return 0 if self.one_nozzle else self.tool

    @property
    def nozzle(self) -> float:
        """Set temperature of the tool in use."""
        return self.nozzles.get(self.heater, 0.0)

    @property
    def flow_factor(self) -> float:
        """M221 of the tool in use."""
        return self.flows.get(self.tool if self.firmware.flow_tool else 0, 1.0)

    @property
    def pours(self) -> bool:
        """Whether motion lays something by the power that is on, as a dispenser's."""
        return self.power > 0 and self.motion != "G0"

    @property
    def fan(self) -> float:
        """S of the first fan."""
        return self.fans.get(0, 0.0)

    @property
    def position(self) -> Position:
        """x, y, z, e as the machine reports them, None where that is not known."""
        (x, y, z), (a, b, c), unknown = self.on_bed, self.shift, self.unknown
        if not unknown:
            return x - a, y - b, z - c, self.e
        return (
            None if "X" in unknown else x - a,
            None if "Y" in unknown else y - b,
            None if "Z" in unknown else z - c,
            None if "E" in unknown else self.e,
        )

    @property
    def placed(self) -> bool:
        """Whether it has been homed and then told where to be, so that it can leave and return."""
        return self.homed.issuperset("XYZ") and not self.unknown & set("XYZ")

    @property
    def e_is_relative(self) -> bool:
        """Whether E counts from where it is."""
        return self.relative_e or (not self.absolute and self.firmware.e_mode == "while")

    @property
    def e_scale(self) -> float:
        """mm, or mm^3 where E is volumetric, of a unit of E (Marlin, `volumetric_unit_factor`)."""
        return self.scale**3 if self.volumetric else self.scale

    def copy(self) -> Self:
        own = {name: dict(getattr(self, name)) for name in _TABLES}
        return replace(self, **own)


_TABLES = ("flows", "accelerations", "settings", "saved", "nozzles", "fans")
