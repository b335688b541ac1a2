"""Uniform cubic B-splines over [0, 1] and over the unit square, as curves and as fields.

`K` coefficients span `K - 3` equal intervals. Everything is linear in the coefficients and twice
continuously differentiable in the place.
"""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float


def _weights(
    t: Float[Array, "..."], count: int, order: int = 0
) -> tuple[Array, Float[Array, "... 4"]]:
    """First coefficient that acts at `t` in [0, 1], and the four weights from there on.

    `order`: those of a derivative.
    """
    scaled = t * (count - 3)
    first = jnp.clip(jnp.floor(scaled).astype(int), 0, count - 4)
    f = scaled - first
    g = 1 - f
    if order == 0:
        weights = [g**3, 4 - 6 * f**2 + 3 * f**3, 4 - 6 * g**2 + 3 * g**3, f**3]
    elif order == 1:
        weights = [-3 * g**2, 9 * f**2 - 12 * f, 12 * g - 9 * g**2, 3 * f**2]
    elif order == 2:
        weights = [6 * g, 18 * f - 12, 18 * g - 12, 6 * f]
    else:
        sixes = [jnp.full_like(f, size) for size in (-6.0, 18.0, -18.0, 6.0)]
        weights = sixes if order == 3 else [jnp.zeros_like(f)] * 4
    return first, jnp.stack(weights, -1) * ((count - 3) ** order / 6)


def field(
    coefficients: Float[Array, "K L ..."], xi: Float[Array, "..."], eta: Float[Array, "..."]
) -> Float[Array, "..."]:
    """The tensor-product spline at (xi, eta) in the unit square, K, L >= 4.

    xi and eta broadcast; a lattice, xi (n, 1) and eta (1, m), takes two matrix products. Axes of
    the coefficients beyond the second are components, and come last in the result.
    """
    if xi.ndim == eta.ndim == 2 and xi.shape[1] == eta.shape[0] == 1:
        along_xi = dense(xi[:, 0], coefficients.shape[0])
        along_eta = dense(eta[0], coefficients.shape[1])
        return jnp.einsum("ik,kl...,jl->ij...", along_xi, coefficients, along_eta)
    return _scattered((0, 0), coefficients, *jnp.broadcast_arrays(xi, eta))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _scattered(
    orders: tuple[int, int], coefficients: Array, xi: Float[Array, "..."], eta: Float[Array, "..."]
) -> Float[Array, "..."]:
    """A derivative of the spline at places one by one, by how often along xi and along eta."""
    i, wi = _weights(xi, coefficients.shape[0], orders[0])
    j, wj = _weights(eta, coefficients.shape[1], orders[1])
    rows, columns = i[..., None, None] + np.arange(4)[:, None], j[..., None, None] + np.arange(4)
    weights = wi[..., :, None] * wj[..., None, :]
    weights = weights.reshape(weights.shape + (1,) * (coefficients.ndim - 2))
    return (coefficients[rows, columns] * weights).sum((xi.ndim, xi.ndim + 1))


@partial(_scattered.defjvp, symbolic_zeros=True)
def _scattered_jvp(orders: tuple[int, int], primals: tuple, tangents: tuple) -> tuple:
    # The slopes are worked out once, however many tangents there are.
    _, xi, eta = primals
    change, *moves = tangents
    value = _scattered(orders, *primals)
    result = jnp.zeros_like(value)
    if not isinstance(change, SymbolicZero):
        result = result + _scattered(orders, change, xi, eta)
    for axis, move in enumerate(moves):
        if not isinstance(move, SymbolicZero):
            steeper = orders[0] + (axis == 0), orders[1] + (axis == 1)
            slope = _scattered(steeper, *primals)
            result = result + slope * move.reshape(move.shape + (1,) * (slope.ndim - move.ndim))
    return value, result


def curve(coefficients: Float[Array, "K ..."], t: Float[Array, "..."]) -> Float[Array, "..."]:
    """The spline at the places `t` in [0, 1]; axes of the coefficients beyond the first last."""
    return _along(0, coefficients, t)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _along(
    order: int, coefficients: Float[Array, "K ..."], t: Float[Array, "..."]
) -> Float[Array, "..."]:
    """A derivative of the spline: the value where `order` is 0."""
    first, weights = _weights(t, coefficients.shape[0], order)
    weights = weights.reshape(weights.shape + (1,) * (coefficients.ndim - 1))
    return (coefficients[first[..., None] + np.arange(4)] * weights).sum(t.ndim)


@partial(_along.defjvp, symbolic_zeros=True)
def _along_jvp(order: int, primals: tuple, tangents: tuple) -> tuple:
    _, t = primals
    change, move = tangents
    value = _along(order, *primals)
    result = jnp.zeros_like(value)
    if not isinstance(change, SymbolicZero):
        result = result + _along(order, change, t)
    if not isinstance(move, SymbolicZero):
        slope = _along(order + 1, *primals)
        result = result + slope * move.reshape(move.shape + (1,) * (slope.ndim - move.ndim))
    return value, result


def dense(t: Float[Array, " n"], count: int) -> Float[Array, "n K"]:
    """Values of the `count` basis splines at the places `t` in [0, 1]; differentiable in t."""
    first, weights = _weights(t, count)
    rows = np.arange(t.size)[:, None]
    return jnp.zeros((t.size, count)).at[rows, first[:, None] + np.arange(4)].set(weights)


def basis(t: np.ndarray, count: int) -> np.ndarray:
    """Values (len(t), count) of the `count` basis splines at the places `t`, as NumPy."""
    distance = np.abs(t[:, None] * (count - 3) + 1 - np.arange(count))
    near, far = 4 - 6 * distance**2 + 3 * distance**3, np.maximum(2 - distance, 0) ** 3
    return np.where(distance < 1, near, far) / 6


def closed(coefficients: Array, axis: int) -> Array:
    """The coefficients of a periodic spline, those of one period given along an axis.

    M of them, at least 1, span M equal intervals of the period; the first lies at its beginning.
    """
    count = coefficients.shape[axis]
    return jnp.take(coefficients, (np.arange(count + 3) - 1) % count, axis)


def folded(coefficients: Array, sign: float = 1.0) -> Array:
    """The coefficients of a field that goes on beyond its first side as itself, turned by a half.

    `f(-s, t) = sign f(s, 1 - t)`, s along the first axis, t along the second: smooth across s = 0
    wherever places t and 1 - t of it are one. Of those given the first along s are not used; where
    there is but one it is made symmetrical.
    """
    turned = sign * coefficients[:, ::-1]
    if len(coefficients) == 1:
        return (coefficients + turned) / 2
    middle = (coefficients[1:2] + turned[1:2]) / 2
    return jnp.concatenate([turned[2:3], middle, coefficients[2:]])


@cache
def closed_interpolation(nodes: int) -> np.ndarray:
    """Matrix (nodes + 3, nodes) from values at places k / nodes of a period to coefficients.

    The coefficients are those of the whole period, as `closed` gives them. Needs 3 nodes.
    """
    turn = np.roll(np.eye(nodes), 1, axis=0)
    around = np.linalg.inv((4 * np.eye(nodes) + turn + turn.T) / 6)
    return around[(np.arange(nodes + 3) - 1) % nodes]


def pieces(nodes: Float[Array, "n 2"], step: float) -> Float[Array, "n-1 4 2"]:
    """The spline through nodes, `step` of a parameter apart, as pieces of a `Curve`; n >= 4."""
    a, b, c, d = (interpolation(len(nodes))[k : k + len(nodes) - 1] @ nodes for k in range(4))
    powers = [(a + 4 * b + c) / 6, (c - a) / 2, (a - 2 * b + c) / 2, (d - 3 * c + 3 * b - a) / 6]
    return jnp.stack([power / step**k for k, power in enumerate(powers)], 1)


@cache
def interpolation(nodes: int) -> np.ndarray:
    """Matrix (nodes + 2, nodes) from values at equally spaced nodes to spline coefficients.

    End conditions are "not a knot", so cubics are reproduced. Needs at least 4 nodes.
    """
    count = nodes + 2
    system = np.zeros((count, count))
    for k in range(nodes):
        system[k, k : k + 3] = 1 / 6, 4 / 6, 1 / 6
    # The third derivative does not jump at the second and the last but one node.
    system[nodes, :5] = system[nodes + 1, -5:] = -1, 4, -6, 4, -1
    return np.linalg.inv(system)[:, :nodes]
