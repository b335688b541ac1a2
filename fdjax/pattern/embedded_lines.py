"""The fine lines of embedded grids: where they run between lines of the base, and traced."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.pattern.embedded import Embedded
from fdjax.road.porosity import Margins
from fdjax.road.stacking import FAMILIES, Scan
from fdjax.road.stroke import Lines

Floats = NDArray[np.float64]
Trace = Callable[[Floats, Floats], tuple[Floats, Floats]]
_Place = Callable[[Floats, Floats], Floats]


class Run(NamedTuple):
    """A fine line on line `line` of the lattice, from line `start` to line `stop` across it."""

    line: int
    start: int
    stop: int


class Axis(NamedTuple):
    """Places in the unit square of a phase's lines along one axis, and of what lies between.

    - `first`: of the phase's first line; `step`: between its lines; `lines`: of these.

    Cells lie between neighbouring lines, and between the outer ones and the walls.
    """

    first: float
    step: float
    lines: int

    @classmethod
    def of(cls, scan: Scan, comb: int) -> "Axis":
        places = scan.places(comb)
        return cls(float(places[0]), scan.phases / comb, len(places))

    @property
    def cells(self) -> int:
        return self.lines + 1

    def edges(self, parts: int) -> Floats:
        """Edges of all cells in so many parts, cut off at the walls."""
        at = np.arange(self.cells * parts + 1) / parts - 1
        return np.clip(self.first + at * self.step, 0.0, 1.0)


def with_fine(
    base: Lines,
    embedded: Embedded,
    scan: Scan,
    combs: tuple[int, int],
    *,
    edge: Margins,
    trace: Trace,
) -> Lines:
    """The lines of a layer with the fine ones between them.

    Divided is the grid that the layer's lines make with those of the other family in the same
    phase, which lie on the layer above or below or on the same: so a fine line begins and ends on
    lines of the other family, base or fine ones.

    - `combs`: lines of both families in all phases; `edge`: what they keep from the walls.
    - `trace`: gives points and widths of lines (n, points) in xi, eta.
    """
    axes = [
        Axis.of(Scan(family, scan.phase, scan.phases), comb)
        for family, comb in zip(FAMILIES, combs, strict=True)
    ]
    squeeze = _Squeeze(edge)

    def middles(parts: int) -> Floats:
        u, v = ((e[1:] + e[:-1]) / 2 for e in (axis.edges(parts) for axis in axes))
        return _points(trace, *squeeze(*np.meshgrid(u, v, indexing="ij")), len(edge.left))

    divided = embedded.divided(middles, (axes[0].cells, axes[1].cells))
    if scan.family == "eta":
        divided, axes = divided.T, axes[::-1]
    own, other = axes
    parts = embedded.parts
    runs = _runs(divided, parts)
    at, along = own.edges(parts), other.edges(parts)
    runs = [run for run in runs if 0 < at[run.line] < 1 and along[run.stop] > along[run.start]]
    if not runs:
        return base
    xy, width = _traced(runs, at, along, scan.family, squeeze, trace)
    # The plan joins levels 1, 2, 4 ... apart.
    whole = 1 << (parts - 1).bit_length()
    level = [(run.line // parts - 1) * whole + run.line % parts for run in runs]
    return replace(
        base,
        level=np.concatenate([np.asarray(base.level) * whole, level]),
        xy=[*base.xy, *xy],
        width=[*base.width, *width],
    )


def _runs(divided: NDArray[np.intp], parts: int) -> list[Run]:
    """The fine lines between cells, along the second axis, from line to line of the first."""
    found = []
    for line in range(1, len(divided)):
        if line % parts == 0:
            continue
        there = np.zeros(divided.shape[1] + 2, int)
        for beside in (divided[line - 1], divided[line]):
            there[1:-1] |= line % (parts // beside) == 0
        change = np.diff(there)
        found += [
            Run(line, int(a), int(b))
            for a, b in zip(np.flatnonzero(change > 0), np.flatnonzero(change < 0), strict=True)
        ]
    return found


class _Squeeze:
    """What carries places between the walls to such that keep half a road from them."""

    def __init__(self, edge: Margins) -> None:
        self.run = np.linspace(0, 1, len(edge.left))
        self.left, self.right = np.asarray(edge.left), np.asarray(edge.right)
        self.bottom, self.top = np.asarray(edge.bottom), np.asarray(edge.top)

    def xi(self, u: Floats, v: Floats) -> Floats:
        left, right = (np.interp(v, self.run, each) for each in (self.left, self.right))
        return u + left - u * (left + right)

    def eta(self, u: Floats, v: Floats) -> Floats:
        low, high = (np.interp(u, self.run, each) for each in (self.bottom, self.top))
        return v + low - v * (low + high)

    def __call__(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        return self.xi(u, v), self.eta(u, v)


def _traced(
    runs: list[Run], at: Floats, along: Floats, family: str, squeeze: _Squeeze, trace: Trace
) -> tuple[Floats, Floats]:
    """Points and widths of fine lines; `at` and `along`: places of the lattice's lines."""
    u = np.array([at[run.line] for run in runs])[:, None]
    ends = np.array([[along[run.start], along[run.stop]] for run in runs])
    own, other = squeeze.xi, squeeze.eta
    if family == "eta":
        own, other = _exchanged(squeeze.eta), _exchanged(squeeze.xi)
    # Where a line ends at a wall it is the plan that cuts it.
    inner = (ends > 0) & (ends < 1)
    ends = np.where(inner, other(np.broadcast_to(u, ends.shape), ends), ends)
    v = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * squeeze.run
    lines = own(np.broadcast_to(u, v.shape), v)
    return trace(lines, v) if family == "xi" else trace(v, lines)


def _exchanged(function: _Place) -> _Place:
    return lambda u, v: function(v, u)


def _points(trace: Trace, xi: Floats, eta: Floats, points: int) -> Floats:
    """Points of places (n, m), in rows as long as lines have points."""
    more = -xi.size % points
    rows = [np.pad(each.ravel(), (0, more)).reshape(-1, points) for each in (xi, eta)]
    return trace(*rows)[0].reshape(-1, 2)[: xi.size].reshape(*xi.shape, 2)
