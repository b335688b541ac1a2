"""The order in which the roads of a layer are laid, for little travel."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fdjax.plan.toolpath import Road

_EXCHANGE = 200
"""With more roads than this only the nearest-end rule is used."""


def reversed_road(road: Road) -> Road:
    """The same deposit run from its end to its start."""
    xy = np.roll(road.xy[::-1], 1, axis=0) if road.closed else road.xy[::-1]
    return replace(road, xy=xy, width=road.width[::-1])


def order_roads(roads: Sequence[Road], *, start: ArrayLike | None = None) -> list[Road]:
    """Put roads in an order of little travel, each either way round.

    The nearest end comes next, from the point `start` (by default where the first road starts);
    then stretches of the order are turned round while that shortens the travel. The same is tried
    from the order as given, so up to 200 roads never travel more than they did.
    """
    if not roads:
        return []
    ends = np.stack([road.path[[0, -1]] for road in roads])
    begin = ends[0, 0] if start is None else np.asarray(start, float)
    order, flip = _nearest_first(ends, begin)
    if 1 < len(roads) <= _EXCHANGE:
        as_given = list(range(len(roads))), [False] * len(roads)
        tours = [(order, flip), as_given]
        for tour in tours:
            _turn_stretches(ends, begin, *tour)
        order, flip = min(tours, key=lambda tour: _travel(ends, begin, *tour))
    pairs = zip(order, flip, strict=True)
    return [reversed_road(roads[k]) if turned else roads[k] for k, turned in pairs]


def _travel(ends: np.ndarray, begin: np.ndarray, order: list[int], flip: list[bool]) -> float:
    turned = np.asarray(flip, int)
    first, last = ends[order, turned], ends[order, 1 - turned]
    return float(_distance(np.vstack([begin, last[:-1]]), first).sum())


def _nearest_first(ends: np.ndarray, begin: np.ndarray) -> tuple[list[int], list[bool]]:
    free = np.ones(len(ends), bool)
    order: list[int] = []
    flip: list[bool] = []
    here = begin
    while free.any():
        distance = np.hypot(*np.moveaxis(ends - here, -1, 0))
        distance[~free] = np.inf
        road, side = np.unravel_index(np.argmin(distance), distance.shape)
        order.append(int(road))
        flip.append(bool(side))
        free[road] = False
        here = ends[road, 1 - side]
    return order, flip


def _turn_stretches(
    ends: np.ndarray, begin: np.ndarray, order: list[int], flip: list[bool]
) -> None:
    """Turn stretches of the order round in place while one shortens the travel."""
    count = len(order)
    while True:
        turned = np.asarray(flip, int)
        first = ends[order, turned]
        last = ends[order, 1 - turned]
        before = np.vstack([begin, last[:-1]])
        # Turning i..j round trades the two travels at its ends; after the last there is none.
        gain = _distance(before, first)[:, None] - _distance(before[:, None], last[None])
        after = _distance(last[:-1], first[1:]) - _distance(first[:, None], first[None, 1:])
        gain[:, :-1] += after
        gain[np.tril_indices(count, -1)] = 0
        i, j = np.unravel_index(np.argmax(gain), gain.shape)
        if gain[i, j] <= 1e-9:
            return
        order[i : j + 1] = order[i : j + 1][::-1]
        flip[i : j + 1] = [not side for side in flip[i : j + 1][::-1]]


def _distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.hypot(*np.moveaxis(a - b, -1, 0))
