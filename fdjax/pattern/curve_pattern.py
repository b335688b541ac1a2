"""Space-filling curves as roads, in the plane of two functions of the place."""

import equinox as eqx
import numpy as np

from fdjax.pattern.chart import Controls
from fdjax.pattern.curve_order import rank
from fdjax.pattern.drawn import Chart, lattice
from fdjax.pattern.drawn_pattern import DrawnPattern
from fdjax.road.stroke import Curve


class CurvePattern(DrawnPattern):
    """A curve through all places where both functions are whole numbers, by single steps.

    - `order`: name of the curve, whose order the road goes by; see `pattern.curve_order`.
    """

    order: str = eqx.field(static=True)

    def stroke(self, chart: Chart, offset: np.ndarray, controls: Controls) -> Curve:
        xy = lattice(chart, 2 * offset)
        shape = xy.shape[0] // 2, xy.shape[1] // 2
        # A node that is not there has no width of its own.
        there = np.isfinite(xy).all(-1)
        width = np.full(there.shape, self.width_range[1])
        width[there] = self.road_widths(controls, xy[there])
        return Curve(xy, rank(self.order, shape), width, self.kind)
