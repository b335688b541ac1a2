"""The tower that primes tools: a square beside the part, laid solid as far up as tools change."""

from collections.abc import Sequence

import numpy as np
import shapely

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.plan.toolpath import Build, Layer, Road

_WIDE = 1.2
"""Width of the tower's roads, in bores of the nozzle."""

_APART = 1.0
"""The tower keeps so far from the part, mm."""


def towers(build: Build, machine: Machine) -> list[list[Road]]:
    """Roads of the tower on each layer, machine coordinates, one for each change of tool there.

    A layer without a change below one that has some holds one road, for the tool in use. Raises
    `InputError` where the tower stands on the part or beyond the bed.
    """
    assert machine.gcode is not None
    tower = machine.gcode.tower
    counts, tool = [], 0
    for layer in build.layers:
        before = tool
        order = [tool, *(road.material for road in layer.roads)]
        counts.append(int(np.count_nonzero(np.diff(order))))
        tool = order[-1] if layer.roads else before
    last = max((k for k, count in enumerate(counts) if count), default=-1)
    if tower is None or last < 0:
        return [[] for _ in counts]
    width = _WIDE * machine.nozzle
    _check(build, machine, width)
    return [
        _roads(tower.at, tower.side, width, max(count, 1)) if number <= last else []
        for number, count in enumerate(counts)
    ]


def _roads(at: tuple[float, float], side: float, width: float, count: int) -> list[Road]:
    """So many zigzags, one beside the other, that fill a square."""
    lines = max(round(side / width), 2 * count)
    places = width / 2 + np.arange(lines) * width
    made = []
    for own in np.array_split(places, count):
        ends = np.tile([width / 2, side - width / 2], (len(own), 1))
        ends[1::2] = ends[1::2, ::-1]
        corner = np.asarray(at, float)
        xy = np.stack([corner[0] + np.repeat(own, 2), corner[1] + ends.ravel()], 1)
        made.append(Road(xy, np.full(len(xy) - 1, width)))
    return made


def _check(build: Build, machine: Machine, width: float) -> None:
    assert machine.gcode is not None
    assert machine.gcode.tower is not None
    (x, y), side = machine.gcode.tower.at, machine.gcode.tower.side
    square = shapely.box(x, y, x + side + width, y + side)
    (x0, y0, _), (x1, y1, _) = machine.room
    if not shapely.box(x0, y0, x1, y1).covers(square):
        raise InputError(f"prime tower: at ({x:g}, {y:g}), {side:g} mm wide, it leaves the bed")
    where = np.asarray(build.origin)
    if any(_near(layer, square, where) for layer in build.layers):
        raise InputError(
            f"prime tower: at ({x:g}, {y:g}), {side:g} mm wide, it stands on the part or nearer "
            f"than {_APART:g} mm; gcode.tower.at in the machine's profile moves it"
        )


def _near(layer: Layer, square: shapely.Polygon, origin: np.ndarray) -> bool:
    roads: Sequence[Road] = layer.roads
    return any(
        shapely.distance(shapely.LineString(road.path + origin), square)
        < _APART + float(road.width.max()) / 2
        for road in roads
    )
