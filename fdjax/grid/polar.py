"""Polar coordinates: rings and discs."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fdjax.grid.base import AbstractSeparableMap


class Polar(AbstractSeparableMap):
    """`r = centre + (inner + xi (outer - inner)) (cos 2 pi eta, sin 2 pi eta)`.

    The paper's "uniform Cartesian grids within circular geometries". xi runs outwards, eta once
    around, counter-clockwise; any eta is allowed.

    - `centre`: shape (2,), mm; `inner`, `outer`: radii, mm, 0 < inner < outer.
    """

    centre: Float[Array, " 2"]
    inner: Float[Array, ""] | float
    outer: Float[Array, ""] | float

    def along_xi(self, xi: Float[Array, "..."]) -> Any:
        return jnp.ones_like(xi), self.inner + xi * (self.outer - self.inner)

    def along_eta(self, eta: Float[Array, "..."]) -> Any:
        angle = 2 * np.pi * eta
        return jnp.ones_like(eta), jnp.cos(angle), jnp.sin(angle)

    def blend(self, of_xi: Any, of_eta: Any) -> Float[Array, "... 2"]:
        (one_xi, radius), (one_eta, cosine, sine) = of_xi, of_eta
        shares = jnp.broadcast_arrays(one_xi * one_eta, radius * cosine, radius * sine)
        middle = shares[0][..., None] * jnp.asarray(self.centre)
        return middle + jnp.stack(shares[1:], -1)
