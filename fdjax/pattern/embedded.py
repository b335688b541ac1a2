"""Embedded grids: zones of a base grid in which each of its cells is divided (paper, Figure 7a).

The base grid keeps its lines; a zone that lies in others divides what these have divided already.
"""

from dataclasses import dataclass, field
from functools import cached_property
from math import lcm
from typing import Any

import numpy as np
import shapely

from fdjax.arrays import namespace
from fdjax.target.raster import Raster

MOST = 64
"""Largest number of parts of a base cell's side, all zones in each other together."""


_ON_WALL = 1e-6
"""A border nearer to a wall than this share of the base's size lies on it."""


@dataclass(frozen=True, eq=False)
class Zone:
    """Where cells of the base grid carry a finer one.

    - `outline`: polygons, mm; a cell belongs to the zone if its middle does.
    - `refine`: parts of each side of a cell.
    - `distance`: signed distance to the outline, mm, positive inside.
    - `fade`: side of the cells there, mm: over so much a border is smeared in the mean of layers.
    - `border`: pieces of the outline, lines between two points, mm, where fine lines that end
      there and opposite are joined.
    """

    outline: Any
    refine: int
    distance: Raster
    fade: float
    border: Any = field(default_factory=shapely.MultiLineString)

    @classmethod
    def of(cls, outline: Any, refine: int, *, base: Any, fade: float, resolution: float) -> "Zone":
        """A zone within the outline of the base, its distance to a resolution (mm).

        Along walls of the base it has no border: there distances are those to the rest of it.
        """
        x0, y0, x1, y1 = base.bounds
        axes = [
            np.linspace(a, b, int(np.clip(np.ceil((b - a) / resolution), 2, 800)) + 1)
            for a, b in ((x0, x1), (y0, y1))
        ]
        points = shapely.points(*np.meshgrid(*axes, indexing="ij"))
        size = float(np.hypot(x1 - x0, y1 - y0))
        walls = shapely.boundary(base).buffer(_ON_WALL * size)
        border = shapely.difference(shapely.boundary(outline), walls)
        rest = shapely.difference(base, outline.buffer(_ON_WALL * size))
        if border.is_empty or rest.is_empty:
            distance = np.full([len(axis) for axis in axes], size)
        else:
            far = shapely.distance(border, points)
            # Beside the base, as what lies nearest.
            inside = shapely.distance(outline, points) < shapely.distance(rest, points)
            distance = np.where(inside, far, -far)
        return cls(outline, refine, Raster(distance, (x0, y0, x1, y1)), fade)


@dataclass(frozen=True, eq=False)
class Embedded:
    """The zones of a base grid, in the order in which they divide its cells."""

    zones: tuple[Zone, ...]

    def times(self, xy: Any, *, beyond: float = 0.0) -> Any:
        """How many times as many lines as the base has lie at places, in the mean of the layers.

        `xy`: mm, shape (..., 2), NumPy's or JAX's; the result has shape (...).
        `beyond`: so many cells outside, a zone counts as at its border. Differentiable, with kinks
        where a border's smear begins and ends.
        """
        xp = namespace(xy)
        result = xp.ones(xy.shape[:-1])
        for zone in self.zones:
            depth = zone.distance(xy[..., 0], xy[..., 1]) / zone.fade + 0.5 + beyond
            result = result * (1 + (zone.refine - 1) * xp.clip(depth, 0.0, 1.0))
        return result

    def ways(self, clear: Any) -> tuple[Any, Any]:
        """Places xy along the borders, (n, 2), mm, and the length of joins at each, (n,), mm.

        In the mean of a family's layers: two fine lines that a line takes turn over four of their
        spacings, half of that at either border, and fall short of it by `clear` mm at each turn.
        """
        xp = namespace(clear)
        xy, length = [np.zeros((0, 2))], [xp.zeros(0)]
        for zone in self.zones:
            share = (zone.refine - 1) / zone.refine * xp.maximum(1 - 2 * clear / zone.fade, 0.0)
            ends = shapely.get_coordinates(zone.border).reshape(-1, 2, 2)
            xy.append(ends.mean(1))
            length.append(share * np.hypot(*(ends[:, 1] - ends[:, 0]).T))
        return np.concatenate(xy), xp.concatenate(length)

    @cached_property
    def parts(self) -> int:
        """Parts of a base cell's side on which all lines lie: a common multiple of the zones'."""
        pieces: list[tuple[Any, int]] = []
        for zone in self.zones:
            inner = [(shapely.intersection(each, zone.outline), k) for each, k in pieces]
            pieces += [(each, k * zone.refine) for each, k in inner if each.area > 0]
            pieces.append((zone.outline, zone.refine))
        return lcm(*(k for _, k in pieces))

    @property
    def facts(self) -> list[dict[str, Any]]:
        """What a report says of each zone: its parts, area, mm^2, box and sides of cells, mm."""
        return [
            {
                "refine": zone.refine,
                "area": float(zone.outline.area),
                "bounds": list(zone.outline.bounds),
                "cell": zone.fade,
            }
            for zone in self.zones
        ]

    def divided(self, middles: Any, counts: tuple[int, int]) -> np.ndarray:
        """Into how many parts each way the base cells are divided, at all places of a lattice.

        - `counts`: base cells along xi and eta.
        - `middles`: gives the middles xy, (n, m, 2), mm, of the blocks that each cell falls into
          when its sides have so many parts: a function of that number.

        Returns whole numbers, shape (counts[0] * parts, counts[1] * parts).
        """
        parts = self.parts
        result = np.ones((counts[0] * parts, counts[1] * parts), int)
        for zone in self.zones:
            before = result.copy()
            for now in np.unique(before).tolist():
                xy = middles(now)
                inside = shapely.contains_xy(zone.outline, xy[..., 0], xy[..., 1])
                block = parts // now
                inside = inside.repeat(block, 0).repeat(block, 1)
                result[inside & (before == now)] = now * zone.refine
        return result
