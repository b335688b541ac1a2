"""How far places are from the walls of the room for centre lines, differentiably."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Array, Float

Outline = shapely.Polygon | shapely.MultiPolygon

_NONE = 1e-6
"""So many steps are no way at all."""

_BEYOND = 2.0
"""The lattice reaches so many of its steps beyond the box."""


class WallDistance(NamedTuple):
    """Distances to the walls of some rooms on one lattice, more than 0 inside.

    - `start`, `step`: first place along x and y, shape (2,), and distance of the places, mm.
    - `values`: shape (rooms, n, m), mm.
    """

    start: Any
    step: Any
    values: Any

    @classmethod
    def of(cls, rooms: list[Outline], step: float) -> "WallDistance":
        """The distances to the walls of each room, on places about `step` mm apart."""
        x0, y0, x1, y1 = shapely.total_bounds(rooms)
        start = np.array([x0, y0]) - _BEYOND * step
        counts = (np.array([x1, y1]) + _BEYOND * step - start) // step + 2
        places = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), -1)
        points = shapely.points((start + step * places).reshape(-1, 2))
        values = []
        for room in rooms:
            shapely.prepare([room, room.boundary])
            away = shapely.distance(room.boundary, points)
            inside = shapely.intersects(room, points)
            values.append(np.where(inside, away, -away).reshape(places.shape[:2]))
        return cls(start, step, np.stack(values))

    def at(self, xy: Any, room: Any) -> Float[Array, " n"]:
        """Distance at places (n, 2), mm, from the walls of the room of each, shape (n,).

        Bilinear between places; beyond the lattice it is less than at its rim by the way to it.
        """
        last = jnp.array(self.values.shape[1:]) - 2
        share = (xy - self.start) / self.step
        held = jnp.clip(share, 0, last + 1)
        # Above 0, for a slope where the way is none.
        beyond = self.step * (jnp.sqrt(((share - held) ** 2).sum(-1) + _NONE**2) - _NONE)
        share = held
        cell = jnp.clip(jnp.floor(share), 0, last).astype(int)
        x, y = (share - cell).T
        i, j = cell.T
        low = (1 - x) * self.values[room, i, j] + x * self.values[room, i + 1, j]
        high = (1 - x) * self.values[room, i, j + 1] + x * self.values[room, i + 1, j + 1]
        return (1 - y) * low + y * high - beyond


def inside(start: Any, end: Any, before: Any, after: Any) -> tuple[Any, Any]:
    """What of straight pieces lies inside: share (n,) and the middle of that, (n, 2), mm.

    - `start`, `end`: of the pieces, (n, 2), mm; `before`, `after`: their distances from the walls,
      (n,), mm, taken as linear between.
    """
    reach = jnp.abs(before) + jnp.abs(after)
    share = (jnp.maximum(before, 0) + jnp.maximum(after, 0)) / jnp.where(reach > 0, reach, 1.0)
    # The part outside is at the start where that is further out.
    middle = 0.5 + jnp.where(after > before, 0.5, -0.5) * (1 - share)
    return share, start + middle[:, None] * (end - start)
