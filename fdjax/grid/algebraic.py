"""Algebraic maps: Cartesian with stretching, two-boundary and transfinite interpolation."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from fdjax.grid.base import AbstractSeparableMap, Sides
from fdjax.grid.spacing import AbstractSpacing, UniformSpacing
from fdjax.part.curve import Curve


class Cartesian(AbstractSeparableMap):
    """The paper's eq. (1): a box with the spacing along x and along y each stretched on its own.

    - `low`, `high`: lower left and upper right corner, shape (2,), mm.
    """

    low: Float[Array, " 2"]
    high: Float[Array, " 2"]
    along_x: AbstractSpacing = UniformSpacing()
    along_y: AbstractSpacing = UniformSpacing()

    def along_xi(self, xi: Float[Array, "..."]) -> Any:
        return jnp.ones_like(xi), self.along_x(xi)

    def along_eta(self, eta: Float[Array, "..."]) -> Any:
        return jnp.ones_like(eta), self.along_y(eta)

    def blend(self, of_xi: Any, of_eta: Any) -> Float[Array, "... 2"]:
        (one_xi, x), (one_eta, y) = of_xi, of_eta
        span = self.high - self.low
        shares = jnp.broadcast_arrays(one_xi * one_eta, x * one_eta, one_xi * y)
        return jnp.stack(
            [
                shares[0] * self.low[0] + shares[1] * span[0],
                shares[0] * self.low[1] + shares[2] * span[1],
            ],
            -1,
        )


class TwoBoundary(AbstractSeparableMap):
    """Straight lines between matching points of two curves (the paper's Figure 4).

    `r = (1 - g) bottom(s_b(xi)) + g top(s_t(xi))` with g = `blending`(eta).
    """

    bottom: Curve
    top: Curve
    bottom_spacing: AbstractSpacing = UniformSpacing()
    top_spacing: AbstractSpacing = UniformSpacing()
    blending: AbstractSpacing = UniformSpacing()

    def along_xi(self, xi: Float[Array, "..."]) -> Any:
        return self.bottom(self.bottom_spacing(xi)), self.top(self.top_spacing(xi))

    def along_eta(self, eta: Float[Array, "..."]) -> Any:
        return _shares(self.blending(eta))

    def blend(self, of_xi: Any, of_eta: Any) -> Float[Array, "... 2"]:
        (bottom, top), (of_bottom, of_top) = of_xi, of_eta
        return of_bottom * bottom + of_top * top


class Spacings(eqx.Module):
    """How points are spaced along each of the four sides."""

    bottom: AbstractSpacing = UniformSpacing()
    right: AbstractSpacing = UniformSpacing()
    top: AbstractSpacing = UniformSpacing()
    left: AbstractSpacing = UniformSpacing()


class Transfinite(AbstractSeparableMap):
    """Transfinite interpolation, the paper's eq. (2), of four sides with their spacings.

    f and g, the paper's blending functions, are the means of the opposite sides' spacings: with
    uniform sides they are the paper's own, with stretched sides its "non-linear stretching", and
    equal spacings on opposite sides of a rectangle give straight lines. All four sides are
    reproduced exactly.
    """

    sides: Sides
    spacings: Spacings = Spacings()

    def along_xi(self, xi: Float[Array, "..."]) -> Any:
        s_bottom, s_top = self.spacings.bottom(xi), self.spacings.top(xi)
        bottom, top = self.sides.bottom(s_bottom), self.sides.top(s_top)
        return _shares((s_bottom + s_top) / 2), (bottom, top)

    def along_eta(self, eta: Float[Array, "..."]) -> Any:
        s_left, s_right = self.spacings.left(eta), self.spacings.right(eta)
        shares = _shares((s_left + s_right) / 2)
        ends = jnp.array([0.0, 1.0])
        corners = zip(self.sides.bottom(ends), self.sides.top(ends), strict=True)
        # The sides less what the corners' own interpolation gives there.
        left, right = (
            side - (shares[0] * low + shares[1] * high)
            for side, (low, high) in zip(
                (self.sides.left(s_left), self.sides.right(s_right)), corners, strict=True
            )
        )
        return shares, (left, right)

    def blend(self, of_xi: Any, of_eta: Any) -> Float[Array, "... 2"]:
        (of_left, of_right), (bottom, top) = of_xi
        (of_bottom, of_top), (left, right) = of_eta
        return of_left * left + of_right * right + of_bottom * bottom + of_top * top


def between_walls(lattice: Float[Array, "ni nj 2"]) -> Float[Array, "ni nj 2"]:
    """The transfinite interpolation, even in steps, of a lattice's boundary nodes."""
    ni, nj = lattice.shape[:2]
    of_left, of_right = _shares(jnp.linspace(0, 1, ni)[:, None])
    of_bottom, of_top = _shares(jnp.linspace(0, 1, nj)[None])
    along_xi = of_bottom * lattice[:, :1] + of_top * lattice[:, -1:]
    left, right = (lattice[k][None] - along_xi[k] for k in (0, -1))
    return along_xi + of_left * left + of_right * right


def _shares(place: Float[Array, "..."]) -> tuple[Float[Array, "... 1"], Float[Array, "... 1"]]:
    """What the side at 0 and the side at 1 weigh at a place between, for points (..., 2)."""
    return 1 - place[..., None], place[..., None]
