"""The lattice on which a layer's lines lie, base and fine: places in the unit square, traced."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.road.porosity import Margins
from fdjax.road.stacking import Scan

Floats = NDArray[np.float64]
Trace = Callable[[Floats, Floats], tuple[Floats, Floats]]
Course = tuple[Floats, Floats]
"""Places along a road: across the lines of the layer's family, and along them."""


class Axis(NamedTuple):
    """Places in the unit square of a phase's lines along one axis, and of what lies between.

    - `first`: of the phase's first line; `step`: between its lines; `lines`: of these.
    - `closed`: whether the axis runs around a ring; `begin`: the line then at which its cells
      begin, from which places go on beyond 1.

    Cells lie between neighbouring lines, and between the outer ones and the walls.
    """

    first: float
    step: float
    lines: int
    closed: bool = False
    begin: int = 0

    @classmethod
    def of(cls, scan: Scan, comb: int, *, closed: bool = False) -> "Axis":
        places = scan.places(comb)
        return cls(float(places[0]), scan.phases / comb, len(places), closed)

    @property
    def cells(self) -> int:
        return self.lines if self.closed else self.lines + 1

    @property
    def before(self) -> int:
        """Cells before the first line."""
        return 0 if self.closed else 1

    def edges(self, parts: int) -> Floats:
        """Edges of all cells in so many parts, cut off at the walls."""
        at = np.arange(self.cells * parts + 1) / parts - self.before
        if not self.closed:
            return np.clip(self.first + at * self.step, 0.0, 1.0)
        lines = self.first + np.arange(self.lines) * self.step
        lines = np.concatenate([lines[self.begin :], lines[: self.begin + 1] + 1.0])
        return np.interp(at, np.arange(self.cells + 1), lines)


class Squeeze:
    """What carries places between the walls to such that keep half a road from them.

    On a ring there are none across eta, whose places may go on beyond 1.
    """

    def __init__(self, edge: Margins) -> None:
        self.run = np.linspace(0, 1, len(edge.left))
        self.left, self.right = np.asarray(edge.left), np.asarray(edge.right)
        self.bottom, self.top = np.asarray(edge.bottom), np.asarray(edge.top)

    def xi(self, u: Floats, v: Floats) -> Floats:
        v = np.where(v > 1, v - np.floor(v), v)
        left, right = (np.interp(v, self.run, each) for each in (self.left, self.right))
        return u + left - u * (left + right)

    def eta(self, u: Floats, v: Floats) -> Floats:
        low, high = (np.interp(u, self.run, each) for each in (self.bottom, self.top))
        return v + low - v * (low + high)

    def __call__(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        return self.xi(u, v), self.eta(u, v)


@dataclass(frozen=True, eq=False)
class Net:
    """The lattice of a layer's family: its lines, and those of the other family across them.

    - `family`: the layer's; `parts`: of a base cell's side.
    - `at`: places of the lattice's lines across the family; `along`: of those of the other one.
    - `squeeze`: off the walls; `trace`: points and widths of lines (n, points) in xi, eta.
    - `turn`: where the family's lines are closed, as many lines of `along` as are on a turn: of
      these there are two turns then. Else 0.
    """

    family: str
    parts: int
    at: Floats
    along: Floats
    squeeze: Squeeze
    trace: Trace
    turn: int = 0

    def own(self, u: Floats, v: Floats) -> Floats:
        """Where a line at u of the family lies at v along it."""
        return self.squeeze.xi(u, v) if self.family == "xi" else self.squeeze.eta(v, u)

    def other(self, u: Floats, v: Floats) -> Floats:
        """Where a line at v of the other family lies at u along it."""
        return self.squeeze.eta(u, v) if self.family == "xi" else self.squeeze.xi(v, u)

    @cached_property
    def _points(self) -> int:
        return len(self.squeeze.run)

    def line(self, line: int, start: float, stop: float) -> Course:
        """Along a line of the family between these places."""
        count = 2 + int(np.ceil((self._points - 1) * abs(stop - start)))
        v = np.linspace(start, stop, count)
        return self.own(np.full(count, self.at[line]), v), v

    def meeting(self, line: int, across: int) -> float:
        """Where on a line of the family one of the other crosses it."""
        return float(self.other(self.at[line : line + 1], self.along[across : across + 1])[0])

    def way(self, start: int, stop: int, across: int, beside: float) -> Course:
        """From line to line of the family along one across, or `beside` it."""
        u = np.linspace(self.at[start], self.at[stop], 2 + 8 * abs(stop - start))
        v = self.other(u, np.full(len(u), self.along[across])) + beside
        return self.own(u, v), v

    def traced(self, courses: Sequence[Course]) -> tuple[list[Floats], list[Floats]]:
        """Points of courses and the widths between them."""
        step = self._points - 1
        rows, counts = [], []
        for u, v in courses:
            pieces = -(-(len(u) - 1) // step)
            more = pieces * step + 1 - len(u)
            both = (np.pad(each, (0, more), mode="edge") for each in (u, v))
            # Each row begins where the one before ends.
            index = np.arange(pieces)[:, None] * step + np.arange(step + 1)
            rows.append([each[index] for each in both])
            counts.append(pieces)
        u, v = (np.concatenate(each) for each in zip(*rows, strict=True))
        xy, width = self.trace(u, v) if self.family == "xi" else self.trace(v, u)
        found: tuple[list[Floats], list[Floats]] = [], []
        first = 0
        for (own, _), pieces in zip(courses, counts, strict=True):
            part = slice(first, first + pieces)
            points = np.concatenate([xy[part, :-1].reshape(-1, 2), xy[part][-1:, -1]])
            found[0].append(points[: len(own)])
            found[1].append(width[part].ravel()[: len(own) - 1])
            first += pieces
        return found
