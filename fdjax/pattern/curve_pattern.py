"""Space-filling curves as roads, in the plane of two functions of the place."""

from collections.abc import Callable

import equinox as eqx
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from fdjax.pattern.chart import Controls
from fdjax.pattern.curve_order import rank
from fdjax.pattern.drawn import Chart, halved, lattice
from fdjax.pattern.drawn_pattern import DrawnPattern, Placing
from fdjax.road.stroke import Curve

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class CurvePattern(DrawnPattern):
    """A curve through all places where both functions are whole numbers, by single steps; on some
    layers by halves and quarters of steps, where it is to be denser than the chart.

    - `order`: name of the curve, whose order the road goes by; see `pattern.curve_order`.
    """

    order: str = eqx.field(static=True)

    def stroke(self, chart: Chart, placing: Placing, controls: Controls) -> Curve:
        xy, first = lattice(chart, 2 * np.array([placing.xi, placing.eta]))
        levels = [xy]
        if chart.times is not None:
            levels = _levels(chart, xy, first, chart.times, placing.finer, self.finest)
        made, flip = None, placing.mirrored
        for xy in reversed(levels):
            shape = xy.shape[0] // 2, xy.shape[1] // 2
            # A node that is not there has no width of its own.
            there = np.isfinite(xy).all(-1)
            width = np.full(there.shape, self.width_range[1])
            width[there] = self.road_widths(controls, xy[there])
            order = rank(self.order, shape)[tuple(slice(None, None, -1 if m else 1) for m in flip)]
            made = Curve(xy, order, width, self.kind, finer=made)
        assert made is not None
        return made


def _levels(
    chart: Chart,
    xy: Floats,
    first: Floats,
    times: Callable[[Floats], Floats],
    finer: float,
    finest: float,
) -> list[Floats]:
    """The nodes of each depth: where a square is split, four squares take its place.

    - `xy`, `first`: as `lattice` gives them; `times`: how often as dense as the chart the curve is
      to be at places (n, 2); `finer`: share of the layers that are split where this one is.

    Sides that meet differ by one depth at most.
    """
    levels, size = [xy], 1.0
    kept = np.zeros((xy.shape[0] // 2, xy.shape[1] // 2), bool)
    while size < finest:
        corners = levels[-1].reshape(len(kept), 2, kept.shape[1], 2, 2)
        middle = np.asarray(corners.mean((1, 3)))
        there = np.isfinite(middle).all(-1)
        split = np.zeros(kept.shape, bool)
        split[there] = times(middle[there]) / size - 1 > finer
        split &= ~kept
        if not split.any():
            break
        levels.append(halved(chart, levels[-1], first, 1 / size, split))
        levels[-2] = np.where(
            np.repeat(np.repeat(split, 2, 0), 2, 1)[..., None], np.nan, levels[-2]
        )
        # Beside what stays coarse nothing is split twice.
        coarse = np.asarray(binary_dilation(there & ~split, np.ones((3, 3))), bool)
        kept = np.repeat(np.repeat(coarse, 2, 0), 2, 1)
        first, size = first - 0.25 / size, 2 * size
    return levels
