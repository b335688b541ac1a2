"""What holes do to a deposit: lines end at their walls, and part of each wall is covered."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Array, Float

from fdjax.road.bead import section_area
from fdjax.road.porosity import LayerDeposit
from fdjax.target.raster import Raster


class Holes(eqx.Module):
    """The holes of a layer, as design sees them.

    - `distance`: signed distance to the nearest hole, mm, negative inside.
    - `wall`: points (n, 2) half a road off the holes, each standing for `step` (n,) mm of wall.
    - `fade`: distance over which a line's end is smeared, mm.
    """

    distance: Raster = eqx.field(static=True)
    wall: Float[Array, "n 2"]
    step: Float[Array, " n"]
    fade: float

    @classmethod
    def of(cls, outline: shapely.Polygon, *, width: float, resolution: float) -> "Holes | None":
        """The outline's holes, for roads of this width, to this resolution (both mm)."""
        if not outline.interiors:
            return None
        holes = shapely.union_all([shapely.Polygon(ring) for ring in outline.interiors])
        x0, y0, x1, y1 = outline.bounds
        axes = [
            np.linspace(a, b, int(np.ceil((b - a) / resolution)) + 1)
            for a, b in ((x0, x1), (y0, y1))
        ]
        points = shapely.points(*np.meshgrid(*axes, indexing="ij"))
        inside = shapely.contains(holes, points)
        distance = np.where(
            inside,
            -shapely.distance(shapely.boundary(holes), points),
            shapely.distance(holes, points),
        )
        wall, step = [], []
        for ring in shapely.get_parts(shapely.boundary(shapely.buffer(holes, width / 2))):
            count = max(8, int(np.ceil(ring.length / resolution)))
            at = (np.arange(count) + 0.5) / count
            wall.append(
                shapely.get_coordinates(shapely.line_interpolate_point(ring, at, normalized=True))
            )
            step.append(np.full(count, ring.length / count))
        return cls(
            Raster(distance, outline.bounds),
            jnp.asarray(np.concatenate(wall)),
            jnp.asarray(np.concatenate(step)),
            2 * resolution,
        )

    def cut(
        self,
        deposit: LayerDeposit,
        width: Float[Array, ""] | float,
        height: float,
        layers: float,
    ) -> LayerDeposit:
        """The deposit without what lies within half a `width` of a hole, with the joins along
        the walls: on every second gap between lines that the wall cuts, on a share `layers` of
        layers. That is half of a wall square to the lines and nothing of one beside them; 1 / pi
        is the mean over all directions.
        """
        distance = self.distance(deposit.xy[:, 0], deposit.xy[:, 1])
        kept = jnp.clip((distance - width / 2) / self.fade + 0.5, 0.0, 1.0)
        joins = section_area(width, height) * layers / jnp.pi * self.step
        return LayerDeposit(
            jnp.concatenate([deposit.xy, self.wall]),
            jnp.concatenate([deposit.volume * kept, joins]),
        )
