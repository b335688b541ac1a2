"""Where a pattern puts its material, as design sees it: volumes at places, without single roads.

Arrays are NumPy's or JAX's.
"""

from typing import Any, NamedTuple

from fdjax.arrays import namespace


class Points(NamedTuple):
    """Volumes at places of their own.

    - `xyz`: shape (n, 3), mm; `volume`: shape (n,), mm^3, in the whole part.
    """

    xyz: Any
    volume: Any


class Raster(NamedTuple):
    """Volumes on a lattice of places that do not move.

    - `x`, `y`, `z`: shapes (n,), (m,), (p,), mm; `volume`: shape (n, m, p), mm^3.
    """

    x: Any
    y: Any
    z: Any
    volume: Any

    @property
    def points(self) -> Points:
        """The same volumes as points."""
        xp = namespace(self.volume)
        places: list[Any] = xp.meshgrid(self.x, self.y, self.z, indexing="ij")
        return Points(xp.stack(places, -1).reshape(-1, 3), self.volume.reshape(-1))


Deposit = Points | Raster
"""What a pattern deposits in all layers of a part together."""
