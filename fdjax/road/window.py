"""Windows with soft edges, for a porosity that can be differentiated.

Measuring counts with sharp windows (`plan.measure`); a road that slides over a sharp edge makes a
jump there, so design counts with edges that rise over half a window, or less. The windows overlap
by all but as much along each axis: no design is fitted to the place of the measuring windows.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdjax.arrays import namespace
from fdjax.part.cells import cell_areas, cells
from fdjax.part.part import Part
from fdjax.road.deposit import Deposit, Raster

Floats = NDArray[np.float64]

_JUMP, _MANY = 0.02, 16
"""Where a target changes by more from cell to cell, it is looked at so often a side in each."""


@dataclass(frozen=True, eq=False)
class SoftWindows:
    """A lattice of soft windows over a part, `steps` to a size along x and y, two along z.

    Edges rise over one such step.

    - `size`: side of a window between the middles of its edges, mm.
    - `start`: corner of the part's box, shape (3,), mm; the first window reaches one step into it.
    - `room`: volume of the part in each window, shape (nx, ny, nz), mm^3.
    - `target`: mean solid share asked for in each window, shape (nx, ny, nz); 0 without room.
    - `full`: the most that a window can hold of a part of this height, mm^3.
    - `total`: volume of material asked for in the whole part, mm^3.

    Edges on the box are hard: nothing slides across them. A part that is alike at all heights has
    one window along z, all of it.
    """

    size: float
    start: Floats
    room: Floats
    target: Floats
    full: float
    total: float
    steps: int = 2

    @classmethod
    def over(
        cls,
        part: Part,
        solid: Callable[[Any, Any, Any], Any],
        size: float,
        *,
        flat: bool,
        steps: int = 2,
    ) -> "SoftWindows":
        """Windows of side `size` (mm) over a part; `solid(x, y, z)` is the solid share asked.

        Regions and target are summed over cells of about a sixteenth of a window, or an eighth
        where many layers differ, cut exactly at the walls; the target where it has steps in finer
        ones. `flat` says that neither changes
        along z.
        """
        fine = 16 if flat else 8
        low, high = np.array([*part.bounds[:2], 0.0]), np.array([*part.bounds[2:], part.height])
        along = np.array([steps, steps, 2])
        count = np.maximum(np.ceil((high - low) * along / size - 1e-6).astype(int), 1) + along - 1
        count[2] = 1 if flat else count[2]
        nothing = np.zeros(count)
        full = size**2 * (part.height if flat else min(size, part.height))
        empty = cls(size, low, nothing, nothing, full, 0.0, steps)
        (edge_x, x), (edge_y, y) = (
            cells(a, b, size / fine) for a, b in zip(low[:2], high[:2], strict=True)
        )
        xx, yy = np.meshgrid(x, y, indexing="ij")
        slabs = part.slabs[:1] if flat else part.slabs
        area = {region: cell_areas(region.geometry, edge_x, edge_y) for region in part.regions}
        room, asked, total = nothing, nothing, 0.0
        for slab in slabs:
            height, middle = slab.height, slab.z - slab.height / 2
            if flat:
                height, middle = part.height, part.height / 2
            volume = height * area[slab.region]
            share = _cell_means(solid, xx, yy, middle, edge_x[1] - edge_x[0], edge_y[1] - edge_y[0])
            wanted = volume * np.where(volume > 0, share, 0.0)
            place = x, y, np.array([middle])
            room = room + empty.sums(Raster(*place, volume[..., None]))
            asked = asked + empty.sums(Raster(*place, wanted[..., None]))
            total += float(wanted.sum())
        return cls(size, low, room, asked / np.maximum(room, 1e-300), full, total, steps)

    @property
    def times(self) -> int:
        """How many windows hold each place."""
        return self.steps**2 * (1 if self.room.shape[2] == 1 else 2)

    def sums(self, deposit: Deposit) -> Any:
        """The volumes of a deposit summed in each window, shape (nx, ny, nz)."""
        nz = self.room.shape[2]
        if isinstance(deposit, Raster):
            x, y, z = (
                self._shares(places - start, count, steps)
                for places, start, count, steps in zip(
                    deposit[:3], self.start, self.room.shape, (self.steps, self.steps, 2),
                    strict=True,
                )
            )  # fmt: skip
            xp = namespace(deposit.volume, x)
            rows = xp.tensordot(x, deposit.volume @ z.T, 1)
            return xp.swapaxes(xp.tensordot(rows, y, ((1,), (1,))), 1, 2)
        along_z = self._shares(deposit.xyz[:, 2] - self.start[2], nz, 2)
        return namespace(deposit.volume).stack(
            [self._sums_of_points(deposit.xyz, deposit.volume * share) for share in along_z], -1
        )

    def _sums_of_points(self, xyz: Any, volume: Any) -> Any:
        """The volumes of points summed in windows along x and y, shape (nx, ny)."""
        # Each window is so many cells between neighbouring edges, and no two edges' rises overlap:
        # a point lies in two by two cells. A margin of empty cells surrounds them all.
        steps = self.steps
        nx, ny = (count + steps - 1 for count in self.room.shape[:2])
        i, in_x = self._cells_around(xyz[:, 0] - self.start[0], nx, steps)
        j, in_y = self._cells_around(xyz[:, 1] - self.start[1], ny, steps)
        parts = in_x[:, :, None] * in_y[:, None, :] * volume[:, None, None]
        place = i[:, :, None] * ny + j[:, None, :]
        if namespace(xyz, volume) is np:
            sums = np.bincount(place.ravel(), parts.ravel(), nx * ny)
        else:
            sums = namespace(parts).zeros(nx * ny).at[place.ravel()].add(parts.ravel())
        rows = _runs(sums.reshape(nx, ny), steps)
        return _runs(rows.T, steps).T

    def _shares(self, distance: Any, count: int, steps: int) -> Any:
        """How much of each of `count` windows along an axis a place has, shape (count, n)."""
        if count == 1:
            return np.ones((1, len(distance)))
        xp = namespace(distance)
        cells = count + steps - 1
        near, share = self._cells_around(distance, cells, steps)
        cell = xp.arange(cells)[:, None, None]
        return _runs(xp.where(cell == near, share, 0.0).sum(-1), steps)

    def _cells_around(self, distance: Any, cells: int, steps: int) -> tuple[Any, Any]:
        """The cells before and after the nearest edge, shape (n, 2), and the shares in them.

        Of all `cells` along an axis those within the box lie between margins of `steps` - 1. An
        edge rises over a cell, once continuously differentiable.
        """
        xp = namespace(distance)
        within = cells - 2 * (steps - 1)
        distance = distance * (steps / self.size)
        edge = xp.clip(xp.round(distance), 0, within)
        rise = xp.clip(distance - edge + 0.5, 0.0, 1.0)
        rise = rise * rise * (3 - 2 * rise)
        rise = xp.where(edge == 0, 1.0, xp.where(edge == within, 0.0, rise))
        cells_around = edge.astype(int)[:, None] + np.arange(2) + steps - 2
        return cells_around, np.array([1.0, 0.0]) + rise[:, None] * np.array([-1.0, 1.0])


def _runs(cells: Any, steps: int) -> Any:
    """Sums of so many rows that follow each other, from each that has so many behind it."""
    count = len(cells) - steps + 1
    return sum((cells[k : k + count] for k in range(1, steps)), cells[:count])


def _cell_means(
    solid: Callable[[Any, Any, Any], Any], x: Floats, y: Floats, z: float, wide: float, deep: float
) -> Floats:
    """The solid share in cells `wide` by `deep` around middles x and y, (n, m), mm: there, or where
    it changes by more than `_JUMP` from one to the next in the mean over `_MANY` places a side.
    """
    value = np.array(np.broadcast_to(np.asarray(solid(x, y, z), float), x.shape))
    steep = np.zeros(x.shape, bool)
    for axis in (0, 1):
        # Beyond the part a target may be anything.
        with np.errstate(invalid="ignore"):
            jump = np.abs(np.diff(value, axis=axis)) > _JUMP
        none = np.zeros_like(value[:1, :] if axis == 0 else value[:, :1], bool)
        steep |= np.concatenate([jump, none], axis) | np.concatenate([none, jump], axis)
    if steep.any():
        share = (np.arange(_MANY) + 0.5) / _MANY - 0.5
        right = x[steep][:, None, None] + share[:, None] * wide
        up = y[steep][:, None, None] + share * deep
        right, up = np.broadcast_arrays(right, up)
        value[steep] = np.asarray(solid(right, up, z)).mean((1, 2))
    return value
