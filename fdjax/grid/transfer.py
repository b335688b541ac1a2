"""Lattices as two planes, x and y apart, and their transfer between lattices of any size.

The compiler is far faster with two planes than with one array of points. Transfers go one axis at a
time. The coarser lattice of an odd number of nodes takes every second one, and is refined by cubic
interpolation; all others are linear. Planes may have a third axis, lanes: as many lattices, side by
side.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Plane = Float[Array, "ni nj *lanes"]
Pair = tuple[Plane, Plane]
"""A field of vectors: its x and its y."""

COARSEST = 7
"""A side of at most so many steps is not coarsened any more."""


def planes(r: Float[Array, "ni nj 2"]) -> Pair:
    """The coordinates apart."""
    return r[..., 0], r[..., 1]


def points(pair: Pair) -> Float[Array, "ni nj 2"]:
    """The coordinates together again."""
    return jnp.stack(pair, -1)


def each(function: Any, *pairs: Pair) -> Pair:
    return function(*(pair[0] for pair in pairs)), function(*(pair[1] for pair in pairs))


def coarser(count: int) -> int:
    """Nodes of the next coarser lattice along a side of `count` nodes."""
    return count if count - 1 <= COARSEST else count // 2 + 1


def halved(shape: tuple[int, int]) -> tuple[int, int]:
    """Nodes of the next coarser lattice."""
    return coarser(shape[0]), coarser(shape[1])


def _along(axis: int, this: Any, others: Any, u: Array) -> list:
    """Something for an axis, and something else for all other axes of an array."""
    return [this if k == axis else others for k in range(u.ndim)]


def _taken(u: Array, index: np.ndarray, weight: np.ndarray, axis: int) -> Array:
    """sum_t weight[t, k] u[index[t, k]] along an axis."""
    return sum(
        (
            jnp.take(u, i, axis, mode="clip") * w.reshape(_along(axis, -1, 1, u)).astype(u.dtype)
            for i, w in zip(index, weight, strict=True)
        ),
        jnp.zeros((), u.dtype),
    )


def _between(places: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The two nodes of `count` around each place, in steps, and their linear weights."""
    low = np.clip(np.floor(places + 1e-9).astype(int), 0, count - 2)
    share = places - low
    return np.stack([low, low + 1]), np.stack([1 - share, share])


def _places(count: int, others: int) -> np.ndarray:
    """Where `count` equally spaced nodes lie among `others`, in steps of those."""
    return np.arange(count) * ((others - 1) / (count - 1))


def _refined(u: Array, count: int, axis: int) -> Array:
    coarse = u.shape[axis]
    if count == coarse:
        return u
    if count == 2 * coarse - 1:

        def part(first: int, end: int) -> Array:
            return jax.lax.slice_in_dim(u, first, coarse + end, axis=axis)

        # Midway between four nodes; midway between the first two of three at the ends.
        between = (9 * (part(1, -2) + part(2, -1)) - part(0, -3) - part(3, 0)) / 16
        first = (3 * part(0, 1 - coarse) + 6 * part(1, 2 - coarse) - part(2, 3 - coarse)) / 8
        last = (3 * part(-1 + coarse, 0) + 6 * part(-2 + coarse, -1) - part(-3 + coarse, -2)) / 8
        middle = jax.lax.concatenate([first, between, last], axis)
        return _spread(u, 0, 0, axis) + _spread(middle, 1, 1, axis)
    return _taken(u, *_between(_places(count, coarse), coarse), axis)


def _spread(u: Array, before: int, after: int, axis: int) -> Array:
    """Zeros between the values along an axis, and so many before and after them."""
    padding = _along(axis, (before, after, 1), (0, 0, 0), u)
    return jax.lax.pad(u, jnp.zeros((), u.dtype), padding)


def _sampled(u: Array, axis: int) -> Array:
    count = u.shape[axis]
    coarse = coarser(count)
    if count == coarse:
        return u
    if count == 2 * coarse - 1:
        return jax.lax.slice_in_dim(u, 0, None, 2, axis)
    return _taken(u, *_between(_places(coarse, count), count), axis)


def _averaged(u: Array, axis: int) -> Array:
    """The transpose of refining, made a mean."""
    count = u.shape[axis]
    coarse = coarser(count)
    if count == coarse:
        return u
    if count == 2 * coarse - 1:
        # The same three weights everywhere but on the walls, which no residual has. What a window
        # takes the sum of is worked out once; taken apart it would be for each of the parts.
        around = jax.lax.reduce_window(
            u,
            jnp.zeros((), u.dtype),
            jax.lax.add,
            _along(axis, 3, 1, u),
            _along(axis, 2, 1, u),
            _along(axis, (1, 1), (0, 0), u),
        )
        return (around + jax.lax.slice_in_dim(u, 0, None, 2, axis)) / 4
    index, weight = _between(_places(count, coarse), coarse)
    matrix = np.zeros((count, coarse))
    for i, w in zip(index, weight, strict=True):
        np.add.at(matrix, (np.arange(count), i), w)
    matrix /= matrix.sum(0)
    taps = int((matrix > 0).sum(0).max())
    first = np.minimum((matrix > 0).argmax(0), count - taps)
    index = first + np.arange(taps)[:, None]
    return _taken(u, index, np.take_along_axis(matrix, index, 0), axis)


def _both(step: Any, u: Array) -> Array:
    return step(step(u, 0), 1)


def restricted(u: Plane, shape: tuple[int, int]) -> Plane:
    """Values of a coarser lattice, one or more halvings away, by bilinear interpolation."""
    while u.shape[:2] != shape:
        u = _both(_sampled, u)
    return u


def restricted_residual(u: Plane, shape: tuple[int, int]) -> Plane:
    """The mean residual around each node of a coarser lattice, per its own steps."""
    while u.shape[:2] != shape:
        coarse = _both(_averaged, u)
        steps = zip(u.shape[:2], coarse.shape[:2], strict=True)
        u = interior(coarse * math.prod((n - 1) / (m - 1) for n, m in steps) ** 2)
    return u


def prolonged(u: Plane, shape: tuple[int, int]) -> Plane:
    """Values of a finer lattice, one or more halvings away."""
    between = halved(shape)
    if u.shape[:2] != between:
        u = prolonged(u, between)
    return _refined(_refined(u, shape[0], 0), shape[1], 1)


def walled(u: Array) -> Plane:
    """Values at the interior nodes with zeros on the walls around them."""
    padding = [(1, 1, 0), (1, 1, 0), *[(0, 0, 0)] * (u.ndim - 2)]
    return jax.lax.pad(u, jnp.zeros((), u.dtype), padding)


def rejoined(r: Float[Array, "ni nj 2"]) -> Float[Array, "ni nj 2"]:
    """A closed lattice with its first and last columns made copies of those across the cut.

    A closed lattice holds each node of its rings once in the columns between.
    """
    return r.at[:, 0].set(r[:, -2]).at[:, -1].set(r[:, 1])


def interior(u: Plane) -> Plane:
    """The plane with zeros on the walls."""
    return walled(u[1:-1, 1:-1])
