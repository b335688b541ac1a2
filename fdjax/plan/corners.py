"""Corners of turn-arounds cut short, where the windows along a wall hold more than is asked.

A line turns around at a wall by a piece of road along it. Where lines are far apart such pieces
put more at the wall than is asked, within less than the density of lines can change over. A
straight cut from leg to leg of a corner lays less, and lays it further in.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.plan.compare import compare
from fdjax.plan.laid import shortest_road
from fdjax.plan.measure import measure
from fdjax.plan.toolpath import Build, Layer, Road

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_SHARP = np.deg2rad(40)
"""Lines turn by less at each of their points, turn-arounds by more at each of their corners."""
_LEG = 0.45
"""Largest leg of a cut, as a share of the way to the next corner."""
_NEAR_WALL = 0.99
"""A cut keeps this share of half a road's width from walls, as turn-arounds themselves do."""
_LEAST = 1e-3
"""Shorter legs, mm, are not worth a point."""
_SHIFTS = (0.0, 0.0), (0.5, 0.5), (0.5, 0.0), (0.0, 0.5)
"""Windows are looked at at every half of their side, so that none is favoured."""
_ROUNDS = 80
"""Of projected gradients with momentum: the gain is then within a thousandth of the best."""


@dataclass(frozen=True, eq=False)
class _Corners:
    """Corners of one road, at which it may be cut.

    - `at`: position along the path, mm; `place`: shape (corners, 2), mm; `turn`: angle, radians.
    - `leg`: largest leg, mm; `ends`: both ends of the largest cut, shape (corners, 2, 2), mm.
    - `section`: of the road before the corner, mm^2.
    """

    at: Floats
    place: Floats
    turn: Floats
    leg: Floats
    ends: Floats
    section: Floats

    @property
    def saved(self) -> Floats:
        """Volume saved by a leg of 1 mm, mm^3: two legs less the third side of their triangle."""
        return self.section * 2 * (1 - np.cos(self.turn / 2))


def cut_corners(
    build: Build,
    target: Callable[..., Any],
    *,
    window: float,
    clearance: float | None = None,
    least: float = 0.0,
    least_road: float = 0.0,
) -> Build:
    """The build with the corners of its turn-arounds cut by as much as brings windows nearest.

    Compared with the porosity `target(x, y[, z])` are square windows of side `window`, mm, at every
    half of their side, all layers together, in the mean square; a leg is at most 0.45 of the way to
    the next corner. No cut comes nearer than `clearance`, mm (None: the widest road's width), to
    other lines or leaves the outline, no road becomes shorter than `least_road`, mm, and the build
    keeps at least the volume `least`, mm^3. Roads of the families "xi" and "eta" alone turn around;
    others are left as they are.

    Raises `InputError` for a build without outlines, as `measure` does.
    """
    found = [_corners_of(layer, clearance) for layer in build.layers]
    every = [each for some in found for each in some.values()]
    if not every:
        return build
    saved = np.concatenate([each.saved for each in every])
    place = np.concatenate([each.place for each in every])
    most = np.concatenate([each.leg for each in every])
    leg = _legs(build, target, window, place, saved, most)
    allowed = max(build.volume - least, 0.0)
    leg *= min(1.0, allowed / max(float(saved @ leg), 1e-300))
    layers = []
    for layer, some in zip(build.layers, found, strict=True):
        roads = list(layer.roads)
        for number, corners in some.items():
            own, leg = np.split(leg, [len(corners.at)])
            cut = _cut(roads[number], corners.at, own)
            if cut.length >= shortest_road(cut.width, least_road):
                roads[number] = cut
        layers.append(replace(layer, roads=tuple(roads)))
    return build.replace(layers=tuple(layers))


def _corners_of(layer: Layer, clearance: float | None) -> dict[int, _Corners]:
    """Corners of the roads of a layer that has any, by the road's index."""
    found: dict[int, _Corners] = {}
    runs: list[Any] = []
    number: list[int] = []
    for index, road in enumerate(layer.roads):
        if road.family not in ("xi", "eta"):
            continue
        corners, pieces = _of_road(road, layer.height)
        if len(corners.at):
            found[index] = corners
        number += [index] * len(pieces)
        runs += pieces
    if not found:
        return {}
    if clearance is None:
        clearance = max(float(layer.roads[index].width.max()) for index in found)
    free = _free(layer, found, runs, np.array(number), clearance)
    return {
        index: replace(corners, leg=np.where(free[index], corners.leg, 0.0))
        for index, corners in found.items()
    }


def _of_road(road: Road, height: float) -> tuple[_Corners, list[Any]]:
    """Corners of a road, and its path from corner to corner as lines."""
    path = road.path
    step = np.diff(path, axis=0)
    at = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
    way = np.arctan2(step[:, 1], step[:, 0])
    turn = (np.diff(way) + np.pi) % (2 * np.pi) - np.pi
    sharp = np.flatnonzero(np.abs(turn) > _SHARP) + 1
    bounds = np.concatenate([[0], sharp, [len(path) - 1]])
    gap = np.diff(at[bounds])
    # Two corners the same way turn around; one there and one back do not.
    alike = np.diff(np.sign(turn[sharp - 1])) == 0
    around = np.concatenate([alike, [False]]) | np.concatenate([[False], alike])
    leg = np.where(around[: len(sharp)], _LEG * np.minimum(gap[:-1], gap[1:]), 0.0)
    ends = _along(path, at, np.stack([at[sharp] - leg, at[sharp] + leg], 1))
    section = np.broadcast_to(road.areas(height), way.shape)[sharp - 1]
    corners = _Corners(at[sharp], path[sharp], np.abs(turn[sharp - 1]), leg, ends, section)
    pieces = [shapely.linestrings(path[a : b + 1]) for a, b in pairwise(bounds)]
    return corners, pieces


def _along(path: Floats, at: Floats, position: Floats) -> Floats:
    """Points of a path at these positions, shape (..., 2)."""
    return np.stack([np.interp(position, at, path[:, axis]) for axis in (0, 1)], -1)


def _free(
    layer: Layer, found: dict[int, _Corners], runs: Sequence[Any], road: Ints, clearance: float
) -> dict[int, NDArray[np.bool_]]:
    """Which corners of each road may be cut: no other line is near or within, nor a wall."""
    first = {index: int(np.flatnonzero(road == index)[0]) for index in found}
    before = np.concatenate(
        [first[index] + np.arange(len(each.at)) for index, each in found.items()]
    )
    ends = np.concatenate([each.ends for each in found.values()])
    place = np.concatenate([each.place for each in found.values()])
    cuts = shapely.linestrings(ends)
    inner = shapely.polygons(np.concatenate([ends, place[:, None]], 1))
    tree = shapely.STRtree(runs)
    met = [
        tree.query(cuts, predicate="dwithin", distance=clearance),
        tree.query(inner, predicate="intersects"),
    ]
    corner, run = np.concatenate(met, 1)
    # The line before, the turn-around and the line after are its own.
    own = (road[run] == road[before[corner]]) & (np.abs(run - before[corner] - 0.5) < 2)
    free = np.ones(len(before), bool)
    free[corner[~own]] = False
    if layer.outline is not None:
        wall = shapely.boundary(layer.outline)
        half = np.concatenate([
            np.full(len(each.at), layer.roads[index].width.max() / 2)
            for index, each in found.items()
        ])  # fmt: skip
        free &= shapely.distance(wall, cuts) > _NEAR_WALL * half
    counts = np.cumsum([len(each.at) for each in found.values()])[:-1]
    return dict(zip(found, np.split(free, counts), strict=True))


def _legs(
    build: Build,
    target: Callable[..., Any],
    window: float,
    place: Floats,
    saved: Floats,
    most: Floats,
) -> Floats:
    """Leg of each corner, mm: least squares over all windows within 0 and the largest legs."""
    # What each corner saves counts in the window of each lattice that it lies in.
    index, excess, room = [], [], []
    for shift in _SHIFTS:
        measured = measure(build, window=window, shift=shift)
        asked = compare(measured, target).asked
        size = measured.area * measured.height
        over = np.where(measured.kept, measured.volume - (1 - asked) * size, 0.0)
        x, y = (
            np.clip(np.searchsorted(edges, place[:, axis], side="right") - 1, 0, len(edges) - 2)
            for axis, edges in enumerate((measured.x, measured.y))
        )
        index.append(x * (len(measured.y) - 1) + y + sum(map(len, excess)))
        excess.append(over.ravel())
        room.append(np.where(measured.kept, size, np.inf).ravel())
    owner, over, room = np.array(index), np.concatenate(excess), np.concatenate(room)

    def off(leg: Floats) -> Floats:
        laid = over - np.bincount(owner.ravel(), np.tile(saved * leg, len(owner)), len(over))
        return saved * (laid / room)[owner].sum(0)

    # Row sums of the normal equations bound their largest eigenvalue.
    together = np.bincount(owner.ravel(), np.tile(saved, len(owner)), len(over))
    slope = saved * (together / room)[owner].sum(0)
    step = 1 / np.where(slope > 0, slope, np.inf)
    leg = ahead = np.zeros_like(most)
    pace = 1.0
    for _ in range(_ROUNDS):
        new = np.clip(ahead + step * off(ahead), 0.0, most)
        faster = (1 + np.sqrt(1 + 4 * pace**2)) / 2
        leg, ahead, pace = new, new + (pace - 1) / faster * (new - leg), faster
    return leg


def _cut(road: Road, at: Floats, leg: Floats) -> Road:
    """The road with straight cuts of these legs, mm, at corners at these positions, mm."""
    at, leg = at[leg > _LEAST], leg[leg > _LEAST]
    if not len(at):
        return road
    path = road.path
    points = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    low, high = at - leg, at + leg
    last = np.searchsorted(low, points, side="right") - 1
    kept = (last < 0) | (points >= high[np.maximum(last, 0)])
    position = np.unique(np.concatenate([points[kept], low, high]))
    xy = _along(path, points, position)
    middle = (position[1:] + position[:-1]) / 2
    own = np.clip(np.searchsorted(points, middle, side="right") - 1, 0, len(points) - 2)
    section = None if road.section is None else road.section[own]
    return replace(road, xy=xy[:-1] if road.closed else xy, width=road.width[own], section=section)
