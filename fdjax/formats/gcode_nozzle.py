"""Where nozzle and filament are while G-code is written: roads, travel and changes of tool."""

import math
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from fdjax.formats.assembly import road_mark
from fdjax.formats.profile import Gcode
from fdjax.plan.toolpath import Layer, Road

Floats = NDArray[np.float64]

XYZ_DECIMALS = 3
_E_DECIMALS = 5


def on_bed(road: Road, origin: Floats) -> Floats:
    """Points of a road, the first of a closed one again at its end, as a file holds them, mm."""
    return np.round(road.path + origin, XYZ_DECIMALS) + 0.0  # no -0.0


class Nozzle:
    """Adds lines to `out`, beginning with the tool `first`, which the start code has heated.

    A tool that waits is parked and stands by; it is told to heat `ahead` seconds before its turn.
    """

    def __init__(self, out: list[str], tables: Gcode, origin: Floats, first: int) -> None:
        self._out = out
        self._tables = tables
        self._origin = origin
        self._per_volume = tables.extrusion.flow / (math.pi / 4 * tables.extrusion.filament**2)
        self.tool = first
        # Where each tool that has cooled down was told to, as a place in `out`.
        self._cooled: dict[int, int] = {}
        self._met = {first}
        self._heat = tables.tool_at(first).nozzle
        self._parked = 0.0  # filament that this tool still has to be given back, mm
        self._at: tuple[float, float] | None = None
        self._fresh = False  # whether a tool has just been taken, its filament parked or cold
        self._z: float | None = None
        self._feed = 0.0
        self._exact: dict[int, float] = {}  # filament each tool should have laid, mm
        self._laid = 0.0  # what the file says it has laid, rounded
        self._zero = 0.0  # where G92 E0 was
        self._time = 0.0  # of roads and travel at their speeds, s
        self._marks: list[float] = []  # times at which roads begin
        self._places: list[int] = []  # and the line before each

    def prime(self, road: Road, layer: Layer, speed: float) -> None:
        """Write one road of the tower, in machine coordinates, which counts as no road.

        Its tool is taken there, so that what oozes while it heats does not fall on the part.
        """
        path = np.round(road.path, XYZ_DECIMALS) + 0.0
        self._out.append("; fdjax prime begin")
        if road.material != self.tool:
            self._travel((float(path[0, 0]), float(path[0, 1])), layer.z)
        self._lay(road, path, layer, speed)
        self._out.append("; fdjax prime end")

    def lay(self, road: Road, layer: Layer, speed: float) -> None:
        """Write one road, with what must come before it."""
        self._marks.append(self._time)
        self._places.append(len(self._out) - 1)
        self._lay(road, on_bed(road, self._origin), layer, speed, road_mark(";", road))

    def _lay(self, road: Road, path: Floats, layer: Layer, speed: float, mark: str = "") -> None:
        self._select(road.material)
        self._travel((float(path[0, 0]), float(path[0, 1])), layer.z)
        self._out += [mark] if mark else []
        lengths = np.hypot(*np.diff(path, axis=0).T)
        volumes = road.areas(layer.height) * lengths
        exact = self._exact.get(self.tool, 0.0) + np.cumsum(volumes) * self._per_volume
        laid = np.round(exact, _E_DECIMALS)
        e = np.diff(laid, prepend=self._laid) if self._tables.relative_e else laid - self._zero
        first = len(self._out)
        self._out += [
            f"G1 X{x:.3f} Y{y:.3f} E{e:.5f}"
            for x, y, e in zip(path[1:, 0].tolist(), path[1:, 1].tolist(), e.tolist(), strict=True)
        ]
        if self._feed != speed:
            self._out[first] += f" F{60 * speed:g}"
            self._feed = speed
        self._time += float(lengths.sum()) / speed
        self._exact[self.tool], self._laid = float(exact[-1]), float(laid[-1])
        self._at = (float(path[-1, 0]), float(path[-1, 1]))

    def _select(self, tool: int) -> None:
        if tool == self.tool:
            return
        old, new = self._tables.tool_at(self.tool), self._tables.tool_at(tool)
        if old.park:
            self._filament(-old.park)
        if old.standby:
            self._out.append(f"M104 T{self.tool} S{old.standby}")
            self._cooled[self.tool] = len(self._out) - 1
        self._out += [f"T{tool}", "G92 E0"]
        if self._tables.one_nozzle:
            self._out += [f"M109 S{new.nozzle}"] if new.nozzle != self._heat else []
        elif tool in self._cooled or tool not in self._met:
            self._heat_ahead(tool)
            self._out.append(f"M109 S{new.nozzle}")
        self._laid = self._zero = round(self._exact.get(tool, 0.0), _E_DECIMALS)
        self._parked = (new.park or 0.0) if tool in self._met else 0.0
        self._heat = new.nozzle
        # What a change of tool runs may have moved the head.
        self.tool, self._at, self._z, self._feed, self._fresh = tool, None, None, 0.0, True
        self._cooled.pop(tool, None)
        self._met.add(tool)

    def _heat_ahead(self, tool: int) -> None:
        """Say between earlier roads that a tool is to be hot soon."""
        new = self._tables.tool_at(tool)
        told = bisect_right(self._marks, self._time - new.ahead) - 1
        if not new.ahead or not self._marks:
            return
        place = self._places[max(told, 0)]
        since = self._cooled.get(tool)
        if since is not None and place <= since:
            # There is no time to cool down.
            self._out[since] = f"; tool {tool} stays hot"
        else:
            self._out[place] += f"\nM104 T{tool} S{new.nozzle}"

    def _travel(self, to: tuple[float, float], z: float) -> None:
        moves = to != self._at
        if not moves and z == self._z:
            return
        motion, retraction = self._tables.motion, self._tables.retraction
        gap = math.inf if self._at is None else math.dist(to, self._at)
        length = self._tables.tool_at(self.tool).retract or 0.0
        far = moves and gap >= retraction.least_travel and length > 0
        retracts = far and not self._fresh
        hop = retraction.hop if far else 0.0
        if retracts:
            self._filament(-length)
        if z + hop != self._z:
            self._out.append(f"G1 Z{z + hop:.3f} F{60 * motion.z_speed:g}")
        if moves:
            self._out.append(f"G0 X{to[0]:.3f} Y{to[1]:.3f} F{60 * motion.travel_speed:g}")
            self._time += gap / motion.travel_speed if self._at is not None else 0.0
        if hop:
            self._out.append(f"G1 Z{z:.3f} F{60 * motion.z_speed:g}")
        if retracts:
            self._filament(length)
        if self._parked:
            # E is 0 where the filament was parked.
            self._out += [f"G1 E{self._parked:.5f} F{60 * retraction.speed:g}", "G92 E0"]
        self._at, self._z, self._feed, self._fresh, self._parked = to, z, 0.0, False, 0.0

    def _filament(self, length: float) -> None:
        absolute = self._laid - self._zero + min(length, 0.0)
        e = length if self._tables.relative_e else absolute
        self._out.append(f"G1 E{e:.5f} F{60 * self._tables.retraction.speed:g}")
