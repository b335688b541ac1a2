"""Which material each road is laid with, and in which order, so that tools change seldom."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.plan.laid import shortest_road
from fdjax.plan.order import order_roads
from fdjax.plan.toolpath import Build, Layer, Road

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_FINE = 0.5
"""Where a road is split it is looked at every so many of its widths."""


@dataclass(frozen=True, eq=False)
class ByPlace:
    """Above or below by the sign of a function at a place, 0 is above.

    `function(x, y, z)` takes and gives arrays (n,), mm; `name`: what it is called. Raises
    `InputError` where it is not finite.
    """

    function: Callable[[Floats, Floats, Floats], Floats]
    name: str = "function"

    def __call__(self, xyz: Floats, volumes: Floats) -> Bools:
        with np.errstate(all="ignore"):
            value = np.broadcast_to(self.function(*xyz.T), len(xyz))
        bad = ~np.isfinite(value)
        if bad.any():
            x, y, z = xyz[bad][0]
            raise InputError(
                f"materials: the {self.name} is {value[bad][0]} at ({x:.4g}, {y:.4g}, {z:.4g}) mm; "
                "it must be finite wherever a road is"
            )
        return value >= 0


@dataclass(frozen=True)
class ByChance:
    """Above for a share of the volume, of roads drawn at random with a seed."""

    share: float
    seed: int

    def __call__(self, xyz: Floats, volumes: Floats) -> Bools:
        order = np.random.default_rng(self.seed).permutation(len(volumes))
        drawn = np.cumsum(volumes[order])
        above = np.zeros(len(volumes), bool)
        if len(volumes):
            # A road counts if more than half of it is still asked for.
            above[order] = drawn - volumes[order] / 2 < self.share * drawn[-1]
        return above


Rule = ByPlace | ByChance
"""Whether roads lie above: called with their centres (n, 3), mm, and volumes (n,), mm^3."""


def centre(road: Road) -> Floats:
    """Centre point (2,) of a road: of what a closed one encloses, half way along an open one.

    >>> centre(Road(np.array([(0.0, 0.0), (4, 0), (4, 2)]), 0.4)).tolist()
    [3.0, 0.0]
    """
    if road.closed and len(road.xy) > 2:
        polygon = shapely.Polygon(road.xy)
        if polygon.area > 0:
            return shapely.get_coordinates(polygon.centroid)[0]
    middle = shapely.line_interpolate_point(shapely.LineString(road.path), 0.5, normalized=True)
    return shapely.get_coordinates(middle)[0]


def centres(build: Build) -> tuple[Floats, Floats]:
    """Centres (n, 3), mm, and volumes (n,), mm^3, of all roads, layer by layer."""
    places = [
        (*centre(road), layer.z - layer.height / 2)
        for layer in build.layers
        for road in layer.roads
    ]
    volumes = [np.zeros(0), *(layer.road_volumes for layer in build.layers)]
    return np.array(places).reshape(-1, 3), np.concatenate(volumes)


def assigned(
    build: Build, rule: Rule, tools: tuple[int, int], *, split: bool = False, least_road: float = 0
) -> Build:
    """The build with each road of one of two materials, by its centre, and few changes of tool.

    - `tools`: numbers of the material below and the one above.
    - `split`: roads are cut where the material changes, to half a road's width. A piece shorter
      than three widths or than `least_road`, mm, takes the material of its neighbours.

    A layer begins with the material with which the one below it ended: so there is at most one
    change a layer, and layers alternate which comes first.
    """
    if split:
        build = build.replace(
            layers=tuple(_split(layer, rule, least_road) for layer in build.layers)
        )
    else:
        above = rule(*centres(build))
        number = np.concatenate([[0], np.cumsum([len(layer.roads) for layer in build.layers])])
        build = build.replace(
            layers=tuple(
                replace(
                    layer,
                    roads=tuple(
                        replace(road, material=int(over))
                        for road, over in zip(layer.roads, above[first:], strict=False)
                    ),
                )
                for layer, first in zip(build.layers, number, strict=False)
            )
        )
    layers, last = [], 0
    for layer in build.layers:
        roads: list[Road] = []
        for which in (last, 1 - last):
            own = [
                replace(road, material=tools[which])
                for road in layer.roads
                if road.material == which
            ]
            if len(own) < len(layer.roads):
                own = order_roads(own, start=roads[-1].path[-1] if roads else None)
            roads += own
            last = which if own else last
        layers.append(replace(layer, roads=tuple(roads)))
    return build.replace(layers=tuple(layers))


def changes(build: Build) -> int:
    """How often the material changes on the way through a build.

    >>> changes(Build(()))
    0
    """
    order = [road.material for layer in build.layers for road in layer.roads]
    return int(np.count_nonzero(np.diff(order)))


def _split(layer: Layer, rule: Rule, least_road: float) -> Layer:
    roads: list[Road] = []
    z = layer.z - layer.height / 2
    for road in layer.roads:
        path, length = road.path, road.segment_lengths
        count = np.maximum(np.ceil(length / (_FINE * road.width)), 1).astype(int)
        owner = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        along = path[:-1][owner], np.diff(path, axis=0)[owner]
        start = along[0] + (step / count[owner])[:, None] * along[1]
        middle = along[0] + ((step + 0.5) / count[owner])[:, None] * along[1]
        size = (length / count)[owner]
        above = rule(np.column_stack([middle, np.full(len(owner), z)]), size)
        roads += _pieces(road, owner, start, size, above, least_road)
    return replace(layer, roads=tuple(roads))


def _pieces(
    road: Road, owner: NDArray[np.intp], start: Floats, size: Floats, above: Bools, least: float
) -> list[Road]:
    """A road cut where `above` changes between the steps that begin at `start`."""
    if not (above != above[0]).any():
        return [replace(road, material=int(above[0]))]
    if road.closed:
        # A closed road begins where the material changes.
        first = int(np.flatnonzero(above != np.roll(above, 1))[0])
        owner, size = np.roll(owner, -first), np.roll(size, -first)
        start, above = np.roll(start, -first, 0), np.roll(above, -first)
    runs = _runs(above, size, shortest_road(road.width, least))
    if len(runs) == 1:
        return [replace(road, material=int(above[runs[0][0]]))]
    end = np.concatenate([start[1:], start[:1] if road.closed else road.path[-1:]])
    made = []
    for first, last, over in runs:
        # A corner, and a width, begins where the owner changes.
        corner = np.append(True, np.diff(owner[first:last]) != 0)
        keep = np.flatnonzero(corner) + first
        xy = np.concatenate([start[keep], end[last - 1 : last]])
        section = None if road.section is None else road.section[owner[keep]]
        made.append(
            replace(
                road, xy=xy, width=road.width[owner[keep]], section=section, closed=False,
                material=int(over),
            )
        )  # fmt: skip
    return made


def _runs(above: Bools, size: Floats, shortest: float) -> list[tuple[int, int, bool]]:
    """First step, the one beyond the last, and the material of each piece; none too short."""
    cut = [0, *(np.flatnonzero(np.diff(above)) + 1).tolist(), len(above)]
    runs = [(a, b, bool(above[a])) for a, b in pairwise(cut)]
    reach = np.concatenate([[0.0], np.cumsum(size)])

    def length(run: tuple[int, int, bool]) -> float:
        return float(reach[run[1]] - reach[run[0]])

    while len(runs) > 1:
        k = min(range(len(runs)), key=lambda k: length(runs[k]))
        if length(runs[k]) >= shortest:
            break
        sides: Sequence[int] = [j for j in (k - 1, k + 1) if 0 <= j < len(runs)]
        over = runs[max(sides, key=lambda j: length(runs[j]))][2]
        low, high = min(k, *sides), max(k, *sides)
        runs[low : high + 1] = [(runs[low][0], runs[high][1], over)]
    return runs
