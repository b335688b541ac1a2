"""Values on a regular raster, bilinear in between; on NumPy or JAX arrays alike."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdjax.arrays import namespace
from fdjax.errors import InputError

Floats = NDArray[np.float64]
Extent = tuple[float, float, float, float]
"""(x min, y min, x max, y max) in mm, in the order of a Shapely polygon's `bounds`."""


@dataclass(frozen=True, eq=False)
class Raster:
    """Values on a regular raster over a box, bilinear between them and clamped outside.

    - `values`: shape (along x, along y). The first and last of each axis lie on the box's sides.
    - `extent`: the box (x min, y min, x max, y max), mm.

    Linear fields are reproduced exactly. Continuous, with kinks on the raster's lines.

    >>> float(Raster(np.array([[0.2, 0.4], [0.6, 0.8]]), (0, 0, 10, 10))(5.0, 5.0))
    0.5
    """

    values: Floats
    extent: Extent

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=float)
        if values.ndim != 2 or values.size == 0:
            raise InputError(f"raster: shape {values.shape}; two axes (x, y) with values needed")
        x0, y0, x1, y1 = self.extent
        if not (np.isfinite(self.extent).all() and x1 > x0 and y1 > y0):
            raise InputError(f"raster: extent {tuple(self.extent)} is no box (x0, y0, x1, y1)")
        values.setflags(write=False)
        object.__setattr__(self, "values", values)

    def __call__(self, x: Any, y: Any) -> Any:
        """Interpolated values at x and y (mm, one shape)."""
        xp = namespace(x, y)
        values = xp.asarray(self.values)
        x0, y0, x1, y1 = self.extent
        i, i_next, s = _cell(xp, (x - x0) / (x1 - x0), values.shape[0])
        j, j_next, t = _cell(xp, (y - y0) / (y1 - y0), values.shape[1])
        low = (1 - s) * values[i, j] + s * values[i_next, j]
        high = (1 - s) * values[i, j_next] + s * values[i_next, j_next]
        return (1 - t) * low + t * high


def _cell(xp: Any, share: Any, count: int) -> tuple[Any, Any, Any]:
    """Index before and after, and how far between, of a place at this share of an axis."""
    place = xp.clip(share, 0.0, 1.0) * (count - 1)
    # What is not a number goes to the first cell; its share between keeps it not a number.
    before = xp.clip(xp.floor(xp.nan_to_num(place)), 0, max(count - 2, 0)).astype(int)
    return before, xp.minimum(before + 1, count - 1), place - before
