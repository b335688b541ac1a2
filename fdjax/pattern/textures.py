"""Textures as roads: what a user says of them, and how they begin.

The drawing begins undistorted, at the scale that the mean of the target asks for.
"""
# ruff: noqa: RUF009 - `key` gives a dataclass field

from dataclasses import dataclass
from math import gcd
from typing import Any

import jax.numpy as jnp
import numpy as np

from fdjax.errors import InputError
from fdjax.keys import Kind, Place, choice, key, number, pair, points, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.chart_settings import ChartSettings, spline_of
from fdjax.pattern.drawings import NAMES, drawing
from fdjax.pattern.texture_pattern import TexturePattern
from fdjax.pattern.unit_cell import UnitCell
from fdjax.target.target import Target


def _cell(value: Any, place: Place) -> UnitCell:
    if not isinstance(value, dict):
        return drawing(choice(*NAMES).read(value, place))
    if value.keys() != {"lines", "size"}:
        raise place.error("needs lines and size, as in {size = [1, 1], lines = [[[0, 0], [1, 0]]]}")
    size = pair(number(0)).read(value["size"], place.at(".size"))
    lines = value["lines"]
    if not isinstance(lines, list):
        raise place.at(".lines").error("must be a list of lines")
    one = points(2)
    drawn = [one.read(line, place.at(f".lines[{k}]")) for k, line in enumerate(lines)]
    try:
        return UnitCell.of(drawn, size)
    except InputError as fault:
        raise place.error(fault) from None


CELL = Kind(f"{', '.join(NAMES)}, or `{{size = [a, b], lines = list of points}}`", _cell)


@dataclass(frozen=True)
class Textures(ChartSettings):
    """A unit cell repeated over a part, for any outline and target.

    Lengths in mm. See the job's keys for what each value means.
    """

    cell: UnitCell = key(
        CELL, "the drawing that repeats: by name, or lines in a cell of this size, in any unit",
        default="hexagonal",
    )  # fmt: skip
    angle: float = key(
        number(-360, 360), "degrees by which the drawing is turned, to begin with; rows that run "
        "along a wall would lie in the part or beyond it as a whole", default=15.0,
    )  # fmt: skip
    phases: int = key(
        whole(1, 100), "layers over which the drawing is moved; 1 lays all alike", default=5
    )
    mode = "both"
    shared_nodes = True

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> TexturePattern:
        """The drawing, undistorted and turned by `angle`, as dense as the target asks in the mean.

        Raises `InputError` for a target beyond what its gaps and pores allow, and for a region
        with no room for a road.
        """
        cell = self.cell
        lengths = cell.density * cell.pore, cell.density * cell.gap
        start = self.start(part, target, limits, window, lengths=lengths)
        mean = float(np.average(start.demand, weights=start.weight))
        scale = mean / cell.density
        places = [np.linspace(axis.low, axis.high, 2 * axis.count) for axis in start.axes[:2]]
        x, y = np.meshgrid(*places, indexing="ij")
        turn = scale * np.exp(1j * np.radians(self.angle))
        xi, eta = (
            spline_of(start.axes, places, each)
            for each in (turn.real * x + turn.imag * y, turn.real * y - turn.imag * x)
        )
        return TexturePattern(
            **self.chart(start, xi, eta),
            directions=jnp.asarray(cell.directions),
            cell=cell,
            offsets=_offsets(self.phases, len(part.slabs)),
        )


def _offsets(phases: int, layers: int) -> tuple[tuple[float, float], ...]:
    """By how much the drawing is moved on each layer, in periods along both axes.

    A rule of good lattice points: the phases together are as even in both directions, as those of a
    one-dimensional one are in one (Korobov 1959).
    """
    step = min(
        (k for k in range(1, phases + 1) if gcd(k, phases) == 1),
        key=lambda k: abs(k - 0.382 * phases),
    )
    return tuple(
        ((k % phases + 0.5) / phases, (k * step % phases + 0.5) / phases) for k in range(layers)
    )
