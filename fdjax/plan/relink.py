"""Joins made otherwise, so that the head travels less between the roads of a layer."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.plan.join import Joins, Way

Floats = NDArray[np.float64]


class Relinked(NamedTuple):
    """Joins, and the travel between the roads that they leave, lifts counted too, mm."""

    joins: Joins
    travel: float


_FURTHEST = 60
"""So many joins at most are made anew, one after the other, before travel must be less."""

_MOST_ROADS = 16
"""With more roads than this free ends are too many to be tried."""

_UNEVEN = 2.0
"""So many mm of travel must be saved by each mm of wall that is covered otherwise than was asked:
the joins that were asked for cover the walls evenly over all layers."""

_UNEVEN_AT_NEED = 0.5
"""The same where that leaves much travel."""


def relinked(
    ways: Sequence[Way],
    chosen: Iterable[int],
    near: Iterable[tuple[int, int]],
    points: Floats,
    lift_length: float,
    much: float = 0.0,
) -> Relinked:
    """The ways that are made, with less travel between the roads where that can be had.

    A free end moves along its wall when it takes the partner of a neighbour, whose partner is then
    free; where it comes to a free end of another road the two are joined. The free ends are so
    moved, one after the other, while travel and lifts get less. Never a ring. Where that leaves
    much travel it is done anew with less regard for how evenly the walls are covered, and by ways
    that are `far`, too.

    - `chosen`: numbers of the ways that are made; `near`: pairs of ways of which one excludes the
      other; `points`: of all ends, shape (ends, 2), mm.
    - `lift_length`: a lift counts as so much travel, mm; `much`: more travel than this, lifts left
      out, is much, mm.
    """
    for uneven, far in ((_UNEVEN, False), (_UNEVEN_AT_NEED, True)):
        search = _Search(ways, chosen, near, points, lift_length, uneven, far)
        while search.shorten():
            pass
        if search.travel <= much:
            break
    joins = Joins.of(ways[number] for number in sorted(set(search.made.values())))
    return Relinked(joins, search.cost)


class _Search:
    """The ways as they are made, and what else could be."""

    def __init__(
        self,
        ways: Sequence[Way],
        chosen: Iterable[int],
        near: Iterable[tuple[int, int]],
        points: Floats,
        lift_length: float,
        uneven: float = _UNEVEN,
        far: bool = False,
    ) -> None:
        self.point = points[:, 0] + 1j * points[:, 1]
        self.ends = [way.ends for way in ways]
        self.length = [way.length for way in ways]
        self.is_far = [way.far for way in ways]
        self.uneven, self.far = uneven, far
        self.lift = lift_length
        self.made: dict[int, int] = {}
        self.from_end: list[list[int]] = [[] for _ in self.point]
        self.against: list[list[int]] = [[] for _ in ways]
        for number, (i, j) in enumerate(self.ends):
            self.from_end[i].append(number)
            self.from_end[j].append(number)
        for a, b in near:
            self.against[a].append(b)
            self.against[b].append(a)
        for number in chosen:
            self._make(number)
        self.cost = self._cost(self._roads())

    @property
    def travel(self) -> float:
        """Without lifts, mm."""
        return self.cost - self.lift * len(self._roads())

    def shorten(self) -> bool:
        """Move one free end to where travel is less; whether there is one."""
        roads = self._roads()
        if not 1 < len(roads) <= _MOST_ROADS:
            return False
        for free in [end for road in roads for end in road]:
            for first in self.from_end[free]:
                if self._moved(free, first):
                    return True
        return False

    def _moved(self, free: int, first: int) -> bool:
        """Whether travel is less with a free end moved on along its wall, beginning with this way.

        If not, all is as it was.
        """
        before = dict(self.made)
        number: int | None = first
        worth = 0.0
        for _ in range(_FURTHEST):
            if number is None or not self._may(free, number):
                break
            beyond = self._beyond(free, number)
            dropped = self.made.get(beyond)
            if dropped is not None:
                self._drop(dropped)
            if self._last(free) == beyond:
                break
            self._make(number)
            if dropped is not None:
                worth += self.uneven * (self.length[number] + self.length[dropped])
            cost = self._cost(self._roads())
            if cost < self.cost - worth:
                self.cost = cost
                return True
            if dropped is None:
                break
            free = self._beyond(beyond, dropped)
            onward = [each for each in self.from_end[free] if each != dropped]
            number = onward[0] if onward else None
        self.made = before
        return False

    def _may(self, free: int, number: int) -> bool:
        """Whether nothing that stays made excludes this way."""
        if self.is_far[number] and not self.far:
            return False
        beside = self.made.get(self._beyond(free, number))
        return not any(
            self.made.get(self.ends[other][0]) == other and other != beside
            for other in self.against[number]
        )

    def _beyond(self, end: int, number: int) -> int:
        i, j = self.ends[number]
        return j if i == end else i

    def _make(self, number: int) -> None:
        for end in self.ends[number]:
            self.made[end] = number

    def _drop(self, number: int) -> None:
        for end in self.ends[number]:
            del self.made[end]

    def _last(self, first: int) -> int:
        """The other free end of the road that begins at this one."""
        end = first ^ 1
        while (number := self.made.get(end)) is not None:
            end = self._beyond(end, number) ^ 1
        return end

    def _roads(self) -> list[tuple[int, int]]:
        """First and last end of each road."""
        lasts: set[int] = set()
        roads = []
        for end in range(len(self.point)):
            if end in self.made or end in lasts:
                continue
            last = self._last(end)
            lasts.add(last)
            roads.append((end, last))
        return roads

    def _cost(self, roads: list[tuple[int, int]]) -> float:
        """Lifts, and the travel of the best of the ways round that always take the nearest end."""
        at = self.point[np.array(roads, int).reshape(-1)]
        gap = np.abs(at[:, None] - at)
        # All ways round at once, one from each end; what is behind is infinitely far.
        every = np.arange(len(at))
        ahead = np.zeros((len(at), len(at)))
        here, travel = every, np.zeros(len(at))
        for _ in roads[1:]:
            ahead[every, here] = ahead[every, here ^ 1] = np.inf
            away = gap[here ^ 1] + ahead
            here = away.argmin(1)
            travel += away[every, here]
        return float(travel.min(initial=np.inf)) + self.lift * len(roads)
