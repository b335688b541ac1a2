"""Trails that hold each edge of a graph once, with little travel between them.

The Chinese postman's way (Edmonds and Johnson 1973): where an odd number of edges meets a road
must begin or end; these nodes are paired with little distance, and with travel between the two of
a pair all edges lie on closed ways (Euler). Roads are what is left of these without the travel.
Ways that cross nowhere are to be had as well: two that meet in a node, side by side around it, can
be joined there without a crossing.
"""

import cmath
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fdjax.plan.pairing import pairs

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_ALONE = 10.0
"""What an edge that begins and ends in one road of its own costs, beside the turns that it saves:
a turn costs 1 + cos of the angle between its sides, 0 straight on, 2 turning back."""

_AGAIN = 4
"""So often nodes with such an edge are looked at once more."""


def trails(
    xy: Floats, edges: Ints, *, crossing: bool = True
) -> list[tuple[list[int], list[int], bool]]:
    """Trails that hold each edge of a graph once: nodes, edges, and whether each is closed.

    A closed one does not repeat its first node. In an order with little travel: only between nodes
    where an odd number of edges meets, and from one connected part to the next. They go on through
    nodes as straight as may be.

    - `crossing`: whether trails may cross in nodes; else they touch there at most.
    """
    degree = np.bincount(edges.ravel(), minlength=len(xy))
    odd = np.flatnonzero(degree % 2)
    travel = odd[pairs(xy[odd])]
    return _Euler(xy, edges, travel, crossing=crossing).trails()


class _Euler:
    """Closed ways over edges and travel. End `2 k` of edge k is at its first node.

    `partner` of an end is the end of another edge by which the way goes on at the node; `around`
    has the edges' ends at each node, counterclockwise, where ways may not cross.
    """

    def __init__(self, xy: Floats, edges: Ints, travel: Ints, *, crossing: bool) -> None:
        self.edges, self.crossing = len(edges), crossing
        self.node: list[int] = np.concatenate([edges, travel]).ravel().tolist()
        away = np.diff(xy[edges], axis=1)[:, 0]
        away = away / np.hypot(*away.T)[:, None]
        both = np.stack([away, -away], 1).reshape(-1, 2)
        self.away: list[complex] = (both[:, 0] + 1j * both[:, 1]).tolist()
        gap = np.hypot(*(xy[travel[:, 1]] - xy[travel[:, 0]]).T) if len(travel) else np.zeros(0)
        self.gap: list[float] = gap.tolist()
        self.partner = [-1] * len(self.node)
        ends: dict[int, list[int]] = {}
        for end, node in enumerate(self.node):
            ends.setdefault(node, []).append(end)
        self.around = {} if crossing else {node: self._in_turn(own) for node, own in ends.items()}
        # Where there is least to choose from first.
        self.ends = sorted(ends.values(), key=len)
        for own in self.ends:
            self._pair(own)
        # What is paired at one node decides what an edge costs at the other.
        for _ in range(_AGAIN):
            for own in self.ends:
                if self._is_travel(own[-1]) and self._turn(self.partner[own[-1]], own[-1]) > 0:
                    self._pair(own)
        self._merge()

    def trails(self) -> list[tuple[list[int], list[int], bool]]:
        found = []
        for way in self._ways():
            breaks = [k for k, end in enumerate(way) if self._is_travel(end)]
            if not breaks:
                found.append(([self.node[end] for end in way], [end // 2 for end in way], True))
                continue
            first = max(breaks, key=lambda k: self.gap[way[k] // 2 - self.edges])
            run: list[int] = []
            for end in [*way[first + 1 :], *way[: first + 1]]:
                if not self._is_travel(end):
                    run.append(end)
                elif run:
                    nodes = [*(self.node[each] for each in run), self.node[run[-1] ^ 1]]
                    found.append((nodes, [each // 2 for each in run], False))
                    run = []
        return found

    def _is_travel(self, end: int) -> bool:
        return end >= 2 * self.edges

    def _turn(self, a: int, b: int) -> float:
        """Cost of going on from one end to another at their node."""
        if self._is_travel(a) or self._is_travel(b):
            other = a if self._is_travel(b) else b
            beyond = self.partner[other ^ 1]
            return _ALONE if beyond >= 0 and self._is_travel(beyond) else 0.0
        first, second = self.away[a], self.away[b]
        return 1 + first.real * second.real + first.imag * second.imag

    def _pair(self, ends: list[int]) -> None:
        """Pair the ends at a node, the straightest ways through it first."""
        lasts: Iterable[tuple[int, ...]] = [()]
        if self._is_travel(ends[-1]):
            lasts = [(end, ends[-1]) for end in ends[:-1]]
        way = self._straightest if self.crossing else self._apart
        chosen = min((way(ends, last) for last in lasts), key=lambda made: made[0])
        for a, b in chosen[1]:
            self.partner[a], self.partner[b] = b, a

    def _straightest(
        self, ends: Sequence[int], last: tuple[int, ...]
    ) -> tuple[float, list[tuple[int, ...]]]:
        cost = self._turn(*last) if last else 0.0
        made = [last] if last else []
        free = set(ends).difference(last)
        turns = sorted((self._turn(a, b), a, b) for a, b in combinations(sorted(free), 2))
        for turn, a, b in turns:
            if a in free and b in free:
                free -= {a, b}
                cost += turn
                made.append((a, b))
        return cost, made

    def _apart(
        self, ends: Sequence[int], last: tuple[int, ...]
    ) -> tuple[float, list[tuple[int, ...]]]:
        """The straightest of the pairs at a node of which none cross: in the order around it each
        pair has whole pairs between its two.
        """
        turn = [end for end in self.around[self.node[ends[0]]] if end not in last]
        least: dict[tuple[int, int], tuple[float, list[tuple[int, ...]]]] = {}
        for count in range(0, len(turn) + 1, 2):
            for a in range(len(turn) + 1 - count):
                tried: list[tuple[float, list[tuple[int, ...]]]] = [] if count else [(0.0, [])]
                for b in range(a + 1, a + count, 2):
                    inside, beyond = least[a + 1, b], least[b + 1, a + count]
                    cost = self._turn(turn[a], turn[b]) + inside[0] + beyond[0]
                    tried.append((cost, [(turn[a], turn[b]), *inside[1], *beyond[1]]))
                least[a, a + count] = min(tried, key=lambda made: made[0])
        cost, made = least[0, len(turn)]
        return (cost + self._turn(*last), [last, *made]) if last else (cost, made)

    def _in_turn(self, ends: Sequence[int]) -> list[int]:
        """Edges' ends at a node, counterclockwise."""
        own = [end for end in ends if not self._is_travel(end)]
        return sorted(own, key=lambda end: cmath.phase(self.away[end]))

    def _cross(self, a: int, c: int, b: int, d: int) -> bool:
        """Whether ways across each other at their node come of pairing a with c and b with d."""
        turn = self.around[self.node[a]]
        partner = {end: self.partner[end] for end in turn} | {a: c, c: a, b: d, d: b}
        place = {end: k for k, end in enumerate(turn)}
        # As brackets: what is opened last is closed first. An end where a road ends is none.
        waiting: list[int] = []
        for end in turn:
            other = partner[end]
            if other not in place:
                continue
            if place[other] > place[end]:
                waiting.append(other)
            elif waiting.pop() != end:
                return True
        return False

    def _ways(self) -> list[list[int]]:
        """The closed ways, each as the ends at which its edges and travels begin."""
        seen = [False] * len(self.node)
        found = []
        for first in range(0, len(self.node), 2):
            way, end = [], first
            while not seen[end]:
                seen[end] = seen[end ^ 1] = True
                way.append(end)
                end = self.partner[end ^ 1]
            if way:
                found.append(way)
        return found

    def _merge(self) -> None:
        """Make one way of those that meet in a node, where the turns suffer least."""
        root = list(range(len(self.node) // 2))

        def of(end: int) -> int:
            k = end // 2
            while root[k] != k:
                root[k] = root[root[k]]
                k = root[k]
            return k

        for way in self._ways():
            for end in way:
                root[of(end)] = of(way[0])
        while True:
            changes = []
            for ends in self.ends:
                if len({of(end) for end in ends}) > 1:
                    changes += self._exchanges(ends)
            joined = False
            for _, a, b, c, d in sorted(changes):
                if self.partner[a] != b or self.partner[c] != d or of(a) == of(c):
                    continue
                if self.crossing or not self._cross(a, c, b, d):
                    self.partner[a], self.partner[c] = c, a
                    self.partner[b], self.partner[d] = d, b
                    root[of(a)] = of(c)
                    joined = True
            if not joined:
                return

    def _exchanges(self, ends: list[int]) -> list[tuple[float, int, int, int, int]]:
        """Ways to join two closed ways at a node, a to c and b to d, with what the turns lose."""
        through = [(end, self.partner[end]) for end in ends if end < self.partner[end]]
        found = []
        for (a, b), (c, d) in combinations(through, 2):
            now = self._turn(a, b) + self._turn(c, d)
            for e, f in ((c, d), (d, c)):
                lost = self._turn(a, e) + self._turn(b, f) - now
                if lost < _ALONE / 2:
                    found.append((lost, a, b, e, f))
        return found
