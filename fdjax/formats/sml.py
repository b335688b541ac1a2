"""SML, the build file of Stratasys FDM machines: `fit` to it, `write`; `read` is in sml_reader.

Coordinates are microsteps of 0.001 in on the bed. Every road is one continuous path (BC ... EC)
after a set-up in the shape of the one line that is public (FDM 2000 Utilities Manual, p. U-3):
`>PD.08,41;MM;MM0,53;MM006,100;MM-70,175;SR800;AC5;`. Everything that no public source tells is in
the machine's profile and listed there as unverified.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats import header
from fdjax.formats.assembly import layer_mark, road_mark
from fdjax.formats.profile import Machine, Sml
from fdjax.formats.sml_codes import Carry, codes_of, counts_of, ends, fit_road, steps_of
from fdjax.formats.sml_reader import read
from fdjax.formats.template import fill
from fdjax.plan.toolpath import Build, Road
from fdjax.units import MICROSTEP

__all__ = ["fit", "read", "write"]


def fit(build: Build, machine: Machine) -> Build:
    """The build as its SML file can hold it.

    Points and z's are rounded to microsteps on the bed and widths to the sections that flow codes
    give. A road of uniform width gets one code; where the width varies, runs of segments that ask
    for nearly the same get one. What rounding adds or takes is made good by the runs and roads
    that follow, so the mean section is kept of the build, and of each material and sub-domain. A
    road of more than 200 segments, 32 output changes or 524,272 microsteps is cut at its points
    into roads that touch end to start.

    Raises `InputError` for a machine without an [sml] table, points out of range, sections that
    no flow code gives, or a material that the machine lacks.
    """
    sml = _table(machine)
    origin = np.asarray(build.origin)
    carries: defaultdict[tuple[int, int], Carry] = defaultdict(Carry)
    layers = []
    for index, layer in enumerate(build.layers):
        roads = []
        for road, owner in zip(layer.roads, layer.owners.tolist(), strict=True):
            if not 0 <= road.material < len(sml.materials):
                raise InputError(
                    f"layer {index + 1}: material {road.material}, but {machine.name} has "
                    f"{len(sml.materials)}, counted from 0"
                )
            try:
                carry = carries[road.material, owner]
                roads += fit_road(road, layer.height, origin, sml, carry)
            except InputError as error:
                raise InputError(f"layer {index + 1}: {error}") from None
        z = round(layer.z / MICROSTEP) * MICROSTEP
        layers.append(replace(layer, z=z, roads=tuple(roads)))
    return build.replace(layers=tuple(layers))


def _table(machine: Machine) -> Sml:
    if machine.sml is None:
        raise InputError(f"machine {machine.name} writes no SML: its profile has no [sml]")
    return machine.sml


def write(build: Build, machine: Machine) -> str:
    """The SML file of `fit(build, machine)`.

    Its comment lines start with the profile's `sml.comment`; SML is not known to have comments,
    so whoever sends the file to a machine strips them. Raises what `fit` raises.
    """
    build = fit(build, machine)
    sml = _table(machine)
    values = {
        "layers": len(build.layers),
        "speed": sml.speed,
        "travel_speed": sml.travel_speed,
        "acceleration": sml.acceleration,
    }
    out = header.lines(sml.comment, header.of_build(build, machine.name))
    out += fill(sml.header, values)
    head = _Head(out, sml, np.asarray(build.origin))
    outline = ""
    for layer in build.layers:
        head.flow_off()
        text = header.outline_text(layer.outline)
        if text != outline:
            out += header.lines(sml.comment, {"outline": text})
            outline = text
        out.append(layer_mark(sml.comment, layer))
        out += fill([sml.layer], {"z": round(layer.z / MICROSTEP)})
        for road in layer.roads:
            head.lay(road, layer.height)
    head.flow_off()
    out += fill(sml.footer, values)
    out += [f"{sml.comment} fdjax end", ""]
    return "\n".join(out)


class _Head:
    """Where the head is, and with which material, while a file is written."""

    def __init__(self, out: list[str], sml: Sml, origin: NDArray[np.float64]) -> None:
        self._out = out
        self._sml = sml
        self._origin = origin
        self._at: tuple[int, int] | None = None  # end of the last road, until its flow is off
        self._material: int | None = None

    def flow_off(self) -> None:
        """Stop the flow, and clear what PD and MM would do on the next move, if a road was laid."""
        if self._at is not None:
            self._out += [*self._sml.stop, "PD;MM;"]
            self._at = None

    def lay(self, road: Road, height: float) -> None:
        """Write one fitted road, with what must come before it."""
        sml = self._sml
        steps = steps_of(road, self._origin)
        start, end = ((int(x), int(y)) for x, y in steps[[0, -1]])
        if start != self._at or road.material != self._material:
            self.flow_off()
            if road.material != self._material:
                self._out.append(sml.materials[road.material])
                self._material = road.material
            self._out.append(f"SR{sml.travel_speed};MA{start[0]},{start[1]};")
        self._out += [
            road_mark(sml.comment, road),
            _set_up(steps, codes_of(road, height, sml), sml),
            "BC;",
            *(f"MA{x},{y};" for x, y in steps[1:].tolist()),
            "EC;",
        ]
        self._at = end


def _set_up(steps: NDArray[np.int64], codes: NDArray[np.int64], sml: Sml) -> str:
    counts = counts_of(steps)
    start, rollback = ends(int(counts[-1]), sml)
    changes = np.flatnonzero(np.diff(codes)) + 1
    outputs = [(0, sml.start_code), (start, int(codes[0]))]
    outputs += [(int(counts[k]), int(codes[k])) for k in changes]
    text = "".join(f"MM{count},{code};" for count, code in outputs)
    return (
        f"{sml.mark}PD{sml.pre_delay:g},{sml.pre_code};MM;{text}"
        f"MM-{rollback},{sml.rollback_code};SR{sml.speed};AC{sml.acceleration};"
    )
