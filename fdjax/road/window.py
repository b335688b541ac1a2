"""Square windows with soft edges, for a porosity that can be differentiated.

Measuring counts with sharp windows (`plan.measure`); a road that slides over a sharp edge makes a
jump there, so design counts with edges that rise over half a window. The windows overlap by half
in both directions: no design is fitted to the place of the measuring windows.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.arrays import namespace

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SoftWindows:
    """A lattice of soft windows over an outline, every half a size in x and in y.

    - `size`: side of a window between the middles of its edges, mm.
    - `x`, `y`: middles of the windows' low and high edges, shapes (nx, 2), (ny, 2), mm; far away
      where an edge lies on or beyond the outline's bounding box, since nothing slides across.
    - `area`: of the outline in each window, shape (nx, ny), mm^2.
    - `target`: mean solid share asked for in each window, shape (nx, ny); 0 where area is 0.
    - `start`: middle of the first window, shape (2,), mm.
    - `total`: integral of the solid share asked for over the outline, mm^2.
    """

    size: float
    x: Floats
    y: Floats
    area: Floats
    target: Floats
    start: Floats
    total: float

    @classmethod
    def over(
        cls, outline: shapely.Polygon, target: Any, size: float, fine: int = 16
    ) -> "SoftWindows":
        """Windows of side `size` (mm) over `outline`; `target(x, y)` is the solid share asked.

        The outline's area and the target are summed over cells of about a `fine`-th of a window,
        cut exactly at the outline.
        """
        x0, y0, x1, y1 = outline.bounds
        (corner_x, mid_x), (corner_y, mid_y) = (
            _cells(a, b, size / fine) for a, b in ((x0, x1), (y0, y1))
        )
        area = _cut_cells(outline, corner_x, corner_y)
        xx, yy = np.meshgrid(mid_x, mid_y, indexing="ij")
        asked = np.where(area > 0, np.asarray(target(xx, yy)), 0.0)
        x, y = _edges(x0, x1, size), _edges(y0, y1, size)
        empty = cls(size, x, y, np.zeros(()), np.zeros(()), np.array([x0, y0]), 0.0)
        points = np.stack([xx.ravel(), yy.ravel()], 1)
        sums, asked_sums = (
            empty.sums(points, area.ravel()),
            empty.sums(points, (area * asked).ravel()),
        )
        return replace(
            empty,
            area=sums,
            target=asked_sums / np.maximum(sums, 1e-300),
            total=float((area * asked).sum()),
        )

    def sums(self, xy: Any, amounts: Any) -> Any:
        """Amounts (n,) at points xy (n, 2) summed in each window, shape (nx, ny)."""
        i, in_x = self._around(xy[:, 0], self.x, self.start[0])
        j, in_y = self._around(xy[:, 1], self.y, self.start[1])
        parts = in_x[:, :, None] * in_y[:, None, :] * amounts[:, None, None]
        place = i[:, :, None] * len(self.y) + j[:, None, :]
        total = len(self.x) * len(self.y)
        if namespace(xy, amounts) is np:
            sums = np.bincount(place.ravel(), parts.ravel(), total)
        else:
            sums = namespace(xy, amounts).zeros(total).at[place.ravel()].add(parts.ravel())
        return sums.reshape(len(self.x), len(self.y))

    def _around(self, places: Any, edges: Any, start: Any) -> tuple[Any, Any]:
        """The three windows, shape (n, 3), that a place may lie in, and its weights there."""
        xp = namespace(places)
        nearest = xp.round((places - start) * (2 / self.size)).astype(int)
        windows = xp.clip(nearest - 1, 0, len(edges) - 3)[:, None] + np.arange(3)
        edges = xp.asarray(edges)[windows]
        rise = xp.clip((places[:, None, None] - edges) * (2 / self.size) + 0.5, 0.0, 1.0)
        rise = rise * rise * (3 - 2 * rise)
        return windows, rise[..., 0] - rise[..., 1]


def _edges(start: float, end: float, size: float) -> Floats:
    """Low and high edges of windows every half size, the first and last half outside, at least 3.

    An edge rises over half a window, once continuously differentiable, so that windows a size
    apart add up to one.
    """
    middle = start + np.arange(max(3, int(np.ceil((end - start) * 2 / size - 1e-6)) + 1)) * size / 2
    low, high = middle - size / 2, middle + size / 2
    slack = 1e-6 * size
    low = np.select([low <= start + slack, low >= end - slack], [-1e9, 1e9], low)
    high = np.where(high >= end - slack, 1e9, high)
    return np.stack([low, high], 1)


def _cells(start: float, end: float, side: float) -> tuple[Floats, Floats]:
    """Corners and middles of cells of about this side that fill the interval exactly."""
    corners = np.linspace(start, end, max(1, round((end - start) / side)) + 1)
    return corners, (corners[1:] + corners[:-1]) / 2


def _cut_cells(outline: shapely.Polygon, x: Floats, y: Floats) -> Floats:
    """Area of the outline in each cell of a lattice with these edges."""
    boxes = shapely.box(x[:-1, None], y[:-1], x[1:, None], y[1:])
    shapely.prepare(outline)
    inside = shapely.contains_properly(outline, boxes)
    area = np.where(inside, shapely.area(boxes), 0.0)
    edge = ~inside & shapely.intersects(outline, boxes)
    area[edge] = shapely.area(shapely.intersection(boxes[edge], outline))
    return area
