"""G-code for Marlin and kin: `fit` to its resolution, `write`; `read` is in gcode_reader.

E is volumetric: filament length = volume x flow / filament area, where volume = section area x
length. Coordinates have 3 decimals and E has 5; both are rounded as positions, on the bed and
along the filament, before differences are taken, so nothing drifts.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats import header, hosts
from fdjax.formats.assembly import layer_mark
from fdjax.formats.gcode_nozzle import XYZ_DECIMALS, Nozzle, on_bed
from fdjax.formats.gcode_reader import read
from fdjax.formats.gcode_tower import towers
from fdjax.formats.profile import Gcode, Machine
from fdjax.formats.template import fill
from fdjax.plan.toolpath import Build, Road

__all__ = ["fit", "read", "write"]

READS_BYTES = True


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
        z = round(layer.z, XYZ_DECIMALS)
        layers.append(replace(layer, z=z, roads=tuple(roads)))
    return build.replace(layers=tuple(layers))


def _fit_road(road: Road, origin: NDArray[np.float64]) -> Road | None:
    path = on_bed(road, origin)
    lasting = (np.diff(path, axis=0) != 0).any(axis=1)
    points = np.vstack([path[:1], path[1:][lasting]]) - origin
    if len(points) < 2:
        return None
    xy = points[:-1] if road.closed else points
    section = None if road.section is None else road.section[lasting]
    return replace(road, xy=xy, width=road.width[lasting], section=section)


def _tables(machine: Machine) -> Gcode:
    if machine.gcode is None:
        raise InputError(f"machine {machine.name} writes no G-code: its profile has no [gcode]")
    return machine.gcode


def write(build: Build, machine: Machine) -> str:
    """The G-code file of `fit(build, machine)`.

    Z is moved by G1, by which viewers tell layers, and comments tell hosts time, filament and
    layers (see `hosts`). Travel, with retraction, only where the next road starts elsewhere than
    the last one ended. Tools change at the tower, where there is one. Priming stands between
    comments `fdjax prime begin` and `end`; the last line marks the end of the file. Raises what
    `fit` and `towers` raise.
    """
    build = fit(build, machine)
    tables = _tables(machine)
    first = next((road.material for layer in build.layers for road in layer.roads), 0)
    values = _placeholder_values(build, machine, tables, first)
    facts = header.of_build(
        build,
        machine.name,
        filament=repr(tables.extrusion.filament),
        flow=repr(tables.extrusion.flow),
    )
    out = [*header.lines(";", facts), hosts.head()]
    selects = any(line.split()[:1] == ["T{first_tool}"] for line in tables.start)
    if tables.tools > 1 and not selects:
        # Since the print before any may be in use, and what is heated is the one in use.
        out.append(f"T{first}")
    out += fill(tables.start, values)
    out += ["G90", "M83", "; fdjax prime begin", *fill(tables.prime, values), "; fdjax prime end"]
    out += ["M83" if tables.relative_e else "M82", "G92 E0"]
    nozzle = Nozzle(out, tables, np.asarray(build.origin), first)
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
            if tower and road.material != nozzle.tool:
                nozzle.prime(replace(tower.pop(0), material=road.material), layer, speed)
            nozzle.lay(road, layer, speed)
        for road in tower:
            nozzle.prime(replace(road, material=nozzle.tool), layer, speed)
    end = fill(tables.end, values)
    out += [*hosts.summary([*out, *end], build, machine), *end, "; fdjax end", ""]
    return "\n".join(out)


def _placeholder_values(
    build: Build, machine: Machine, tables: Gcode, first_tool: int
) -> Mapping[str, object]:
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
        "first_tool": first_tool,
        "nozzle_temperature": tables.tool_at(first_tool).nozzle,
        "bed_temperature": tables.temperature.bed,
    } | {name: f"{value:.{XYZ_DECIMALS}f}" for name, value in lengths.items()}
