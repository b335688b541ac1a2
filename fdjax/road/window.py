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
    - `start`: middle of the first window, shape (2,), mm: the corner of the outline's bounding box.
    - `area`: of the outline in each window, shape (nx, ny), mm^2.
    - `target`: mean solid share asked for in each window, shape (nx, ny); 0 where area is 0.
    - `total`: integral of the solid share asked for over the outline, mm^2.

    Edges on the bounding box are hard: nothing slides across them.
    """

    size: float
    start: Floats
    area: Floats
    target: Floats
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
        windows = np.ceil([(x1 - x0) * 2 / size - 1e-6, (y1 - y0) * 2 / size - 1e-6]).astype(int)
        nothing = np.zeros(np.maximum(windows, 1) + 1)
        empty = cls(size, np.array([x0, y0]), nothing, nothing, 0.0)
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
        # Each window is two by two cells between neighbouring edges, and no two edges' rises
        # overlap: a point lies in two by two cells. A margin of empty cells surrounds them all.
        nx, ny = (count + 1 for count in self.area.shape)
        i, in_x = self._cells_around(xy[:, 0] - self.start[0], nx - 2)
        j, in_y = self._cells_around(xy[:, 1] - self.start[1], ny - 2)
        parts = in_x[:, :, None] * in_y[:, None, :] * amounts[:, None, None]
        place = i[:, :, None] * ny + j[:, None, :]
        if namespace(xy, amounts) is np:
            sums = np.bincount(place.ravel(), parts.ravel(), nx * ny)
        else:
            sums = namespace(xy, amounts).zeros(nx * ny).at[place.ravel()].add(parts.ravel())
        sums = sums.reshape(nx, ny)
        sums = sums[1:] + sums[:-1]
        return sums[:, 1:] + sums[:, :-1]

    def _cells_around(self, distance: Any, cells: int) -> tuple[Any, Any]:
        """The cells before and after the nearest edge, shape (n, 2), and the shares in them.

        Cells are numbered from 1. An edge rises over half a window, once continuously
        differentiable.
        """
        xp = namespace(distance)
        distance = distance * (2 / self.size)
        edge = xp.clip(xp.round(distance), 0, cells)
        rise = xp.clip(distance - edge + 0.5, 0.0, 1.0)
        rise = rise * rise * (3 - 2 * rise)
        rise = xp.where(edge == 0, 1.0, xp.where(edge == cells, 0.0, rise))
        cells_around = edge.astype(int)[:, None] + np.arange(2)
        return cells_around, np.array([1.0, 0.0]) + rise[:, None] * np.array([-1.0, 1.0])


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
