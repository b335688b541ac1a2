"""Drawing over a layer what repeats: the graph of a unit cell's copies, and lattices.

Loads no JAX. The chart is inverted by Newton's method, each cell from a place inside it or from
one of a neighbour.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.field.inverse import inverse
from fdjax.field.spline import Axis, product, scattered
from fdjax.pattern.unit_cell import UnitCell

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]

_FINE = 0.45
"""Places at which cells are looked for lie no further apart than this share of the least period."""

_PIECE = 0.6
"""Edges are drawn in pieces of about this length, mm, as the chart bends them."""

_STRAIGHT = 2e-4
"""No more pieces are drawn than keep so near to the bent edge, mm."""

_FAR = 1 << 20
"""More cells than this along an axis are not told apart."""


class Chart(NamedTuple):
    """Two splines on one layer: coefficients (K, L, 2) over the axes along x and y.

    `times`: how often as dense as the chart is what is drawn in it, as a function of places (n, 2),
    mm, or None where it is as dense.
    """

    coefficients: Floats
    axes: tuple[Axis, Axis]
    times: Callable[[Floats], Floats] | None = None

    def sampled(self, step: float) -> tuple[Floats, Floats]:
        """Places (n, 2) on a lattice over the box and a little beyond, mm, and values there."""
        places = [
            np.linspace(
                axis.low - axis.step / 2,
                axis.high + axis.step / 2,
                int(np.ceil((axis.high - axis.low + axis.step) / step)) + 1,
            )
            for axis in self.axes
        ]
        x, y = (axis.basis(at) for axis, at in zip(self.axes, places, strict=True))
        values = product(self.coefficients, x, y, np.eye(2))
        xy = np.stack(np.meshgrid(*places, indexing="ij"), -1)
        return xy.reshape(-1, 2), values.reshape(-1, 2)


def drawn(cell: UnitCell, chart: Chart, offset: Floats) -> tuple[Floats, Ints]:
    """Nodes (n, 2), mm, and edges (m, 2) of the cells that lie over the chart's box.

    `offset`: by which the drawing is moved, in periods along both axes, shape (2,).
    """
    size = np.array(cell.size)
    slopes = _slopes(chart)
    cells, guess = _cells(chart, size, offset, _FINE * float(size.min() / slopes.max()))
    length = np.hypot(*(cell.ends[:, 1] - cell.ends[:, 0]).T) / np.median(slopes)
    least = np.sqrt(_bend(chart) * length**2 / 8 / _STRAIGHT)
    pieces = np.clip(np.ceil(np.minimum(length / _PIECE, least)), 1, 16).astype(int)
    inner = [np.arange(1, count) / count for count in pieces]
    # Points of one cell: its nodes, then those inside its edges.
    own = [cell.xy]
    first = [len(cell.xy)]
    for ends, share in zip(cell.ends, inner, strict=True):
        own.append(ends[0] + share[:, None] * (ends[1] - ends[0]))
        first.append(first[-1] + len(share))
    points = np.concatenate(own)
    values = (cells[:, None] + offset) * size + points
    at = np.repeat(guess, len(points), 0)
    xy, found = inverse(chart.coefficients, chart.axes, values.reshape(-1, 2), at)
    edges = _edges(cell, cells, first, len(points))
    return xy, edges[found[edges].all(1)]


def lattice(chart: Chart, offset: Floats) -> tuple[Floats, Floats]:
    """Places where both functions are whole numbers, over the chart's box: (2 n, 2 m, 2), mm, and
    the values (2,) at the first.

    nan where there is none near the box. `offset`: by which they are moved, in steps, shape (2,).
    """
    cells, guess = _cells(chart, np.ones(2), offset, _FINE / float(_slopes(chart).max()))
    xy, found = inverse(chart.coefficients, chart.axes, cells + offset, guess)
    # Squares of four nodes are alike for all offsets.
    least = cells.min(0) // 2 * 2
    at = cells - least
    result = np.full((*(at.max(0) // 2 * 2 + 2), 2), np.nan)
    result[tuple(at[found].T)] = xy[found]
    return result, least + offset


def halved(chart: Chart, xy: Floats, first: Floats, step: float, split: Bools) -> Floats:
    """The lattice of half the step where squares of four nodes are split, (4 n, 4 m, 2), mm.

    - `xy`: the lattice (2 n, 2 m, 2), mm; `first`: values at its first node; `step`: in both
      functions; `split`: which squares, (n, m). nan in others.
    """
    finer = np.full((2 * xy.shape[0], 2 * xy.shape[1], 2), np.nan)
    index = np.argwhere(np.repeat(np.repeat(split, 4, 0), 4, 1))
    values = first + step * (index / 2 - 0.25)
    places, found = inverse(chart.coefficients, chart.axes, values, xy[tuple((index // 2).T)])
    finer[tuple(index[found].T)] = places[found]
    return finer


def _slopes(chart: Chart) -> Floats:
    """Slopes of both functions over the box, 1/mm."""
    xy, _ = chart.sampled(min(axis.step for axis in chart.axes) / 2)
    along_x, along_y = scattered(chart.coefficients, chart.axes, xy, (1, 0), (0, 1))
    return np.hypot(along_x, along_y)


def _bend(chart: Chart) -> float:
    """Largest curvature, 1/mm, at which what is straight in the chart is drawn over the box."""
    xy, _ = chart.sampled(min(axis.step for axis in chart.axes) / 2)
    ax, ay, xx, both, yy = scattered(
        chart.coefficients, chart.axes, xy, (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)
    )
    # The least scale, of an area and the largest one, and no second derivative beyond this sum.
    fold = np.abs(ax[:, 0] * ay[:, 1] - ay[:, 0] * ax[:, 1])
    steep = np.sqrt((ax**2 + ay**2).sum(1))
    second = np.sqrt((xx**2 + 2 * both**2 + yy**2).sum(1))
    return float((second * steep / np.maximum(fold, 1e-12)).max())


def _cells(chart: Chart, size: Floats, offset: Floats, step: float) -> tuple[Ints, Floats]:
    """Cells that lie over the box and those beside them, (n, 2), and for each a place near it."""
    xy, values = chart.sampled(step)
    seen = np.floor(values / size - offset).astype(int)
    _, first = np.unique(_key(seen), return_index=True)
    # A place inside a cell goes before one of a neighbour.
    shifts = np.array(sorted(itertools.product((-1, 0, 1), repeat=2), key=lambda s: s != (0, 0)))
    cells = (seen[first] + shifts[:, None]).reshape(-1, 2)
    _, kept = np.unique(_key(cells), return_index=True)
    return cells[kept], np.tile(xy[first], (len(shifts), 1))[kept]


def _key(cells: Ints) -> Ints:
    return cells[:, 0] * _FAR + cells[:, 1]


def _edges(cell: UnitCell, cells: Ints, first: list[int], count: int) -> Ints:
    """Pieces of all edges whose cells are there, as pairs of points."""
    keys = _key(cells)
    order = np.argsort(keys)
    base = np.arange(len(cells)) * count
    made = []
    for edge, (a, b) in enumerate(cell.edges.tolist()):
        wanted = _key(cells + cell.shift[edge])
        place = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
        there = keys[place] == wanted
        inner = np.arange(first[edge], first[edge + 1])
        run = np.concatenate(
            [base[:, None] + a, base[:, None] + inner, (place * count + b)[:, None]], 1
        )[there]
        made.append(np.stack([run[:, :-1], run[:, 1:]], -1).reshape(-1, 2))
    return np.concatenate(made)
