"""Road width as a function of the place, kept within the machine's range."""

import math
from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fdjax.grid import bspline


class AbstractWidth(eqx.Module):
    """Road width in mm at (xi, eta), arrays that broadcast."""

    @abstractmethod
    def __call__(
        self, xi: Float[Array, "..."], eta: Float[Array, "..."]
    ) -> Float[Array, "..."]: ...


class UniformWidth(AbstractWidth):
    """One width everywhere, mm."""

    value: Float[Array, ""] | float

    def __call__(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "..."]:
        return jnp.full(jnp.broadcast_shapes(xi.shape, eta.shape), self.value)


class SplineWidth(AbstractWidth):
    """A cubic B-spline field squeezed into (low, high), mm, by the logistic function.

    `coefficients` may be any real numbers, shape (K, L), K, L >= 4.
    """

    coefficients: Float[Array, "K L"]
    low: float
    high: float

    def __call__(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "..."]:
        return within(bspline.field(self.coefficients, xi, eta), self.low, self.high)


class PlacedWidth(eqx.Module):
    """Road width, mm, as a function of the place: one number, or a spline over a box."""

    free: Float[Array, "..."]
    low: Float[Array, " 2"]
    high: Float[Array, " 2"]
    range: tuple[float, float]

    def __call__(self, xy: Float[Array, "... 2"]) -> Float[Array, "..."]:
        if self.free.ndim == 0:
            return jnp.full(xy.shape[:-1], within(self.free, *self.range))
        place = (xy - self.low) / (self.high - self.low)
        return within(bspline.field(self.free, place[..., 0], place[..., 1]), *self.range)

    @property
    def ends(self) -> tuple[Array, Array]:
        """Least and largest on a lattice, mm."""
        run = jnp.linspace(0, 1, 33)
        place = jnp.stack(jnp.meshgrid(run, run), -1)
        width = self(self.low + place * (self.high - self.low))
        return width.min(), width.max()


def within(free: Float[Array, "..."], low: float, high: float) -> Float[Array, "..."]:
    """A real number squeezed into (low, high) by the logistic function."""
    return low + (high - low) * jax.nn.sigmoid(free)


def free_of(value: float, low: float, high: float) -> float:
    """The real number that `within` maps to `value`, kept a thousandth of the range inside."""
    share = min(max((value - low) / (high - low), 1e-3), 1 - 1e-3)
    return math.log(share / (1 - share))
