"""The room that centre lines have in a part, as design sees it: cells, and walls in the cells."""

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.part.cells import cell_areas, cells
from fdjax.part.part import Part, Slab

Floats = NDArray[np.float64]


class Room(NamedTuple):
    """A lattice of cells over a part's box; along z each plane of cells stands for some layers.

    - `x`, `y`, `z`: middles of the cells, shapes (n,), (m,), (p,), mm.
    - `margin`: distances that centre lines keep from the walls, shape (s,), mm, rising.
    - `area`: of the room for centre lines in each cell, a mean of the plane's layers, at each of
      these margins, shape (s, n, m, p), mm^2.
    - `layers`, `height`: number and mean height of a plane's layers, shape (p,).
    - `cell`: the cells that pieces of wall lie in, indices of shape (q, 3).
    - `along`: the wall's direction times the piece's length, shape (q, 2), mm.
    """

    x: Any
    y: Any
    z: Any
    margin: Any
    area: Any
    layers: Any
    height: Any
    cell: Any
    along: Any

    @classmethod
    def of(
        cls, part: Part, margins: Floats, *, side: float, thickness: float, flat: bool
    ) -> "Room":
        """The room with cells of about this `side` and planes of about this `thickness`, mm.

        `flat`: one plane for all layers. Walls are those of the middle one of the `margins`, and
        of a plane's middle layer. Raises `InputError` where a region has no room.
        """
        x0, y0, x1, y1 = part.bounds
        (edge_x, x), (edge_y, y) = cells(x0, x1, side), cells(y0, y1, side)
        count = 1 if flat else int(np.clip(round(part.height / thickness), 1, len(part.slabs)))
        planes = [list(some) for some in np.array_split(np.array(part.slabs, object), count)]
        if flat:
            planes = [[part.slabs[0]]]
        free: dict[Any, list[Any]] = {}
        for slab in (slab for plane in planes for slab in plane):
            if slab.region not in free:
                free[slab.region] = [slab.region.inset(margin) for margin in margins]
        areas = {
            region: np.stack([cell_areas(each, edge_x, edge_y) for each in room])
            for region, room in free.items()
        }
        middles = [plane[len(plane) // 2] for plane in planes]
        walls = [
            _wall(free[slab.region][len(margins) // 2], edge_x, edge_y, number)
            for number, slab in enumerate(middles)
        ]
        layers = [len(part.slabs)] if flat else [len(plane) for plane in planes]
        return cls(
            x,
            y,
            np.array([part.height / 2]) if flat else np.array([_middle(plane) for plane in planes]),
            np.asarray(margins, float),
            np.stack([np.mean([areas[s.region] for s in plane], 0) for plane in planes], -1),
            np.array(layers, float),
            np.array([np.mean([slab.height for slab in plane]) for plane in planes]),
            np.concatenate([cell for cell, _ in walls]),
            np.concatenate([along for _, along in walls]),
        )

    def area_at(self, margin: Any) -> Any:
        """Area in each cell, (n, m, p), at a margin: a number, or one for each cell.

        A parabola through the margins looked at; differentiable.
        """
        if len(self.margin) == 1:
            return self.area[0]
        a, b, c = self.margin
        low = (margin - b) * (margin - c) / ((a - b) * (a - c))
        middle = (margin - a) * (margin - c) / ((b - a) * (b - c))
        high = (margin - a) * (margin - b) / ((c - a) * (c - b))
        return low * self.area[0] + middle * self.area[1] + high * self.area[2]

    def at_walls(self, values: Any) -> Any:
        """Values (..., n, m, p) of the cells that pieces of wall lie in, (..., q), by JAX."""
        return values.at[(..., *self.cell.T)].get(**_WITHIN)

    def add_at_walls(self, values: Any, more: Any) -> Any:
        """Values (n, m, p) of cells, with more (q,) for each piece of wall, by JAX."""
        return values.at[tuple(self.cell.T)].add(more, **_WITHIN)


_WITHIN: dict[str, Any] = {"mode": "promise_in_bounds", "wrap_negative_indices": False}
"""Pieces of wall lie in cells that are there."""


def _middle(plane: list[Slab]) -> float:
    return (plane[0].z - plane[0].height + plane[-1].z) / 2


def _wall(room: shapely.Geometry, x: Floats, y: Floats, plane: int) -> tuple[Any, Floats]:
    """The cells of pieces of wall no longer than a cell, and their directions times length."""
    rings = shapely.get_rings(shapely.get_parts(room))
    fine = shapely.segmentize(rings, min(x[1] - x[0], y[1] - y[0]))
    points, ring = shapely.get_coordinates(fine, return_index=True)
    own = ring[1:] == ring[:-1]
    start, end = points[:-1][own], points[1:][own]
    middle = (start + end) / 2
    place = np.stack([
        np.clip(np.searchsorted(edges, middle[:, axis], side="right") - 1, 0, len(edges) - 2)
        for axis, edges in enumerate((x, y))
    ], 1)  # fmt: skip
    return np.column_stack([place, np.full(len(place), plane)]), end - start
