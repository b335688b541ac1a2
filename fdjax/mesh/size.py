"""How large the cells of a mesh are to be at each place. Loads no JAX."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from fdjax.errors import InputError
from fdjax.part.cells import cell_areas

Floats = NDArray[np.float64]
Outline = shapely.Polygon | shapely.MultiPolygon

MOST_CELLS = 10**6
"""More cells than this are refused before they are made."""

_PLACES = 256
"""Places along the longer side of the box at which a size is looked at."""

_COARSER = 0.3
"""Growth of the cells beyond the walls, mm for each mm of distance: no edge of them is laid."""

_AROUND = 2.0
"""So many cells the box reaches beyond the region at each side."""


@dataclass(frozen=True, eq=False)
class SizeField:
    """Distance of the nodes of an ideal mesh, triangles with equal sides, over a box.

    - `x`, `y`: places, shapes (n,), (m,), mm, rising equally; `size`: there, shape (n, m), mm.
    """

    x: Floats
    y: Floats
    size: Floats

    @classmethod
    def over(cls, region: Outline, size: Callable[[Any, Any], Any]) -> "SizeField":
        """The field `size(x, y)`, mm, of a region (polygons with holes, mm), and beyond its walls
        that of the nearest place, growing coarser.

        Raises `InputError`, with the place, where a size is not positive and finite or larger than
        half the region, and where all together ask for more than `MOST_CELLS` triangles.

        >>> field = SizeField.over(shapely.box(0, 0, 9, 6), lambda x, y: 1 + 0 * x)
        >>> round(field.count(shapely.box(0, 0, 9, 6)))
        62
        """
        low, high = np.array(region.bounds).reshape(2, 2)
        reach = float((high - low).max())
        inside = _within(region, low, high, reach)
        sizes = np.broadcast_to(np.asarray(size(*inside.T), float), len(inside))
        _check(sizes, inside, reach)
        margin = _AROUND * float(sizes.max())
        step = (reach + 2 * margin) / _PLACES
        x, y = (
            np.linspace(a - margin, b + margin, int((b - a + 2 * margin) / step) + 2)
            for a, b in zip(low, high, strict=True)
        )
        places = np.stack(np.meshgrid(x, y, indexing="ij"), -1)
        shapely.prepare(region)
        to_region = shapely.shortest_line(region, shapely.points(places.reshape(-1, 2)))
        nearest = shapely.get_coordinates(to_region).reshape(-1, 2, 2)[:, 0]
        values = np.broadcast_to(np.asarray(size(*nearest.T), float), len(nearest))
        _check(values, nearest, reach)
        values = values + _COARSER * shapely.length(to_region)
        field = cls(x, y, values.reshape(len(x), len(y)))
        cells = 2 * field.count(region)
        if cells > MOST_CELLS:
            raise InputError(
                f"mesh: sizes of {sizes.min():.3g} to {sizes.max():.3g} mm ask for {cells:.3g} "
                f"triangles; {MOST_CELLS:.0e} at most"
            )
        return field

    def at(self, xy: Floats) -> Floats:
        """The size at places in the box, (n, 2), mm: shape (n,)."""
        step = np.array([self.x[1] - self.x[0], self.y[1] - self.y[0]])
        share = (xy - [self.x[0], self.y[0]]) / step
        return map_coordinates(self.size, share.T, order=1, mode="nearest")

    @property
    def density(self) -> Floats:
        """Nodes an area, 1/mm^2, shape (n, m): an ideal cell has the area sqrt(3)/2 size^2."""
        return 2 / np.sqrt(3) / self.size**2

    def count(self, region: Outline) -> float:
        """Nodes in a region."""
        return self.integral(self.density, region)

    def integral(self, values: Floats, region: Outline) -> float:
        """Of values at the field's places, (n, m), over a region, polygons with holes, mm."""
        half = (self.x[1] - self.x[0]) / 2, (self.y[1] - self.y[0]) / 2
        x, y = (
            np.linspace(at[0] - own, at[-1] + own, len(at) + 1)
            for at, own in zip((self.x, self.y), half, strict=True)
        )
        return float((cell_areas(region, x, y) * values).sum())


def _within(region: Outline, low: Floats, high: Floats, reach: float) -> Floats:
    """Places all over a region and along its walls, (n, 2), mm."""
    step = reach / _PLACES
    x, y = (np.arange(a, b + step, step) for a, b in zip(low, high, strict=True))
    places = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    shapely.prepare(region)
    walls = shapely.get_coordinates(shapely.segmentize(region, step))
    return np.concatenate([walls, places[shapely.contains_xy(region, *places.T)]])


def _check(sizes: Floats, places: Floats, reach: float) -> None:
    """Raise `InputError` where a size is none for a region `reach` mm across."""
    with np.errstate(invalid="ignore"):
        good = np.isfinite(sizes) & (sizes > 0)
    if not good.all():
        x, y = places[np.argmin(good)]
        raise InputError(
            f"mesh: the size is {sizes[np.argmin(good)]:g} mm at ({x:.4g}, {y:.4g}) mm; "
            "it must be positive and finite"
        )
    worst = int(np.argmax(sizes))
    if sizes[worst] > reach / 2:
        x, y = places[worst]
        raise InputError(
            f"mesh: cells of {sizes[worst]:.4g} mm are asked at ({x:.4g}, {y:.4g}) mm, more than "
            f"half the part, which is {reach:.4g} mm across"
        )
