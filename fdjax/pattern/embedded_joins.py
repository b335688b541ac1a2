"""Fine lines joined with what runs through their zone, so that few roads begin and end in it.

A line that runs through a zone takes the two fine lines nearest to it: up one, down the next, up
the third. It turns along the lines across it at the zone's border, where it also comes back to its
own place; beyond the border it is as it was.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fdjax.pattern.embedded_net import Course, Net

CLEAR = 1.1
"""Ways side by side at a border keep so many road widths from each other."""

LEAST = 4.0
"""Fine lines are joined where they are so many times as long as that."""

_SAME = 1e-12
"""Places of the unit square nearer than this are one."""


class Run(NamedTuple):
    """A line on line `line` of the lattice, from line `start` to line `stop` across it."""

    line: int
    start: int
    stop: int


class Bundle(NamedTuple):
    """Three lines side by side from `start` to `stop`: one runs through, two are fine and end.

    `lines` in the order in which the road takes them, of which `host` runs through; `beside`: how
    far off the border it keeps where it comes to it twice, as a share of the unit square.
    """

    lines: tuple[Run, Run, Run]
    host: Run
    start: int
    stop: int
    beside: float


@dataclass(eq=False)
class Bundles:
    """The bundles of a layer, by the line that runs through."""

    net: Net
    through: dict[Run, list[Bundle]] = field(default_factory=dict)
    taken: set[Run] = field(default_factory=set)

    def course(self, run: Run) -> Course:
        """A line from end to end, with what it takes on its way."""
        ends = [self._end(run, each) for each in (run.start, run.stop)]
        u, v = self._path(run, ends[0], ends[1])
        moved = np.concatenate([[True], np.hypot(np.diff(u), np.diff(v)) > _SAME])
        return u[moved], v[moved]

    def _end(self, run: Run, across: int) -> float:
        """Where a line ends; at a wall it is the plan that cuts it."""
        place = float(self.net.along[across])
        at_wall = not self.net.turn and not 0 < place < 1
        return place if at_wall else self.net.meeting(run.line, across)

    def _path(self, run: Run, start: float, stop: float) -> Course:
        low, high = min(start, stop), max(start, stop)
        pieces, now = [], low
        for bundle in self._direct(run, low, high):
            begin, end = (self.net.meeting(run.line, each) for each in (bundle.start, bundle.stop))
            pieces += [self.net.line(run.line, now, begin), self._bundled(bundle)]
            now = end
        pieces.append(self.net.line(run.line, now, high))
        u, v = (np.concatenate(each) for each in zip(*pieces, strict=True))
        return (u, v) if stop >= start else (u[::-1], v[::-1])

    def _direct(self, run: Run, low: float, high: float) -> list[Bundle]:
        """Bundles that a line goes through between two places, less those within others."""
        inside = [
            bundle
            for bundle in self.through.get(run, ())
            if self.net.meeting(run.line, bundle.start) >= low
            and self.net.meeting(run.line, bundle.stop) <= high
        ]
        outer = [
            one
            for one in inside
            if not any(
                other is not one and other.start <= one.start and one.stop <= other.stop
                for other in inside
            )
        ]
        return sorted(outer)

    def _bundled(self, bundle: Bundle) -> Course:
        """From where the line that runs through comes to the border to where it goes on."""
        net, by = self.net, bundle.beside
        first, second, third = bundle.lines
        host = bundle.host
        low = [net.meeting(each.line, bundle.start) for each in bundle.lines]
        high = [net.meeting(each.line, bundle.stop) for each in bundle.lines]
        # Where the road comes to the border a second time it stays off what lies there.
        after, before = (by if host is not first else 0.0), (by if host is not third else 0.0)
        pieces = [
            net.way(host.line, first.line, bundle.start, 0.0),
            self._path(first, low[0], high[0] - before),
            net.way(first.line, second.line, bundle.stop, -before),
            self._path(second, high[1] - before, low[1] + after),
            net.way(second.line, third.line, bundle.start, after),
            self._path(third, low[2] + after, high[2]),
            net.way(third.line, host.line, bundle.stop, 0.0),
        ]
        u, v = (np.concatenate(each) for each in zip(*pieces, strict=True))
        return u, v


def bundled(net: Net, base: Sequence[Run], fine: Sequence[Run], clearance: float) -> Bundles:
    """The bundles of a layer, chosen from the first line on, the longest fine lines first.

    - `base`: lines from wall to wall; `fine`: those between; `clearance`: of ways, mm.
    """
    bundles = Bundles(net)
    every = [*base, *fine]
    if net.turn:
        # Where a turn begins nothing is joined.
        free = [run for run in fine if run.start > 0 and run.stop < net.turn]
        round_again = [run for run in fine if run.stop > net.turn]
        every += [Run(r.line, r.start - net.turn, r.stop - net.turn) for r in round_again]
    else:
        free = [run for run in fine if net.along[run.start] > 0 and net.along[run.stop] < 1]
    spans = sorted({(run.start, run.stop) for run in free}, key=lambda s: (s[0] - s[1], s))
    for start, stop in spans:
        there = sorted(run for run in every if run.start < stop and run.stop > start)
        lines = [run for run in there if run.start <= start and run.stop >= stop]
        k = 0
        while k + 2 < len(lines):
            bundle = _made(bundles, lines[k : k + 3], start, stop, every, clearance)
            if bundle is None:
                k += 1
                continue
            bundles.through.setdefault(bundle.host, []).append(bundle)
            bundles.taken.update(run for run in bundle.lines if run != bundle.host)
            k += 3
    return bundles


def _runs_through(run: Run, start: int, stop: int) -> bool:
    return run.start < start and run.stop > stop


def _made(
    bundles: Bundles,
    lines: Sequence[Run],
    start: int,
    stop: int,
    every: Sequence[Run],
    clearance: float,
) -> Bundle | None:
    """A bundle of three lines side by side, or None where it would touch another road."""
    through = [run for run in lines if _runs_through(run, start, stop)]
    ending = [run for run in lines if (run.start, run.stop) == (start, stop)]
    if len(through) != 1 or len(ending) != 2 or bundles.taken & set(ending):
        return None
    if through[0].start < 0:
        return None
    host, low, high = through[0], lines[0].line, lines[-1].line
    for other in bundles.through.get(host, ()):
        within = other.start < start and stop < other.stop
        if not (other.stop < start or stop < other.start or within):
            return None
    for run in every:
        if run not in lines and low <= run.line <= high:
            for across in (start, stop):
                if run.start <= across <= run.stop:
                    return None
    net = bundles.net
    begin, end = (net.meeting(host.line, across) for across in (start, stop))
    _, v = net.line(host.line, begin, end)
    u = np.concatenate([net.own(np.full(len(v), net.at[run.line]), v) for run in lines])
    ((xy,), _) = net.traced([(u, np.tile(v, 3))])
    steps = np.hypot(*np.diff(xy.reshape(3, -1, 2), axis=1).transpose(2, 0, 1))
    slowest = float((steps / np.diff(v)).min())
    beside = clearance / slowest
    if end - begin < LEAST * beside:
        return None
    order = sorted(lines)
    if host == order[-1]:
        order = order[::-1]
    return Bundle((order[0], order[1], order[2]), host, start, stop, beside)
