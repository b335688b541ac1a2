"""The order in which the roads of a layer are laid, for little travel."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fdjax.plan.near import Near
from fdjax.plan.toolpath import Road

Floats = NDArray[np.float64]

_NEIGHBOURS = 8
"""So many nearest ends of other roads an end may be newly linked to, or up to two more."""

_LONGEST_MOVE = 3
"""So many roads at most are moved together to another place in the order."""

_STARTS = 8
"""Where no start is given the ends of so many roads are tried, the first ones."""

_FEW = 50
"""With more roads than this only the better of the nearest first and the order as given is
shortened."""

_MANY = 2000
"""With more roads than this only one end of the first is tried where no start is given."""

_LONGEST_TURN = 10_000
"""Longest stretch of the order, in ends, that is turned round or passed by what is moved: with
very many roads these steps would grow with their square."""

_QUERY = 32
"""So many nearest ends are looked at first where all neighbours of an end are taken."""

_GAIN = 1e-9


def reversed_road(road: Road) -> Road:
    """The same deposit run from its end to its start."""
    xy = np.roll(road.xy[::-1], 1, axis=0) if road.closed else road.xy[::-1]
    section = None if road.section is None else road.section[::-1]
    return replace(road, xy=xy, width=road.width[::-1], section=section)


def order_roads(roads: Sequence[Road], *, start: ArrayLike | None = None) -> list[Road]:
    """Put roads in an order of little travel, each either way round.

    The nearest end comes next, from the point `start` or, where none is given, from the best of the
    first roads' ends, or the roads stay in the order as given; then, while one shortens the travel,
    stretches of the order are turned round (Croes 1958, 2-opt) and up to three roads together are
    put elsewhere (Or 1976), so that an end lies next to one of its neighbours. Never more travel
    than in the order as given; the same every time.
    """
    if not roads:
        return []
    ends = np.stack([road.path[[0, -1]] for road in roads])
    begin = None if start is None else np.asarray(start, float)
    tried = 2 * _STARTS if len(roads) <= _MANY else 1
    begins = ends.reshape(-1, 2)[:tried] if begin is None else [begin]
    neighbours = _neighbours(ends)
    orders = [_nearest_first(ends, at, neighbours) for at in begins]
    tours = [_Tour(ends, begin, met) for met in [*orders, list(range(2 * len(roads)))]]
    if len(roads) > _FEW:
        tours = [min(tours, key=_Tour.travel)]
    if len(roads) > 1:
        for tour in tours:
            tour.shorten(neighbours)
    best = min(tours, key=_Tour.travel)
    firsts = best.stops[1:-1:2]
    return [reversed_road(roads[end // 2]) if end % 2 else roads[end // 2] for end in firsts]


def _nearest_first(ends: Floats, begin: Floats, neighbours: list[list[int]]) -> list[int]:
    """Ends in the order in which they are met; end `2 k` is the first of road k."""
    points = ends.reshape(-1, 2)
    taken = np.zeros(len(points), bool)
    left = np.arange(len(points))
    tree = Near(points)
    met: list[int] = []

    def nearest(here: Floats) -> int:
        nonlocal left, tree
        # All that were met are taken, and the tree holds some of them.
        if 2 * (len(met) - len(points) + len(left)) > len(left):
            left = left[~taken[left]]
            tree = Near(points[left])
        count = _QUERY
        while True:
            [gaps], [found] = tree.query(here[None], min(count, len(left)))
            found = left[found]
            free = ~taken[found]
            if free.any():
                return int(found[free & (gaps <= gaps[free][0])].min())
            count *= 4

    end = nearest(begin)
    for _ in range(len(ends)):
        met += [end, end ^ 1]
        taken[end] = taken[end ^ 1] = True
        if len(met) < len(points):
            after = next((other for other in neighbours[end ^ 1] if not taken[other]), None)
            end = nearest(points[end ^ 1]) if after is None else after
    return met


def _neighbours(ends: Floats) -> list[list[int]]:
    """The nearest ends of other roads to each end, nearest first, of equals the first road's."""
    points = ends.reshape(-1, 2)
    count = min(_NEIGHBOURS + 2, len(points))
    gaps, near = Near(points).query(points, count)
    near = np.take_along_axis(near, np.lexsort((near, gaps)), axis=1)
    return [
        [other for other in row if other // 2 != end // 2] for end, row in enumerate(near.tolist())
    ]


class _Tour:
    """An order of ends: the head's place or none, each road's first and last end, and none at last.

    `stops[k]` is the end met at k: roads start at odd k and finish at even k.
    """

    def __init__(self, ends: Floats, begin: Floats | None, met: list[int]) -> None:
        self._none = 2 * len(ends) + 1
        points = ends.reshape(-1, 2) if begin is None else np.vstack([ends.reshape(-1, 2), begin])
        self._point: list[complex] = (points[:, 0] + 1j * points[:, 1]).tolist()
        self.stops = [self._none - (begin is not None), *met, self._none]
        self._at = [0] * (self._none + 1)
        self._count(0, len(self.stops))

    def _count(self, low: int, high: int) -> None:
        for place in range(low, high):
            self._at[self.stops[place]] = place

    def _gap(self, a: int, b: int) -> float:
        """Travel between two ends; none beyond the last, nor before the first of a free start."""
        if a == self._none or b == self._none:
            return 0.0
        return abs(self._point[a] - self._point[b])

    def travel(self) -> float:
        return sum(self._gap(*self.stops[k : k + 2]) for k in range(0, len(self.stops) - 1, 2))

    def shorten(self, neighbours: list[list[int]]) -> None:
        """Make moves, the first that helps each time, until none does."""
        waiting = deque(self.stops[1:-1])
        queued = [True] * len(neighbours)
        while waiting:
            end = waiting.popleft()
            queued[end] = False
            for touched in self._improve(end, neighbours[end]):
                if touched < len(neighbours) and not queued[touched]:
                    queued[touched] = True
                    waiting.append(touched)

    def _improve(self, end: int, near: list[int]) -> tuple[int, ...]:
        """Link an end to a near one if that shortens the travel; the ends that were relinked."""
        place = self._at[end]
        # The end that it is linked to now: before it where its road starts, else after it.
        side = -1 if place % 2 else 1
        linked = self.stops[place + side]
        now = self._gap(end, linked)
        for other in near:
            won = now - self._gap(end, other)
            if won <= _GAIN:
                break
            there = self._at[other]
            beside = -1 if there % 2 else 1
            before = self.stops[there + beside]
            won += self._gap(other, before)
            if side == beside and won - self._gap(linked, before) > _GAIN:
                low, high = sorted((place, there))
                if high - low > _LONGEST_TURN:
                    continue
                self._turn(low + (side > 0), high + (side > 0))
                return end, other, linked, before
            for size in range(2, 2 * _LONGEST_MOVE + 1, 2):
                far = place - side * (size - 1)
                if not 0 < far < len(self.stops) - 1:
                    break
                low, high = sorted((place, far))
                if low <= there <= high or low <= there + beside <= high:
                    continue
                if abs(there - place) > _LONGEST_TURN:
                    continue
                last, after = self.stops[far], self.stops[far - side]
                cost = self._gap(linked, after) + self._gap(last, before)
                if won + self._gap(last, after) - cost > _GAIN:
                    self._move(low, high + 1, max(there, there + beside), turned=side == beside)
                    return end, other, linked, before, last, after
        return ()

    def _turn(self, low: int, high: int) -> None:
        self.stops[low:high] = self.stops[low:high][::-1]
        self._count(low, high)

    def _move(self, low: int, high: int, to: int, *, turned: bool) -> None:
        """Put the stops from `low` to before `high` in front of the stop at `to`."""
        moved = self.stops[low:high]
        if turned:
            moved.reverse()
        if to >= high:
            self.stops[low:to] = self.stops[high:to] + moved
            self._count(low, to)
        else:
            self.stops[to:high] = moved + self.stops[to:low]
            self._count(to, high)
