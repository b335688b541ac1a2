"""Textures as roads: a unit cell drawn over and over in the plane of two functions of the place."""

import equinox as eqx
import numpy as np

from fdjax.pattern.chart import Controls
from fdjax.pattern.drawn import Chart, drawn
from fdjax.pattern.drawn_pattern import DrawnPattern, Placing
from fdjax.pattern.unit_cell import UnitCell
from fdjax.road.stroke import Drawing


class TexturePattern(DrawnPattern):
    """The drawing of a unit cell, `cell`, as a graph on each layer."""

    cell: UnitCell = eqx.field(static=True)

    def stroke(self, chart: Chart, placing: Placing, controls: Controls) -> Drawing:
        cell = self.cell.mirrored(placing.mirrored)
        xy, edges = drawn(cell, chart, np.array([placing.xi, placing.eta]))
        return Drawing(xy, edges, self.road_widths(controls, xy[edges].mean(1)), self.kind)
