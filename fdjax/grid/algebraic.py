"""Algebraic maps: Cartesian with stretching, two-boundary and transfinite interpolation."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from fdjax.domain.curve import Curve
from fdjax.grid.base import AbstractGridMap, Sides
from fdjax.grid.spacing import AbstractSpacing, UniformSpacing


class Cartesian(AbstractGridMap):
    """The paper's eq. (1): a box with the spacing along x and along y each stretched on its own.

    - `low`, `high`: lower left and upper right corner, shape (2,), mm.
    """

    low: Float[Array, " 2"]
    high: Float[Array, " 2"]
    along_x: AbstractSpacing = UniformSpacing()
    along_y: AbstractSpacing = UniformSpacing()

    def __call__(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "... 2"]:
        share = jnp.stack(jnp.broadcast_arrays(self.along_x(xi), self.along_y(eta)), -1)
        return self.low + (self.high - self.low) * share


class TwoBoundary(AbstractGridMap):
    """Straight lines between matching points of two curves (the paper's Figure 4).

    `r = (1 - g) bottom(s_b(xi)) + g top(s_t(xi))` with g = `blend`(eta).
    """

    bottom: Curve
    top: Curve
    bottom_spacing: AbstractSpacing = UniformSpacing()
    top_spacing: AbstractSpacing = UniformSpacing()
    blend: AbstractSpacing = UniformSpacing()

    def __call__(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "... 2"]:
        g = self.blend(eta)[..., None]
        return (1 - g) * self.bottom(self.bottom_spacing(xi)) + g * self.top(self.top_spacing(xi))


class Spacings(eqx.Module):
    """How points are spaced along each of the four sides."""

    bottom: AbstractSpacing = UniformSpacing()
    right: AbstractSpacing = UniformSpacing()
    top: AbstractSpacing = UniformSpacing()
    left: AbstractSpacing = UniformSpacing()


class Transfinite(AbstractGridMap):
    """Transfinite interpolation, the paper's eq. (2), of four sides with their spacings.

    f and g, the paper's blending functions, are the means of the opposite sides' spacings: with
    uniform sides they are the paper's own, with stretched sides its "non-linear stretching", and
    equal spacings on opposite sides of a rectangle give straight lines. All four sides are
    reproduced exactly.
    """

    sides: Sides
    spacings: Spacings = Spacings()

    def __call__(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "... 2"]:
        s_bottom, s_top = self.spacings.bottom(xi), self.spacings.top(xi)
        s_left, s_right = self.spacings.left(eta), self.spacings.right(eta)
        f = (s_bottom + s_top)[..., None] / 2
        g = (s_left + s_right)[..., None] / 2
        bottom, top = self.sides.bottom(s_bottom), self.sides.top(s_top)
        left, right = self.sides.left(s_left), self.sides.right(s_right)
        ends = jnp.array([0.0, 1.0])
        low_left, low_right = self.sides.bottom(ends)
        top_left, top_right = self.sides.top(ends)
        along_xi = f * right + (1 - f) * left
        along_eta = g * top + (1 - g) * bottom
        corners = (
            f * g * top_right
            + f * (1 - g) * low_right
            + (1 - f) * g * top_left
            + (1 - f) * (1 - g) * low_left
        )
        return along_xi + along_eta - corners
