"""G-code for Marlin and kin: `fit` to its resolution, `write`; `read` is in gcode_reader.

E is volumetric: filament length = volume x flow / filament area, where volume = section area x
length. Coordinates have 3 decimals and E has 5; both are rounded as positions, on the bed and
along the filament, before differences are taken, so nothing drifts.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats import header, hosts
from fdjax.formats.assembly import layer_mark, road_mark
from fdjax.formats.gcode_reader import read
from fdjax.formats.gcode_tower import towers
from fdjax.formats.profile import Gcode, Machine
from fdjax.formats.template import fill
from fdjax.plan.toolpath import Build, Layer, Road

__all__ = ["fit", "read", "write"]

READS_BYTES = True

_XYZ_DECIMALS = 3
_E_DECIMALS = 5


def fit(build: Build, machine: Machine) -> Build:
    """The build as its G-code file can hold it.

    Points are rounded to 0.001 mm on the bed; segments that vanish by it are dropped, and so are
    roads of which nothing is left. Widths stay: E resolves the volume of a segment to about
    2e-5 mm^3 and that of the whole build to as much. Raises `InputError` for a machine without
    a [gcode] table, a road width that is not positive, or a material that the machine lacks.
    """
    tables = _tables(machine)
    origin = np.asarray(build.origin)
    layers = []
    for index, layer in enumerate(build.layers):
        roads = []
        for road in layer.roads:
            if not (road.width > 0).all():
                raise InputError(f"layer {index + 1}: a road has a width of 0 or less")
            if not 0 <= road.material < tables.tools:
                raise InputError(
                    f"layer {index + 1}: material {road.material}, but {machine.name} has "
                    f"{tables.tools} tool{'s' * (tables.tools > 1)}, counted from 0"
                )
            fitted = _fit_road(road, origin)
            if fitted is not None:
                roads.append(fitted)
        z = round(layer.z, _XYZ_DECIMALS)
        layers.append(replace(layer, z=z, roads=tuple(roads)))
    return build.replace(layers=tuple(layers))


def _fit_road(road: Road, origin: NDArray[np.float64]) -> Road | None:
    path = _on_bed(road, origin)
    lasting = (np.diff(path, axis=0) != 0).any(axis=1)
    points = np.vstack([path[:1], path[1:][lasting]]) - origin
    if len(points) < 2:
        return None
    xy = points[:-1] if road.closed else points
    section = None if road.section is None else road.section[lasting]
    return replace(road, xy=xy, width=road.width[lasting], section=section)


def _on_bed(road: Road, origin: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.round(road.path + origin, _XYZ_DECIMALS) + 0.0  # no -0.0


def _tables(machine: Machine) -> Gcode:
    if machine.gcode is None:
        raise InputError(f"machine {machine.name} writes no G-code: its profile has no [gcode]")
    return machine.gcode


def write(build: Build, machine: Machine) -> str:
    """The G-code file of `fit(build, machine)`.

    Z is moved by G1, by which viewers tell layers, and comments tell hosts time, filament and
    layers (see `hosts`). Travel, with retraction, only where the next road starts elsewhere than
    the last one ended. Priming stands between comments `fdjax prime begin` and `end`; the last line
    marks the end of the file. Raises what `fit` raises.
    """
    build = fit(build, machine)
    tables = _tables(machine)
    values = _placeholder_values(build, machine, tables)
    facts = header.of_build(
        build,
        machine.name,
        filament=repr(tables.extrusion.filament),
        flow=repr(tables.extrusion.flow),
    )
    out = [*header.lines(";", facts), hosts.head()]
    out += fill(tables.start, values)
    out += ["G90", "M83", "; fdjax prime begin", *fill(tables.prime, values), "; fdjax prime end"]
    out += ["M83" if tables.relative_e else "M82", "G92 E0"]
    nozzle = _Nozzle(out, tables, np.asarray(build.origin))
    outline = ""
    for index, (layer, tower) in enumerate(zip(build.layers, towers(build, machine), strict=True)):
        text = header.outline_text(layer.outline)
        if text != outline:
            out += header.lines(";", {"outline": text})
            outline = text
        out.append(layer_mark(";", layer))
        if index == tables.cooling.layers_without and tables.cooling.fan > 0:
            out.append(f"M106 S{round(255 * tables.cooling.fan)}")
        motion = tables.motion
        speed = motion.first_layer_speed if index == 0 else motion.print_speed
        for road in layer.roads:
            if tower and (road.material != nozzle.tool or not _changes(layer, nozzle.tool)):
                nozzle.prime(replace(tower.pop(0), material=road.material), layer, speed)
            nozzle.lay(road, layer, speed)
    end = fill(tables.end, values)
    out += [*hosts.summary([*out, *end], build, machine), *end, "; fdjax end", ""]
    return "\n".join(out)


def _changes(layer: Layer, tool: int) -> bool:
    """Whether a layer that begins with this tool asks for another."""
    return any(road.material != tool for road in layer.roads)


def _placeholder_values(build: Build, machine: Machine, tables: Gcode) -> Mapping[str, object]:
    top = max((layer.z for layer in build.layers), default=0.0)
    first = build.layers[0].height if build.layers else machine.layer_height[0]
    lengths = {
        "bed_x": machine.bed[0],
        "bed_y": machine.bed[1],
        "bed_z": machine.bed[2],
        "first_height": first,
        "top_z": top,
        "park_z": min(top + 10, machine.bed[2]),
    }
    return {
        "nozzle_temperature": tables.temperature.nozzle,
        "bed_temperature": tables.temperature.bed,
    } | {name: f"{value:.{_XYZ_DECIMALS}f}" for name, value in lengths.items()}


class _Nozzle:
    """Where the nozzle and the filament are while a file is written."""

    def __init__(self, out: list[str], tables: Gcode, origin: NDArray[np.float64]) -> None:
        self._out = out
        self._tables = tables
        self._origin = origin
        self._per_volume = tables.extrusion.flow / (math.pi / 4 * tables.extrusion.filament**2)
        self.tool = 0
        self._hot = {0}  # tools at the heat at which they lay
        self._met = {0}  # tools that were in use
        self._at: tuple[float, float] | None = None
        self._z: float | None = None
        self._feed = 0.0
        self._exact: dict[int, float] = {}  # filament each tool should have laid, mm
        self._laid = 0.0  # what the file says it has laid, rounded
        self._zero = 0.0  # where G92 E0 was

    def prime(self, road: Road, layer: Layer, speed: float) -> None:
        """Write one road of the tower, in machine coordinates, which counts as no road."""
        self._out.append("; fdjax prime begin")
        self._lay(road, np.round(road.path, _XYZ_DECIMALS) + 0.0, layer, speed)
        self._out.append("; fdjax prime end")

    def lay(self, road: Road, layer: Layer, speed: float) -> None:
        """Write one road, with what must come before it."""
        self._lay(road, _on_bed(road, self._origin), layer, speed, road_mark(";", road))

    def _lay(
        self, road: Road, path: NDArray[np.float64], layer: Layer, speed: float, mark: str = ""
    ) -> None:
        self._select(road.material)
        self._travel((float(path[0, 0]), float(path[0, 1])), layer.z)
        self._out += [mark] if mark else []
        volumes = road.areas(layer.height) * np.hypot(*np.diff(path, axis=0).T)
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
        self._exact[self.tool], self._laid = float(exact[-1]), float(laid[-1])
        self._at = (float(path[-1, 0]), float(path[-1, 1]))

    def _select(self, tool: int) -> None:
        if tool == self.tool:
            return
        old, new = self._tables.tool_at(self.tool), self._tables.tool_at(tool)
        if old.park > 0:
            self._filament(-old.park)
        if old.standby:
            self._out.append(f"M104 T{self.tool} S{old.standby}")
            self._hot.discard(self.tool)
        self._out += [f"T{tool}", "G92 E0"]
        if tool not in self._hot:
            self._out.append(f"M109 T{tool} S{new.nozzle}")
            self._hot.add(tool)
        self._laid = self._zero = round(self._exact.get(tool, 0.0), _E_DECIMALS)
        if new.park > 0 and tool in self._met:
            # E is 0 where the filament was parked.
            self._out += [f"G1 E{new.park:.5f} F{60 * self._tables.retraction.speed:g}", "G92 E0"]
        self.tool, self._at, self._feed = tool, None, 0.0
        self._met.add(tool)

    def _travel(self, to: tuple[float, float], z: float) -> None:
        moves = to != self._at
        if not moves and z == self._z:
            return
        motion, retraction = self._tables.motion, self._tables.retraction
        far = self._at is None or math.dist(to, self._at) >= retraction.least_travel
        own = self._tables.tool_at(self.tool).retract
        length = retraction.length if own is None else own
        retracts = moves and far and length > 0
        hop = retraction.hop if retracts else 0.0
        if retracts:
            self._filament(-length)
        if z + hop != self._z:
            self._out.append(f"G1 Z{z + hop:.3f} F{60 * motion.z_speed:g}")
        if moves:
            self._out.append(f"G0 X{to[0]:.3f} Y{to[1]:.3f} F{60 * motion.travel_speed:g}")
        if hop:
            self._out.append(f"G1 Z{z:.3f} F{60 * motion.z_speed:g}")
        if retracts:
            self._filament(length)
        self._at, self._z, self._feed = to, z, 0.0

    def _filament(self, length: float) -> None:
        absolute = self._laid - self._zero + min(length, 0.0)
        e = length if self._tables.relative_e else absolute
        self._out.append(f"G1 E{e:.5f} F{60 * self._tables.retraction.speed:g}")
