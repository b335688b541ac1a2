"""The tower that primes tools: a square beside the part, laid solid as far up as tools change."""

import numpy as np
import shapely
import shapely.affinity

from fdjax.errors import InputError
from fdjax.formats.profile import Machine, Tower
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.road.bead import section_area

_WIDE = 1.2
"""Width of the tower's roads, in bores of the nozzle."""

_APART = 1.0
"""The tower keeps so far from the part, mm."""


def towers(build: Build, machine: Machine) -> list[list[Road]]:
    """Roads of the tower on each layer, machine coordinates, one for each change of tool there.

    A layer without a change below one that has some holds one road, for the tool in use. The tower
    is as wide on all layers, so wide that each change lays what it is to purge. Raises `InputError`
    where it stands on the part or beyond the bed.
    """
    assert machine.gcode is not None
    tower = machine.gcode.tower
    counts, tool = [], None
    for layer in build.layers:
        order = [road.material for road in layer.roads]
        order = order if tool is None else [tool, *order]
        counts.append(int(np.count_nonzero(np.diff(order))))
        tool = order[-1] if order else None
    last = max((k for k, count in enumerate(counts) if count), default=-1)
    if tower is None or last < 0:
        return [[] for _ in counts]
    width = _WIDE * machine.nozzle
    lines = _lines(tower, width, build, counts)
    _check(build, machine, lines * width)
    return [
        _roads(tower.at, lines, width, max(count, 1)) if number <= last else []
        for number, count in enumerate(counts)
    ]


def _lines(tower: Tower, width: float, build: Build, counts: list[int]) -> int:
    """How many lines side by side make the tower, each as long as they are wide together."""
    lines = max(round(tower.side / width), 2 * max(counts))
    for layer, count in zip(build.layers, counts, strict=True):
        section = float(section_area(width, layer.height))
        # Of the shortest zigzag: its lines, and the steps between them.
        while count and (section * width * ((lines // count) * lines - 1) < tower.purge):
            lines += 1
    return lines


def _roads(at: tuple[float, float], lines: int, width: float, count: int) -> list[Road]:
    """So many zigzags, one beside the other, that fill a square."""
    places = width / 2 + np.arange(lines) * width
    made = []
    for own in np.array_split(places, count):
        ends = np.tile([width / 2, lines * width - width / 2], (len(own), 1))
        ends[1::2] = ends[1::2, ::-1]
        corner = np.asarray(at, float)
        xy = np.stack([corner[0] + np.repeat(own, 2), corner[1] + ends.ravel()], 1)
        made.append(Road(xy, np.full(len(xy) - 1, width)))
    return made


def _check(build: Build, machine: Machine, side: float) -> None:
    assert machine.gcode is not None
    assert machine.gcode.tower is not None
    x, y = machine.gcode.tower.at
    square = shapely.box(x, y, x + side, y + side)
    (x0, y0, _), (x1, y1, _) = machine.room
    where = f"prime tower: at ({x:g}, {y:g}), {side:.3g} mm wide, it"
    if not shapely.box(x0, y0, x1, y1).covers(square):
        raise InputError(f"{where} leaves the bed")
    on_part = shapely.affinity.translate(square, *(-np.asarray(build.origin)))
    if any(_near(layer, on_part) for layer in build.layers):
        raise InputError(
            f"{where} stands on the part or nearer than {_APART:g} mm; gcode.tower.at in the "
            "machine's profile moves it"
        )


def _near(layer: Layer, square: shapely.Polygon) -> bool:
    if not layer.roads:
        return False
    paths = [road.path for road in layer.roads]
    owner = np.repeat(np.arange(len(paths)), [len(path) for path in paths])
    lines = shapely.linestrings(np.concatenate(paths), indices=owner)
    wide = np.array([road.width.max() for road in layer.roads])
    return bool((shapely.distance(lines, square) < _APART + wide / 2).any())
