"""Which material each road is laid with, and in which order, so that tools change seldom."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.plan.laid import shortest_road
from fdjax.plan.material_runs import Cuts, Owed, Run, at_nodes, runs_of
from fdjax.plan.order import order_roads
from fdjax.plan.toolpath import Build, Layer, Road

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

_FINE = 0.5
"""Where a road is split it is looked at every so many of its widths."""

_DRAWS, _MET = 32, 2e-3
"""So many draws at most until one meets its share to this share of the whole volume."""


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
    """Above for a share of the volume, of roads drawn at random with a seed.

    Some of the roads drawn are then exchanged so that the share is met as well as whole roads can.
    """

    share: float
    seed: int

    def __call__(self, xyz: Floats, volumes: Floats) -> Bools:
        chance = np.random.default_rng(self.seed)
        goal = self.share * float(volumes.sum())
        best, missed = np.zeros(len(volumes), bool), abs(goal)
        for _ in range(_DRAWS):
            if missed <= _MET * float(volumes.sum()):
                break
            order = chance.permutation(len(volumes))
            above = np.zeros(len(volumes), bool)
            # A road counts if more than half of it is still asked for.
            above[order] = np.cumsum(volumes[order]) - volumes[order] / 2 < goal
            _balance(above, volumes, goal, order)
            if (off := abs(float(volumes[above].sum()) - goal)) < missed:
                best, missed = above, off
        return best


def _balance(above: Bools, volumes: Floats, goal: float, order: Ints) -> None:
    """Move single roads across, or exchange two, while that brings the volume above nearer."""
    while True:
        over = float(volumes[above].sum()) - goal
        # None stands for a road of no volume.
        high, low = order[above[order]], order[~above[order]]
        given = np.append(0.0, volumes[high])
        rank = np.argsort(volumes[low], kind="stable")
        taken = np.append(0.0, volumes[low][rank])
        wanted = given - over
        at = np.clip(np.searchsorted(taken, wanted), 1, len(taken)) - 1
        at = np.stack([at, np.minimum(at + 1, len(taken) - 1)])
        left = np.abs(taken[at] - wanted)
        side, one = np.unravel_index(np.argmin(left), left.shape)
        if not left[side, one] < abs(over) * (1 - 1e-9):
            return
        other = at[side, one]
        if one:
            above[high[one - 1]] = False
        if other:
            above[low[rank[other - 1]]] = True


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


def numbered(rules: Sequence[Rule], xyz: Floats, volumes: Floats) -> Ints:
    """Which material each of some roads is of, counted from 0, shape (n,).

    - `rules`: the first says which are above the first material, the next which of these are above
      the second, and so on; `xyz`: centres (n, 3), mm; `volumes`: (n,), mm^3.

    >>> numbered([ByPlace(lambda x, y, z: x)], np.array([[-1.0, 0, 0], [1, 0, 0]]), np.ones(2))
    array([0, 1])
    """
    found = np.zeros(len(volumes), int)
    for number, rule in enumerate(rules):
        own = np.flatnonzero(found == number)
        found[own[rule(xyz[own], volumes[own])]] = number + 1
    return found


def assigned(
    build: Build,
    rules: Sequence[Rule],
    tools: Sequence[int],
    *,
    split: bool = False,
    least_road: float = 0,
    shares: Sequence[float] | None = None,
) -> Build:
    """The build with each road of one of several materials, by its centre, and few changes of tool.

    - `rules`: as `numbered` takes them, one fewer than materials; `tools`: of each material.
    - `split`: roads are cut where the material changes, to half a road's width; of roads drawn by
      chance one is cut so that the share is met. A piece shorter than three widths or than
      `least_road`, mm, takes the material of its neighbours or grows, as keeps the shares. Roads of
      a graph are cut at their nodes where these are nearer than a road is wide.
    - `shares`: of each material by volume. Where the roads hold a little more or less there than
      a function asks, some cuts are moved by up to half a road's width so that these are met.

    A layer begins with the material with which the one below it ended: so of two there is at most
    one change a layer, and layers alternate which comes first.
    """
    build = _each(build, lambda road: 0)
    for number, rule in enumerate(rules):
        if split and not isinstance(rule, ByChance):
            beyond = None if shares is None else sum(shares[number + 1 :]) * build.volume
            build = _split(build, number, rule, least_road, beyond)
            continue
        build = _whole(build, number, rule)
        if split and isinstance(rule, ByChance):
            build = _met(build, number, rule.share, least_road)
    layers, last = [], 0
    for layer, above in zip(build.layers, [*build.layers[1:], None], strict=True):
        roads: list[Road] = []
        for number in _sequence(layer, above, last):
            own = [road for road in layer.roads if road.material == number]
            if len(own) < len(layer.roads):
                own = order_roads(own, start=roads[-1].path[-1] if roads else None)
            roads += own
            last = number
        layers.append(replace(layer, roads=tuple(roads)))
    return _each(build.replace(layers=tuple(layers)), lambda road: tools[road.material])


def _each(build: Build, material: Callable[[Road], int]) -> Build:
    """The build with another material of each road."""
    return build.replace(
        layers=tuple(
            replace(layer, roads=tuple(replace(r, material=material(r)) for r in layer.roads))
            for layer in build.layers
        )
    )


def _sequence(layer: Layer, above: Layer | None, last: int) -> list[int]:
    """The order of a layer's materials: the last one first, and at the end one of the next layer's
    where it has some.
    """
    own = set(layer.materials.tolist())
    first = [last] if last in own else []
    rest = sorted(own.difference(first))
    after = set() if above is None else set(above.materials.tolist())
    ends = [each for each in rest if each in after]
    if ends and rest[-1] not in after:
        rest.remove(ends[-1])
        rest.append(ends[-1])
    return first + rest


def changes(build: Build) -> int:
    """How often the material changes on the way through a build.

    >>> changes(Build(()))
    0
    """
    order = [road.material for layer in build.layers for road in layer.roads]
    return int(np.count_nonzero(np.diff(order)))


def _whole(build: Build, number: int, rule: Rule) -> Build:
    """Of the roads of one material those that a rule calls above of the next."""
    places, volumes = centres(build)
    own = np.concatenate([np.zeros(0), *(layer.materials for layer in build.layers)]) == number
    above = iter(rule(places[own], volumes[own]).tolist())
    return _each(
        build, lambda road: number + next(above) if road.material == number else road.material
    )


def _met(build: Build, number: int, share: float, least_road: float) -> Build:
    """One road, the largest that helps, cut so that of what is of one material and of the next
    this one has its share.
    """
    below, next_to = (
        sum(float(layer.road_volumes[layer.materials == each].sum()) for layer in build.layers)
        for each in (number, number + 1)
    )
    heaviest, over = (0.0, 0, 0), next_to - share * (below + next_to)
    for k, layer in enumerate(build.layers):
        helps = np.where(layer.materials == number + (over > 0), layer.road_volumes, 0.0)
        if helps.max(initial=0.0) > heaviest[0]:
            heaviest = float(helps.max()), k, int(np.argmax(helps))
    if abs(over) <= _MET * build.volume or not heaviest[0]:
        return build
    _, at, k = heaviest
    layer = build.layers[at]
    road = layer.roads[k]
    steps = _Steps.of(road)
    reach = np.cumsum(steps.volumes(layer.height))
    above = (reach > abs(over)) == (over > 0)
    pieces = steps.cut(above, least_road, Owed()).pieces(number)
    layer = replace(layer, roads=(*layer.roads[:k], *pieces, *layer.roads[k + 1 :]))
    return build.replace(layers=(*build.layers[:at], layer, *build.layers[at + 1 :]))


def _split(build: Build, number: int, rule: Rule, least_road: float, beyond: float | None) -> Build:
    """The roads of one material cut where a rule changes; `beyond`: volume asked of what lies
    above it, mm^3.
    """
    owed = Owed()
    roads: dict[Road, _Cut] = {}
    lying, cuts = 0.0, Cuts()
    for layer in build.layers:
        z = layer.z - layer.height / 2
        for road in layer.roads:
            if road.material != number:
                continue
            steps = _Steps.of(road)
            above = rule(np.column_stack([steps.middles, np.full(len(steps.size), z)]), steps.size)
            roads[road] = cut = steps.cut(above, least_road, owed)
            volumes = cut.steps.volumes(layer.height)
            lying += sum(float(volumes[a:b].sum()) for a, b, over in cut.runs if over)
            if not road.of_graph:
                cuts.add(cut.runs, cut.steps.size, volumes, shortest_road(road.width, least_road))
    if beyond is not None:
        cuts.move(beyond - lying)
    layers = [
        replace(
            layer,
            roads=tuple(
                piece
                for road in layer.roads
                for piece in (roads[road].pieces(number) if road in roads else [road])
            ),
        )
        for layer in build.layers
    ]
    return build.replace(layers=tuple(layers))


@dataclass(frozen=True, eq=False)
class _Steps:
    """A road in steps of half its width.

    - `owner`: the segment of each; `start`: where it begins, (n, 2); `size`: its length; mm.
    """

    road: Road
    owner: Ints
    start: Floats
    size: Floats

    @classmethod
    def of(cls, road: Road) -> "_Steps":
        path, length = road.path, road.segment_lengths
        count = np.maximum(np.ceil(length / (_FINE * road.width)), 1).astype(int)
        owner = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        start = path[:-1][owner] + (step / count[owner])[:, None] * np.diff(path, axis=0)[owner]
        return cls(road, owner, start, (length / count)[owner])

    @property
    def middles(self) -> Floats:
        along = np.diff(self.road.path, axis=0) / self.road.segment_lengths[:, None]
        return self.start + self.size[:, None] / 2 * along[self.owner]

    def volumes(self, height: float) -> Floats:
        """Of each step in a layer of this height, mm^3."""
        return self.road.areas(height)[self.owner] * self.size

    def cut(self, above: Bools, least: float, owed: Owed) -> "_Cut":
        """Where `above`, (n,), changes between the steps."""
        steps = self
        if (above != above[0]).any() and self.road.closed:
            # A closed road begins where the material changes.
            first = int(np.flatnonzero(above != np.roll(above, 1))[0])
            steps = replace(
                self,
                owner=np.roll(self.owner, -first),
                start=np.roll(self.start, -first, 0),
                size=np.roll(self.size, -first),
            )
            above = np.roll(above, -first)
        shortest = shortest_road(self.road.width, least)
        runs = runs_of(above, steps.size, shortest, owed)
        if self.road.of_graph and len(runs) > 1:
            corners = np.flatnonzero(np.diff(steps.owner)) + 1
            widest = float(self.road.width.max())
            runs = at_nodes(runs, corners, steps.size, shortest, widest, owed)
        return _Cut(steps, runs)


class _Cut(NamedTuple):
    """The steps of a road and the runs of them that it is cut into."""

    steps: _Steps
    runs: list[Run]

    def pieces(self, number: int) -> list[Road]:
        """Roads: what is above is of the material behind that of this number, the rest of this."""
        (road, owner, start) = self.steps.road, self.steps.owner, self.steps.start
        if len(self.runs) == 1:
            return [replace(road, material=number + int(self.runs[0][2]))]
        end = np.concatenate([start[1:], start[:1] if road.closed else road.path[-1:]])
        made = []
        for first, last, over in self.runs:
            # A corner, and a width, begins where the owner changes.
            corner = np.append(True, np.diff(owner[first:last]) != 0)
            keep = np.flatnonzero(corner) + first
            xy = np.concatenate([start[keep], end[last - 1 : last]])
            section = None if road.section is None else road.section[owner[keep]]
            made.append(
                replace(
                    road, xy=xy, width=road.width[owner[keep]], section=section, closed=False,
                    material=number + int(over),
                )
            )  # fmt: skip
        return made
