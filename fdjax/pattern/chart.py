"""Charts as two functions of the place, splines over the part's box: what their patterns share.

xi and eta are known as fields xi(x, y, z), eta(x, y, z), as in the first form of the paper's (5):
a chart that needs no four sides. What is drawn in its plane, the pattern says.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.arrays import namespace
from fdjax.field.pointwise import place_by_place
from fdjax.field.poisson import Poisson
from fdjax.field.spline import Axis, product
from fdjax.pattern.base import AbstractPattern, Panel
from fdjax.pattern.width import within
from fdjax.road.room import Room

jax.tree_util.register_static(Axis)

_SMOOTH = 1.6
"""A third derivative of one line over this length cubed, mm, is a roughness of one."""

_STEP = 5.0
"""Waves shorter than 2 pi times this, mm, are held back in the steps of a design."""


class Controls(eqx.Module):
    """The real numbers that shape a chart.

    - `xi`, `eta`: spline coefficients of the two functions, shape (K, L, M); where P or Q is
      controlled, the data of `field.poisson.Poisson` instead.
    - `width`: road width as the free number of `width.within`, shape () or, as a spline over the
      box, (K', L'); None where it is given.
    - `times`: how often as dense as the chart is what is drawn in it, a spline of a free number of
      `width.within`; None where it is as dense.
    """

    xi: Float[Array, "K L M"]
    eta: Float[Array, "K L M"]
    width: Float[Array, "..."] | None = None
    times: Float[Array, "K L M"] | None = None


class Lattice(NamedTuple):
    """The bases of the splines at the places where design looks, by axis, and their slopes.

    Arrays, NumPy's or JAX's: `x` (n, K), `y` (m, L), `z` (p, M), `slope_x`, `slope_y`.
    """

    x: Any
    y: Any
    z: Any
    slope_x: Any
    slope_y: Any

    @classmethod
    def of(cls, axes: tuple[Axis, Axis, Axis], room: Room) -> "Lattice":
        x, y, z = axes
        bases = (x.basis(room.x), y.basis(room.y), z.basis(room.z))
        return jax.device_put(cls(*bases, x.basis(room.x, 1), y.basis(room.y, 1)))

    def gradient(self, coefficients: Any) -> Any:
        """Slopes along x and along y on the lattice, (..., 2, n, m, p), 1/mm, of splines with
        coefficients (..., K, L, M).
        """
        xp = namespace(coefficients, *self)
        along_x, along_y = xp.stack([self.slope_x, self.x]), xp.stack([self.y, self.slope_y])
        each = coefficients[..., None, :, :, :]
        return product(each, along_x[:, None], along_y[:, None], self.z)


class Realised(NamedTuple):
    """What controls amount to: both functions' coefficients and, on the lattice, their gradients
    (1/mm), x before y, their densities |grad| (1/mm), the road width (mm) and how often as dense as
    the chart is what is drawn in it.
    """

    coefficients: Float[Array, "2 K L M"]
    gradient: Float[Array, "2 2 n m p"]
    density: Float[Array, "2 n m p"]
    width: Float[Array, "#n #m #p"]
    times: Float[Array, "#n #m #p"]
    made: Bool[Array, ""]


class ChartPattern(AbstractPattern):
    """A pattern drawn in the plane of two functions xi and eta.

    - `first`: the controls to start from.
    - `axes`: of the splines along x, y and z; `lattice`: their bases where design looks.
    - `room`: for centre lines.
    - `poisson`: solves for a function whose Laplacian is controlled; `sources`: which are.
    - `waves`: of each axis, by which steps are scaled.
    - `width_bases`: of a width field along x and y, where design looks.
    - `width`: road width, mm, where it is not a control; `width_range`: what it may be.
    - `finest`: most times as dense as the chart that what is drawn in it may be.
    - `reach`: longest span of a road over the layer below, mm.
    - `middles`: height of the middle of each layer, mm.
    """

    first: Controls
    lattice: Lattice
    room: Room
    poisson: Poisson | None
    waves: tuple[tuple[Array, Array], ...]
    width_bases: tuple[Array, ...]
    width: float
    width_range: tuple[float, float]
    reach: float
    axes: tuple[Axis, Axis, Axis] = eqx.field(static=True)
    middles: tuple[float, ...] = eqx.field(static=True)
    sources: tuple[bool, bool] = eqx.field(static=True)
    finest: float = eqx.field(static=True)

    def controls(self) -> Controls:
        return self.first

    def at(self, controls: Controls) -> "ChartPattern":
        return eqx.tree_at(lambda p: p.first, self, controls)

    def realise(self, controls: Controls) -> Realised:
        coefficients = jnp.stack(self.coefficients(controls))
        gradient = self.lattice.gradient(coefficients)
        density = density_of(gradient[:, 0], gradient[:, 1])
        width = self.width_at(controls, self.width_bases)
        times = self.times_on(controls)
        made = jnp.isfinite(density.sum())
        return Realised(coefficients, gradient, density, width, times, made)

    def coefficients(self, controls: Controls) -> tuple[Array, Array]:
        """Spline coefficients of both functions; where P or Q is controlled, (5) is solved."""
        xi, eta = controls.xi, controls.eta
        if self.poisson is not None:
            xi = self.poisson.coefficients(xi) if self.sources[0] else xi
            eta = self.poisson.coefficients(eta) if self.sources[1] else eta
        return xi, eta

    def width_at(self, controls: Controls, bases: Sequence[Any]) -> Array:
        """Road width, mm, on a lattice (n, m, 1), or one for all (1, 1, 1).

        `bases` are those of a width field along x and y there.
        """
        if controls.width is None:
            return jnp.full((1, 1, 1), self.width)
        low, high = self.width_range
        if controls.width.ndim == 0:
            return within(controls.width, low, high).reshape(1, 1, 1)
        free = bases[0] @ controls.width @ jnp.asarray(bases[1]).T
        return within(free, low, high)[..., None]

    def times_on(self, controls: Controls) -> Array:
        """How often as dense as the chart what is drawn in it is, (n, m, p), or (1, 1, 1)."""
        if controls.times is None:
            return jnp.ones((1, 1, 1))
        free = product(controls.times, self.lattice.x, self.lattice.y, self.lattice.z)
        return within(free, 1.0, self.finest)

    def roughness(self, controls: Controls) -> Float[Array, " n"]:
        pieces = []
        for source, values in zip(self.sources, (controls.xi, controls.eta), strict=True):
            # The slope of a function's Laplacian is a third derivative of it.
            order, weight = (1, _SMOOTH**2) if source else (3, _SMOOTH**2 / self._knot_area)
            inner = values[1:-1, 1:-1] if source else values
            pieces += [weight * each for each in _differences(inner, order)]
        for field in (controls.width, controls.times):
            if field is not None:
                bends = _differences(field, 2)
                pieces += [bend / np.sqrt(field.size) for bend in bends]
        return jnp.concatenate([piece.ravel() for piece in pieces])

    @property
    def _knot_area(self) -> float:
        return self.axes[0].step * self.axes[1].step

    def scale(self, step: Controls) -> Controls:
        smoothed = _smoothed(jnp.stack([step.xi, step.eta]), self.waves)
        xi, eta = (
            values.at[1:-1, 1:-1].divide(_STEP**2) if source else smooth
            for source, values, smooth in zip(
                self.sources, (step.xi, step.eta), smoothed, strict=True
            )
        )
        times = None if step.times is None else _smoothed(step.times, self.waves)
        return Controls(xi, eta, step.width, times)

    def widths(self, realised: Realised) -> tuple[Array, Array]:
        return realised.width.min(), realised.width.max()

    def pictures(self, controls: Controls) -> dict[str, tuple[Panel, ...]]:
        x, y = (np.linspace(axis.low, axis.high, 6 * axis.count) for axis in self.axes[:2])
        p, q = (each[..., -1] for each in self.laplacians(controls, x, y))
        return {"laplacians": (Panel("P = lap(ξ)", x, y, p), Panel("Q = lap(η)", x, y, q))}

    def laplacians(
        self, controls: Controls, x: np.ndarray | None = None, y: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """P = lap(xi) and Q = lap(eta) on a lattice, (n, m, p), 1/mm^2; where design looks, if no
        other x (n,) and y (m,) are given.
        """
        places = self.room.x if x is None else x, self.room.y if y is None else y
        (along_x, bend_x), (along_y, bend_y) = (
            (axis.basis(np.asarray(at)), axis.basis(np.asarray(at), 2))
            for axis, at in zip(self.axes, places, strict=False)
        )
        z = np.asarray(self.lattice.z)
        xi, eta = (
            product(each, bend_x, along_y, z) + product(each, along_x, bend_y, z)
            for each in map(np.asarray, self.coefficients(controls))
        )
        return xi, eta


@place_by_place
def density_of(x: Array, y: Array) -> Array:
    """Length of a vector, 1/mm; with a slope where it is 0 too."""
    return jnp.sqrt(x * x + y * y + FLAT**2)


FLAT = 1e-6
"""A density, 1/mm, far below any that matters: |grad| has no slope where the gradient is 0."""


def waves_of(axis: Axis) -> tuple[Array, Array]:
    """Waves of an axis's coefficients, and their squared wave numbers times `_STEP`, squared."""
    bend = np.diff(np.eye(axis.count), axis=0)
    rates, waves = np.linalg.eigh(bend.T @ bend)
    return jax.device_put((waves, np.maximum(rates, 0) * (_STEP / axis.step) ** 2))


def _smoothed(values: Array, waves: tuple[tuple[Array, Array], ...]) -> Array:
    """Each wave of coefficients (..., K, L, M) divided by one more than its squared wave number."""
    (x, of_x), (y, of_y), (z, of_z) = waves
    parts = product(values, x.T, y.T, z.T)
    parts = parts / (1 + of_x[:, None, None] + of_y[:, None] + of_z)
    return product(parts, x, y, z)


def _differences(values: Array, order: int) -> list[Array]:
    """Differences of this order along each axis that has some."""
    # By a matrix: what differences of differences become is worked out many times over by XLA.
    return [
        jnp.tensordot(np.diff(np.eye(count), order, axis=0), values, ((1,), (axis,)))
        for axis, count in enumerate(values.shape)
        if count > order
    ]


def width_bases(
    axes: tuple[Axis, Axis, Axis], width: Any, places: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Bases of a width field at places along x and y; none where the width is no field."""
    counts = () if width is None else np.shape(width)
    return [
        Axis(axis.low, axis.high, count).basis(at)
        for axis, count, at in zip(axes, counts, places, strict=False)
    ]
