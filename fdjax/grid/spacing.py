"""Monotone maps of [0, 1] onto itself: how nodes and roads are spaced along a side."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fdjax.grid import bspline

_PIECES = 64


class AbstractSpacing(eqx.Module):
    """A rising map of [0, 1] onto itself, called on any array."""

    @abstractmethod
    def __call__(self, t: Float[Array, "..."]) -> Float[Array, "..."]: ...


class UniformSpacing(AbstractSpacing):
    """The identity."""

    def __call__(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        return t


class SlopedSpacing(AbstractSpacing):
    """The cubic with these slopes at its ends: even where both are 1; rises for slopes to 3."""

    first: Float[Array, ""] | float
    last: Float[Array, ""] | float

    def __call__(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        before, after = self.first - 1, self.last - 1
        return t + t * (1 - t) * (before * (1 - t) - after * t)


class DensitySpacing(AbstractSpacing):
    """Spacing by a density of lines rho along the side: `t = int_0^s rho / int_0^1 rho`.

    Kept piece by piece as cubics in t.

    - `t`: where the pieces begin, shape (n,).
    - `pieces`: of each, shape (n, 4), where it begins, one over its length and how far it bends at
      its two ends, in pieces.
    """

    t: Float[Array, " n"]
    pieces: Float[Array, "n 4"]

    @classmethod
    def of(cls, log_density: Float[Array, " K"]) -> "DensitySpacing":
        """From the coefficients of log rho, a cubic B-spline over s, shape (K,), K >= 4.

        All equal means uniform; any real values are allowed, so an optimiser needs no bounds.
        Differentiable. Raises `ValueError` for fewer than 4 coefficients.
        """
        if len(log_density) < 4:
            raise ValueError(f"DensitySpacing: {len(log_density)} coefficients; at least 4")
        # A common level changes nothing; without it the exponential is of order one.
        level = log_density - log_density.mean()
        basis = bspline.basis(np.linspace(0, 1, 2 * _PIECES + 1), len(log_density))
        density = jnp.exp(basis @ level)
        # Simpson's rule on each piece.
        pieces = (density[:-2:2] + 4 * density[1::2] + density[2::2]) / 6
        t = jnp.concatenate([jnp.zeros(1), jnp.cumsum(pieces)]) / pieces.sum()
        length = pieces / pieces.sum()
        # ds/dt at the ends, in pieces along s for one along t, less the mean of 1.
        start, end = pieces / density[:-1:2] - 1, 1 - pieces / density[2::2]
        return cls(t[:-1], jnp.stack([t[:-1], 1 / length, start, end], 1))

    def __call__(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        k = (t[..., None] >= self.t[1:]).sum(-1)
        piece = self.pieces.at[k].get(mode="promise_in_bounds", wrap_negative_indices=False)
        begin, scale, start, end = (piece[..., part] for part in range(4))
        f = (t - begin) * scale
        return (k + f + f * (1 - f) * (start * (1 - f) + end * f)) / len(self.t)


class RobertsSpacing(AbstractSpacing):
    """The paper's eq. (1): `s(t) = ((2a+b) R^q + 2a - b) / ((2a+1)(1 + R^q))`.

    With `R = (b+1)/(b-1)`, `q = (t-a)/(1-a)`; computed as the same
    `(2a + b tanh(q atanh(1/b))) / (2a+1)`, which is accurate for large b too. `alpha` a is 0
    (clusters at t = 1) or 1/2 (at both ends): only for these does s(0) = 0 hold. `beta` b > 1: the
    nearer to 1, the stronger. Differentiable in beta. Raises `ValueError` for another alpha.
    """

    beta: Float[Array, ""]
    alpha: float = eqx.field(static=True, default=0.5)

    def __check_init__(self) -> None:
        if self.alpha not in (0.0, 0.5):
            raise ValueError(f"RobertsSpacing: alpha is {self.alpha}; 0 or 0.5 map 0 to 0")

    def __call__(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        a, b = self.alpha, self.beta
        return (2 * a + b * jnp.tanh((t - a) / (1 - a) * jnp.arctanh(1 / b))) / (2 * a + 1)


def tanh_spacing(delta: Float[Array, ""], alpha: float = 0.5) -> RobertsSpacing:
    """`s(t) = (2a + tanh(d q) / tanh(d)) / (2a + 1)`, with `q = (t-a)/(1-a)`.

    The hyperbolic tangent of Vinokur (J. Comput. Phys. 50, 1983), which is eq. (1) at
    `beta = coth(d)`; `alpha` a as there. `delta` d > 0: the larger, the stronger; even steps as it
    goes to 0. Differentiable in delta. Raises `ValueError` for another alpha.
    """
    return RobertsSpacing(1 / jnp.tanh(delta), alpha)


class GeometricSpacing(AbstractSpacing):
    """`s(t) = (e^(g t) - 1) / (e^g - 1)`: steps that grow by one ratio, e^g from first to last.

    `growth` g of either sign; 0 is even. Differentiable in it.
    """

    growth: Float[Array, ""]

    def __call__(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        g = jnp.asarray(self.growth)
        small = jnp.abs(g) < 1e-6
        safe = jnp.where(small, 1.0, g)
        even = t + g * t * (t - 1) / 2
        return jnp.where(small, even, jnp.expm1(safe * t) / jnp.expm1(safe))


def fit_log_density(density: np.ndarray, knots: int, *, closed: bool = False) -> np.ndarray:
    """Coefficients (knots,) of the `DensitySpacing` nearest to a density of lines along a side.

    `density` holds positive values at equally spaced places of the side, ends included; least
    squares of the logarithm. `closed`: of a ring, the coefficients of one period.
    """
    places = np.linspace(0, 1, len(density))
    if closed:
        basis = bspline.basis(places, knots + 3) @ np.asarray(bspline.closed(jnp.eye(knots), 0))
    else:
        basis = bspline.basis(places, knots)
    return np.linalg.lstsq(basis, np.log(density), rcond=None)[0]
