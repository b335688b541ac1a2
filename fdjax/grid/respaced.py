"""A map whose lines are spaced anew: along each axis, and otherwise from line to line."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.grid import bspline
from fdjax.grid.base import AbstractGridMap, Tangents
from fdjax.grid.spacing import AbstractSpacing, UniformSpacing

_MEAN = 64

ROUNDS = 6
"""Of u by v and v by u, where each is to suit the other."""


class SpacingField(eqx.Module):
    """A spacing along one axis of the unit square that changes along the other one.

    `s(t, a) = sum_k N_k(a) s_k(t)`: monotone spacings s_k, weighed by cubic B-splines, which are
    positive and add up to 1, so that s rises with t from 0 to 1 wherever along the other axis.

    - `rows`: one spacing whose arrays have a leading axis of their own, the rows.
    - `closed_along`: t runs around a ring, and so may s: of each s_k the mean of `s_k(t) - t` is
      taken off, so that no place of the ring is held, and s goes on beyond [0, 1].
    - `closed_across`: the other axis does.
    - `turned`, `begin`, `end`: the field as one block of several has it: t runs backwards, and the
      other axis from `begin` to `end` of the field's own.

    Differentiable in the spacings and in both places.
    """

    rows: AbstractSpacing
    closed_along: bool = eqx.field(static=True, default=False)
    closed_across: bool = eqx.field(static=True, default=False)
    turned: Bool[Array, ""] | bool = False
    begin: Float[Array, ""] | float = 0.0
    end: Float[Array, ""] | float = 1.0

    def __call__(self, t: Float[Array, "..."], across: Float[Array, "..."]) -> Float[Array, "..."]:
        """s at t and at places `across`, which broadcast against each other."""
        across = self.begin + (self.end - self.begin) * across
        found = self._field(jnp.where(self.turned, 1 - t, t), across)
        return jnp.where(self.turned, 1 - found, found)

    def partials(self, t: Float[Array, "..."], across: Float[Array, "..."]) -> "_Partials":
        """s there, and how it changes along and across."""

        def by_across(t: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
            ones = jnp.ones_like(across)

            def first(a: Array) -> tuple[Array, Array]:
                return jax.jvp(lambda a: self(t, a), (a,), (ones,))

            return jax.jvp(first, (across,), (ones,))

        ((s, a), (_, aa)), ((by_t, ta), _) = jax.jvp(by_across, (t,), (jnp.ones_like(t),))
        return _Partials(s, by_t, a, ta, aa)

    def _field(self, t: Float[Array, "..."], across: Float[Array, "..."]) -> Float[Array, "..."]:
        count = len(jax.tree.leaves(self.rows)[0])
        values = self._values(t)
        if count == 1:
            return jnp.broadcast_to(values[0], jnp.broadcast_shapes(t.shape, across.shape))
        weights = self._weights(across.ravel(), count)
        if t.ndim == across.ndim == 2 and sorted(t.shape + across.shape)[:2] == [1, 1]:
            # A lattice: one product of matrices.
            found = values.reshape(count, -1).T @ weights.T
            return found if t.shape[1] == 1 else found.T
        weights = weights.T.reshape(count, *across.shape)
        return (values * weights).sum(0)

    def _values(self, t: Float[Array, "..."]) -> Float[Array, "rows ..."]:
        values = jax.vmap(lambda row: row(t))(self.rows)
        if not self.closed_along:
            return values
        places = jnp.asarray(np.arange(_MEAN) / _MEAN)
        mean = jax.vmap(lambda row: (row(places) - places).mean())(self.rows)
        return values - mean.reshape(-1, *[1] * t.ndim)

    def _weights(self, across: Float[Array, " n"], count: int) -> Float[Array, "n rows"]:
        if not self.closed_across:
            return bspline.dense(across, count)
        return bspline.dense(across, count + 3) @ bspline.closed(jnp.eye(count), 0)


class Respaced(AbstractGridMap):
    """A map over another one: `r(xi, eta) = base(u(xi, eta), v(eta, xi))`.

    Where lines of the base map lie, and how they cross, does not change along its walls; where
    between them they are drawn does. Bends neither wall, and folds only where u and v together do.

    - `base`: a map; `u`, `v`: spacing fields along xi and along eta, or a spacing.
    - `closed`: whether the base map is a ring along eta.
    - `joint`: whether u changes along the base's own eta and v along its xi instead,
      `u(xi, v), v(eta, u)`: where bases join without a kink, so do lines then.
    """

    base: AbstractGridMap
    u: SpacingField | AbstractSpacing = UniformSpacing()
    v: SpacingField | AbstractSpacing = UniformSpacing()
    closed: bool = eqx.field(static=True, default=False)
    joint: bool = eqx.field(static=True, default=False)

    def __call__(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "... 2"]:
        return self.base(*self.places(xi, eta))

    def with_tangents(
        self, xi: Float[Array, "..."], eta: Float[Array, "..."]
    ) -> tuple[Float[Array, "... 2"], Tangents]:
        if self.joint:
            places, by_xi, by_eta = self._joint(xi, eta)
        else:
            places = self.places(xi, eta)
            _, by_xi = jax.jvp(lambda t: self.places(t, eta), (xi,), (jnp.ones_like(xi),))
            _, by_eta = jax.jvp(lambda t: self.places(xi, t), (eta,), (jnp.ones_like(eta),))
        xy, along = _with_tangents(self.base, *places)

        def chained(by: tuple[Array, Array]) -> Float[Array, "... 2"]:
            return along.xi * by[0][..., None] + along.eta * by[1][..., None]

        return xy, Tangents(chained(by_xi), chained(by_eta))

    def places(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> tuple[Array, Array]:
        """Where (xi, eta) lies on the base map."""
        if self.joint:
            return self._joint(xi, eta)[0]
        u = self.u(xi, eta) if isinstance(self.u, SpacingField) else self.u(xi)
        v = self.v(eta, xi) if isinstance(self.v, SpacingField) else self.v(eta)
        return u, v - jnp.floor(v) if self.closed else v

    def _joint(self, xi: Array, eta: Array) -> tuple[tuple[Array, Array], ...]:
        """u and v that suit each other, and how they change along xi and along eta.

        Found without derivatives; one step of Newton's method, which moves nothing any more, then
        has them, and the slopes change with it to first order.
        """
        assert isinstance(self.u, SpacingField)
        assert isinstance(self.v, SpacingField)
        constant = jax.lax.stop_gradient
        of_u, of_v, at_xi, at_eta = jax.tree.map(
            lambda leaf: constant(leaf) if eqx.is_array(leaf) else leaf, (self.u, self.v, xi, eta)
        )
        u, v = at_xi, at_eta
        # What is left is a power of how u changes along v and v along u, together.
        for _ in range(ROUNDS):
            u, v = of_u(at_xi, v), of_v(at_eta, u)
        first, second = self.u.partials(xi, v), self.v.partials(eta, u)
        off_u, off_v = first.s - u, second.s - v
        by_v, by_u = constant(first.a), constant(second.a)
        share = 1 - by_v * by_u
        move_u, move_v = (off_u + by_v * off_v) / share, (off_v + by_u * off_u) / share
        u_t, u_a = first.moved(move_v)
        v_t, v_a = second.moved(move_u)
        share = 1 - u_a * v_a
        by_xi = u_t / share, v_a * u_t / share
        by_eta = u_a * v_t / share, v_t / share
        return (u + move_u, v + move_v), by_xi, by_eta


class _Partials(NamedTuple):
    """s of a spacing field, s_t, s_a, s_ta and s_aa."""

    s: Array
    t: Array
    a: Array
    ta: Array
    aa: Array

    def moved(self, across: Array) -> tuple[Array, Array]:
        """s_t and s_a a step further across, to first order."""
        ta, aa = map(jax.lax.stop_gradient, (self.ta, self.aa))
        return self.t + ta * across, self.a + aa * across


@eqx.filter_custom_jvp
def _with_tangents(base: AbstractGridMap, u: Array, v: Array) -> tuple[Array, Tangents]:
    """What the map gives at places of its own, which may move.

    Its slopes there are worked out once, however many controls move the places.
    """
    return base.with_tangents(u, v)


@_with_tangents.def_jvp
def _(primals: tuple, tangents: tuple) -> tuple:
    base, u, v = primals
    change, *moves = tangents
    result = _with_tangents(base, u, v)
    total = jax.tree.map(jnp.zeros_like, result)
    if jax.tree.leaves(change):
        _, total = eqx.filter_jvp(lambda base: base.with_tangents(u, v), (base,), (change,))
    ways = (lambda t: base.with_tangents(t, v)), (lambda t: base.with_tangents(u, t))
    for way, place, move in zip(ways, (u, v), moves, strict=True):
        if move is not None:
            _, slope = jax.jvp(way, (place,), (jnp.ones_like(place),))
            total = jax.tree.map(lambda sum, by: sum + by * move[..., None], total, slope)  # noqa: B023
    return result, total
