"""Drawings as roads: what repeats in the plane of two functions of the place.

An edge d of a drawing has in a chart with gradients G the length |G^-1 d| on the layer, and there
are |det G| cells' areas an area: so the length of centre line an area is
`|det G| sum |G^-1 d| = sum |d1 grad eta - d2 grad xi|`, over the edges of a cell of area 1. Nothing
has to be drawn to know where the material goes. A single edge along an axis gives lines, |grad|.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from fdjax.field.pointwise import place_by_place
from fdjax.field.spline import Axis, scattered
from fdjax.limits import Limits
from fdjax.pattern.base import Penalties
from fdjax.pattern.chart import FLAT, ChartPattern, Controls, Lattice, Realised, density_of
from fdjax.pattern.drawn import Chart
from fdjax.pattern.width import within
from fdjax.road.bead import section_area
from fdjax.road.deposit import Raster
from fdjax.road.stroke import Stroke

Floats = NDArray[np.float64]

DISTORTION = 3.0
"""Largest ratio of the scales along and across in which a drawing is laid."""

_FIRST = 0.1
"""Some layers are more finely divided where this share of a step of the depth is asked for."""

_TIGHT = 0.05
"""Between places looked at, roads come this share closer."""


class Placing(NamedTuple):
    """How a drawing lies on a layer: moved by shares of its periods, turned by a quarter or not,
    the share of the layers that are more finely divided where it may be, and whether it is
    mirrored along xi and along eta, before it is turned.
    """

    xi: float
    eta: float
    turned: bool
    finer: float
    mirrored: tuple[bool, bool] = (False, False)


class DrawnPattern(ChartPattern):
    """A drawing in the plane of xi and eta, laid as a whole on each layer.

    - `directions`: of its edges, an area of 1, as vectors, shape (d, 2).
    - `gap`: least distance of its lines; `pore`: how far they run over its largest opening, where
      the drawing is laid on itself moved; both in its units.
    - `placing`: of the drawing on each layer.
    - `kind`: of the pattern, and the name of its roads' family.
    """

    directions: Array
    gap: float
    pore: float
    placing: tuple[Placing, ...] = eqx.field(static=True)
    kind: str = eqx.field(static=True)

    @abstractmethod
    def stroke(self, chart: Chart, placing: Placing, controls: Controls) -> Stroke:
        """The drawing on one layer."""

    def density(self, realised: Realised) -> Array:
        """Centre line an area on each layer, 1/mm, a mean over all ways to move the drawing."""
        (xi_x, xi_y), (eta_x, eta_y) = realised.gradient
        return realised.times * sum(
            (
                density_of(d[0] * eta_x - d[1] * xi_x, d[0] * eta_y - d[1] * xi_y)
                for d in self.directions
            ),
            jnp.zeros(()),
        )

    def deposit(self, realised: Realised) -> Raster:
        """The drawing over the room for centre lines: its roads end at the walls."""
        room, width = self.room, realised.width
        run = self.density(realised) * room.area_at(width / 2)
        return Raster(room.x, room.y, room.z, run * section_area(width, room.height) * room.layers)

    def cells(self, realised: Realised) -> tuple[Array, Array, Array]:
        room = self.room
        solid = self.density(realised) * section_area(realised.width, room.height) / room.height
        volume = room.area_at(realised.width / 2) * room.height * room.layers
        points, volumes = Raster(room.x, room.y, room.z, volume).points
        return points, 1 - solid.reshape(-1), volumes

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        inside = self.room.area[0] > 0
        finest, coarsest = self._divided(realised.times)
        least = (limits.least_spacing or realised.width) * (1 + _TIGHT) / self.gap * finest
        least = jnp.broadcast_to(least, inside.shape)
        most = jnp.broadcast_to(self.reach / self.pore * coarsest, inside.shape)
        distortion, spacing, span = _excess(
            *realised.gradient[0], *realised.gradient[1], least, most
        )
        count = inside.sum() / inside.size
        # Away from the room the drawing may be as it likes, but for folds: a fold there would
        # bring parts of it into the room a second time.
        kinds = {
            "distortion": distortion / 2,
            "spacing": jnp.where(inside, spacing, -1.0),
            "span": jnp.where(inside, span, -1.0),
        }
        return {name: values.ravel() / jnp.sqrt(count) for name, values in kinds.items()}

    def _divided(self, times: Any) -> tuple[Any, Any]:
        """By how much the finest and the coarsest of the layers divide a drawing's steps."""
        finest = coarsest = jnp.ones_like(times)
        for depth in range(round(np.log2(self.finest))):
            size = 2.0**depth
            finest += size * jnp.clip((times - size) / (_FIRST * size), 0, 1)
            coarsest += size * jnp.clip(1 - (2 * size - times) / (_FIRST * size), 0, 1)
        return finest, coarsest

    def strokes(self, controls: Controls) -> Iterator[Sequence[Stroke]]:
        coefficients = np.stack([np.asarray(each) for each in self.coefficients(controls)], -1)
        flat = self.axes[2].count == 1
        made: dict[tuple[Placing, float], Stroke] = {}
        for z, placing in zip(self.middles, self.placing, strict=True):
            at = placing, 0.0 if flat else z
            if at not in made:
                up = self.axes[2].basis(np.array([z]))[0]
                functions = np.einsum("klmf,m->klf", coefficients, up)
                if placing.turned:
                    functions = functions[..., ::-1] * [1, -1]
                chart = Chart(functions, self.axes[:2], self._times(controls, up))
                made[at] = self.stroke(chart, placing, controls)
            yield [made[at]]

    def _times(self, controls: Controls, up: Floats) -> Callable[[Floats], Floats] | None:
        """How often as dense as the chart a drawing is at places (n, 2), mm, of one layer."""
        if controls.times is None:
            return None
        free = np.asarray(controls.times) @ up

        def times(places: Floats) -> Floats:
            (at,) = scattered(free, self.axes[:2], places, (0, 0))
            return np.asarray(within(jnp.asarray(at), 1.0, self.finest))

        return times

    def road_widths(self, controls: Controls, places: np.ndarray) -> np.ndarray:
        """Road width at places (n, 2), mm, shape (n,)."""
        width = controls.width
        if width is None or width.ndim == 0:
            one = self.width if width is None else float(within(width, *self.width_range))
            return np.full(len(places), one)
        axes = tuple(
            Axis(axis.low, axis.high, count)
            for axis, count in zip(self.axes, width.shape, strict=False)
        )
        (free,) = scattered(np.asarray(width), (axes[0], axes[1]), places, (0, 0))
        return np.asarray(within(jnp.asarray(free), *self.width_range))

    def facts(self, controls: Controls) -> dict[str, Any]:
        """Knots, and over the part the least and largest scale of the drawing and their ratio."""
        inside = np.asarray(self.room.area[0] > 0)
        lattice = Lattice(*map(np.asarray, self.lattice))
        slopes = [lattice.gradient(np.asarray(each)) for each in self.coefficients(controls)]
        steep, shallow = (np.asarray(each)[inside] for each in _scales(*slopes[0], *slopes[1]))
        times = np.broadcast_to(self.times_on(controls), inside.shape)[inside]
        finest, coarsest = (np.asarray(each) for each in self._divided(times))
        return {
            "kind": self.kind,
            "coefficients": [axis.count for axis in self.axes],
            "knot_distance": [axis.step for axis in self.axes[:2]],
            "placings": len(set(self.placing)),
            "depths": round(np.log2(finest.max())),
            "gap": float(self.gap / (steep * finest).max()),
            "pore": float(self.pore / (shallow * coarsest).min()),
            "distortion": float((steep / shallow).max()),
        }


def _scales(ax: Any, ay: Any, bx: Any, by: Any) -> tuple[Any, Any]:
    """Largest and least singular value of the matrix of two gradients, 1/mm; the least has the
    sign of the determinant.
    """
    # Of any 2 x 2 matrix: half the sizes of its conformal and its anticonformal part, added up.
    even = jnp.sqrt((ax + by) ** 2 + (ay - bx) ** 2 + FLAT**2)
    odd = jnp.sqrt((ax - by) ** 2 + (ay + bx) ** 2 + FLAT**2)
    return (even + odd) / 2, (even - odd) / 2


@place_by_place
def _excess(
    ax: Array, ay: Array, bx: Array, by: Array, least: Array, most: Array
) -> tuple[Array, ...]:
    """By how much two gradients, 1/mm, break the limits of distortion, of the least scale, `least`
    (mm for one unit of the drawing), and of the largest, `most`.
    """
    steep, shallow = _scales(ax, ay, bx, by)
    return 1 - DISTORTION * shallow / steep, steep * least - 1, 1 - most * shallow
