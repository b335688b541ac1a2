"""What every grid is: a differentiable map of the unit square into the plane, and its metrics."""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fdjax.arrays import namespace
from fdjax.part.curve import Curve
from fdjax.part.patch import Patch

jax.tree_util.register_dataclass(Curve, ["breaks", "coefficients"], ["corners"])


class AbstractGridMap(eqx.Module):
    """A map (xi, eta) -> (x, y) in mm, defined everywhere on the unit square.

    Called on arrays that broadcast it gives xy of shape (..., 2); on a lattice, xi of shape (n, 1)
    and eta of shape (1, m), it does far less work than point by point. Every field is a pytree, so
    a map is a valid argument and result of `jax.jit`, `jax.grad` and `jax.vmap`.
    """

    @abstractmethod
    def __call__(
        self, xi: Float[Array, "..."], eta: Float[Array, "..."]
    ) -> Float[Array, "... 2"]: ...

    def with_tangents(
        self, xi: Float[Array, "..."], eta: Float[Array, "..."]
    ) -> tuple[Float[Array, "... 2"], "Tangents"]:
        """What `tangents` gives."""
        xy, along_xi = jax.jvp(lambda t: self(t, eta), (xi,), (jnp.ones_like(xi),))
        _, along_eta = jax.jvp(lambda t: self(xi, t), (eta,), (jnp.ones_like(eta),))
        return xy, Tangents(along_xi, along_eta)


class AbstractSeparableMap(AbstractGridMap):
    """A map that is a sum of products of functions of xi and functions of eta.

    All derivation is then in one variable, and a lattice costs little more than its two axes.
    """

    @abstractmethod
    def along_xi(self, xi: Float[Array, "..."]) -> Any:
        """The functions of xi, a pytree of arrays."""

    @abstractmethod
    def along_eta(self, eta: Float[Array, "..."]) -> Any:
        """The functions of eta, a pytree of arrays."""

    @abstractmethod
    def blend(self, of_xi: Any, of_eta: Any) -> Float[Array, "... 2"]:
        """The points: linear in what `along_xi` gives and linear in what `along_eta` gives."""

    def __call__(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "... 2"]:
        return self.blend(self.along_xi(xi), self.along_eta(eta))

    def with_tangents(
        self, xi: Float[Array, "..."], eta: Float[Array, "..."]
    ) -> tuple[Float[Array, "... 2"], "Tangents"]:
        of_xi, by_xi = jax.jvp(self.along_xi, (xi,), (jnp.ones_like(xi),))
        of_eta, by_eta = jax.jvp(self.along_eta, (eta,), (jnp.ones_like(eta),))
        along = Tangents(self.blend(by_xi, of_eta), self.blend(of_xi, by_eta))
        return self.blend(of_xi, of_eta), along


class Sides(NamedTuple):
    """The four sides of a `Patch` as JAX sees them."""

    bottom: Curve
    right: Curve
    top: Curve
    left: Curve

    @classmethod
    def of(cls, patch: Patch) -> "Sides":
        return cls(patch.bottom, patch.right, patch.top, patch.left)


class Tangents(NamedTuple):
    """Derivatives of a map, shape (..., 2), mm per unit of xi and eta."""

    xi: Float[Array, "... 2"]
    eta: Float[Array, "... 2"]

    @property
    def jacobian(self) -> Float[Array, "..."]:
        """`J = x_xi y_eta - x_eta y_xi`, mm^2; zero or less where the map folds."""
        return self.xi[..., 0] * self.eta[..., 1] - self.eta[..., 0] * self.xi[..., 1]

    @property
    def skew(self) -> Float[Array, "..."]:
        """|cos| of the angle between the lines of constant xi and of constant eta."""
        return jnp.abs((self.xi * self.eta).sum(-1)) / (norm(self.xi) * norm(self.eta))


@jax.jit
def tangents(
    grid: AbstractGridMap, xi: Float[Array, "..."], eta: Float[Array, "..."]
) -> tuple[Float[Array, "... 2"], Tangents]:
    """Points xy and the map's derivatives there, in one pass."""
    return grid.with_tangents(xi, eta)


def norm(vector: Float[Array, "... 2"]) -> Float[Array, "..."]:
    """Euclidean length over the last axis."""
    return namespace(vector).sqrt((vector**2).sum(-1))
