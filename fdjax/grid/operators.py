"""The elliptic equations, their linearisation and its transpose on one lattice, and relaxation.

All have one form, `N(u) = f`, and one way to be relaxed: zebra by lines, for all lines of a colour
at once. Everything is per index step of the lattice.
"""

from abc import abstractmethod
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.grid.transfer import Pair, Plane, each, restricted, walled
from fdjax.grid.winslow import ControlFunctions


class _Differences(NamedTuple):
    """Central differences per index step of one coordinate, at some of the interior nodes."""

    xi: Array
    eta: Array
    xi_xi: Array
    eta_eta: Array
    xi_eta: Array


class _Nodes(NamedTuple):
    """Every second interior line (or all): slices of the first node, and whether to skip lines.

    - `axis`: that the lines run along; `first`: 1 or 2, the first line taken; 0 takes all nodes.
    """

    axis: int = 0
    first: int = 0

    def of(self, u: Plane, di: int = 0, dj: int = 0) -> Array:
        """The values at the neighbours at an offset; a scalar, or one a lane, is so everywhere."""
        if u.ndim < 2:
            return u
        first, end, step = [0] * u.ndim, list(u.shape), [1] * u.ndim
        for axis, offset in enumerate((di, dj)):
            skip = self.first and axis != self.axis
            start, step[axis] = (self.first, 2) if skip else (1, 1)
            first[axis], end[axis] = start + offset, u.shape[axis] - 1 + offset
        # Thousands of these are traced, and indexing takes longer to.
        return jax.lax.slice(u, first, end, step)

    def spread(self, values: Array, shape: tuple[int, ...]) -> Plane:
        """A plane with these values at the nodes and zeros elsewhere."""
        padding = [(0, 0, 0)] * values.ndim
        for axis in (0, 1):
            skip = self.first and axis != self.axis
            start, step = (self.first, 2) if skip else (1, 1)
            end = shape[axis] - start - (step * (values.shape[axis] - 1) + 1)
            padding[axis] = (start, end, step - 1)
        return jax.lax.pad(values, jnp.zeros((), values.dtype), padding)

    def less(self, values: Pair, f: Pair | None) -> Pair:
        """The values less those of planes, if there are any."""
        return values if f is None else each(lambda v, plane: v - self.of(plane), values, f)

    def differences(self, u: Plane) -> _Differences:
        here, east, west = self.of(u), self.of(u, 1), self.of(u, -1)
        north, south = self.of(u, 0, 1), self.of(u, 0, -1)
        cross = self.of(u, 1, 1) - self.of(u, -1, 1) - self.of(u, 1, -1) + self.of(u, -1, -1)
        return _Differences(
            (east - west) / 2,
            (north - south) / 2,
            east - 2 * here + west,
            north - 2 * here + south,
            cross / 4,
        )


_ALL = _Nodes()


class _Lines(NamedTuple):
    """Line systems `diagonal d - lower d_before - upper d_after = residual` at some nodes."""

    lower: Array
    diagonal: Array
    upper: Array
    residual: Pair


_FEW = 800
"""Nodes of a colour up to which lines are eliminated one by one, by LAPACK: compiled already."""


def _solved(lines: _Lines, axis: int) -> Pair:
    """The change at the nodes, by Thomas' algorithm for all lines at once."""
    if lines.diagonal.size <= _FEW:
        return _solved_one_by_one(lines, axis)
    change = _overwritten(jax.tree.map(lambda u: jnp.moveaxis(u, axis, 0), lines))
    return each(lambda u: jnp.moveaxis(u, 0, axis), change)


def _solved_one_by_one(lines: _Lines, axis: int) -> Pair:
    lower, diagonal, upper, residual = jax.tree.map(lambda u: jnp.moveaxis(u, axis, -1), lines)
    lower, upper = lower.at[..., 0].set(0.0), upper.at[..., -1].set(0.0)
    change = jax.lax.linalg.tridiagonal_solve(-lower, diagonal, -upper, jnp.stack(residual, -1))
    return jnp.moveaxis(change[..., 0], -1, axis), jnp.moveaxis(change[..., 1], -1, axis)


def _overwritten(lines: _Lines) -> Pair:
    """Written over the systems: a scan would fill and copy what it returns."""
    lower, diagonal, upper, residual = lines
    count, none = diagonal.shape[0], jnp.zeros_like(diagonal[0])

    def row(plane: Array, i: Array) -> Array:
        return jax.lax.dynamic_index_in_dim(plane, i, keepdims=False, allow_negative_indices=False)

    def put(planes: tuple, rows: tuple, i: Array) -> tuple:
        return tuple(
            jax.lax.dynamic_update_index_in_dim(plane, row, i, 0, allow_negative_indices=False)
            for plane, row in zip(planes, rows, strict=True)
        )

    def down(i: Array, state: tuple) -> tuple:
        planes, (u, x, y) = state
        pull = row(lower, i)
        pivot = 1 / (row(diagonal, i) - pull * u)
        u = row(planes[0], i) * pivot
        x, y = (
            (row(plane, i) + pull * v) * pivot for plane, v in zip(planes[1:], (x, y), strict=True)
        )
        return put(planes, (u, x, y), i), (u, x, y)

    (upper, *residual), _ = jax.lax.fori_loop(
        0, count, down, ((upper, *residual), (none, none, none))
    )

    def up(k: Array, state: tuple) -> tuple:
        planes, after = state
        i = count - 1 - k
        pull = row(upper, i)
        here = tuple(row(plane, i) + pull * v for plane, v in zip(planes, after, strict=True))
        return put(planes, here, i), here

    return jax.lax.fori_loop(0, count, up, (tuple(residual), (none, none)))[0]


class AbstractOperator:
    """An equation `N(u) = f` on one lattice; without f it is zero, and costs no reading."""

    @abstractmethod
    def lines(self, u: Pair, f: Pair | None, nodes: _Nodes) -> _Lines:
        """Line systems for the change of u at `nodes`; the residual is N(u) - f."""

    @abstractmethod
    def coarser(self, shape: tuple[int, int], coarse: tuple[int, int]) -> Self:
        """The equation on a coarser lattice than this one, which has that shape."""

    def residual(self, u: Pair, f: Pair | None = None) -> Pair:
        """N(u) - f, zero on the walls."""
        return each(walled, self.lines(u, f, _ALL).residual)

    # Traced once for all places where a lattice is relaxed.
    @partial(jax.jit, static_argnames=("axis", "sweeps"))
    def relaxed(self, u: Pair, f: Pair | None, axis: int, sweeps: int = 1) -> Pair:
        """u after zebra relaxation along the lines of an axis, so many times."""

        def sweep(_: Any, u: Pair) -> Pair:
            for first in (1, 2):
                nodes = _Nodes(axis, first)
                change = _solved(self.lines(u, f, nodes), axis)
                u = each(lambda v, d, nodes=nodes: v + nodes.spread(d, v.shape), u, change)
            return u

        # A loop, so that a sweep is compiled once.
        return jax.lax.fori_loop(0, sweeps, sweep, u)


def _line_matrix(
    a: Array, c: Array, by_xi: Array, by_eta: Array, axis: int
) -> tuple[Array, Array, Array]:
    """Coefficients along a line, cut back so that they stay positive on coarse lattices."""
    along, slope = (a, by_xi) if axis == 0 else (c, by_eta)
    slope = jnp.clip(slope / 2, -0.9 * along, 0.9 * along)
    return along - slope, 2 * (a + c), along + slope


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class GridEquations(AbstractOperator):
    """The equations of `winslow`; controls as planes, walls included, or scalars."""

    controls: ControlFunctions

    def lines(self, u: Pair, f: Pair | None, nodes: _Nodes) -> _Lines:
        x, y = (nodes.differences(plane) for plane in u)
        a, b, c, by_xi, by_eta = _coefficients(x, y, *map(nodes.of, self.controls))

        def left(d: _Differences) -> Array:
            return a * d.xi_xi - 2 * b * d.xi_eta + c * d.eta_eta + by_xi * d.xi + by_eta * d.eta

        matrix = _line_matrix(a, c, by_xi, by_eta, nodes.axis)
        return _Lines(*matrix, nodes.less((left(x), left(y)), f))

    def coarser(self, shape: tuple[int, int], coarse: tuple[int, int]) -> "GridEquations":
        xi, eta = _ratios(shape, coarse)
        phi, psi, p, q = (u if u.ndim < 2 else restricted(u, coarse) for u in self.controls)
        return GridEquations(ControlFunctions(phi * xi, psi * eta, p / xi, q / eta))


def _ratios(shape: tuple[int, int], coarse: tuple[int, int]) -> tuple[float, float]:
    """Steps of a coarse lattice in those of a fine one."""
    xi, eta = ((n - 1) / (m - 1) for n, m in zip(shape, coarse, strict=True))
    return xi, eta


def _coefficients(
    x: _Differences, y: _Differences, phi: Array, psi: Array, p: Array, q: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """|r_e|^2, r_x . r_e, |r_x|^2, and what multiplies r_x and r_e."""
    a, c = x.eta**2 + y.eta**2, x.xi**2 + y.xi**2
    square = (x.xi * y.eta - x.eta * y.xi) ** 2
    return a, x.xi * x.eta + y.xi * y.eta, c, a * phi + square * p, c * psi + square * q


Terms = tuple[Plane, ...] | Float[Array, "11 ni nj"]
"""Planes of a linear operator: apart on the finest lattice, whose copies take time, or stacked."""


def derivative(u: Pair, equations: GridEquations) -> Terms:
    """The equations linearised at the lattice u, per index step.

    `a v_xx - 2 b v_xe + c v_ee + of_xi v_x + of_eta v_e` with 2 x 2 matrices of_xi and of_eta: the
    planes a, b, c, and xx, xy, yx, yy of both. Walls are as their neighbours; v is zero there.
    """
    x, y = (_ALL.differences(plane) for plane in u)
    phi, psi, p, q = map(_ALL.of, equations.controls)
    a, b, c, by_xi, by_eta = _coefficients(x, y, phi, psi, p, q)
    jacobian = x.xi * y.eta - x.eta * y.xi
    bent_xi = x.xi_xi + phi * x.xi, y.xi_xi + phi * y.xi
    bent_eta = x.eta_eta + psi * x.eta, y.eta_eta + psi * y.eta
    cross = x.xi_eta, y.xi_eta
    along_xi, along_eta = (x.xi, y.xi), (x.eta, y.eta)
    source = p * x.xi + q * x.eta, p * y.xi + q * y.eta
    turned_eta, turned_xi = (y.eta, -x.eta), (-y.xi, x.xi)

    def matrix(diagonal: Array, bent: Any, along: Any, other: Any, turned: Any) -> Any:
        def entry(i: int, j: int) -> Array:
            value = 2 * bent[i] * along[j] - 2 * cross[i] * other[j]
            value = value + 2 * jacobian * source[i] * turned[j]
            return value + diagonal if i == j else value

        return (entry(i, j) for i in (0, 1) for j in (0, 1))

    of_xi = matrix(by_xi, bent_eta, along_xi, along_eta, turned_eta)
    of_eta = matrix(by_eta, bent_xi, along_eta, along_xi, turned_xi)
    return tuple(_extended(plane) for plane in (a, b, c, *of_xi, *of_eta))


class Stencil(NamedTuple):
    """Linear equations at the interior nodes: nine 2 x 2 blocks each, shape (i, j, 2, 2).

    `blocks[di + 1][dj + 1]` acts on the change of the neighbour at offset (di, dj).
    """

    blocks: tuple[tuple[Float[Array, "i j 2 2"], ...], ...]


def stencil(terms: Terms) -> Stencil:
    """The blocks of a `derivative`."""
    entries = jnp.stack([plane[1:-1, 1:-1] for plane in terms], -1)
    of_xi, of_eta = (
        entries[..., first : first + 4].reshape(*entries.shape[:2], 2, 2) / 2 for first in (3, 7)
    )
    a, b, c = (entries[..., k, None, None] * jnp.eye(2, dtype=entries.dtype) for k in range(3))
    corner, middle = b / 2, -2 * (a + c)
    return Stencil(
        (
            (-corner, a - of_xi, corner),
            (c - of_eta, middle, c + of_eta),
            (corner, a + of_xi, -corner),
        )
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class AbstractLinear(AbstractOperator):
    """An operator on changes that are zero on the walls, given by the planes of `derivative`."""

    terms: Terms

    def coarser(self, shape: tuple[int, int], coarse: tuple[int, int]) -> Self:
        xi, eta = _ratios(shape, coarse)
        scale = [eta**2, xi * eta, xi**2, *[xi * eta**2] * 4, *[xi**2 * eta] * 4]
        terms = (restricted(plane, coarse) for plane in self.terms)
        return type(self)(jnp.stack([s * plane for s, plane in zip(scale, terms, strict=True)]))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Linearised(AbstractLinear):
    """The linearised equations."""

    def lines(self, u: Pair, f: Pair | None, nodes: _Nodes) -> _Lines:
        x, y = (nodes.differences(plane) for plane in u)
        a, b, c, *of = map(nodes.of, self.terms)
        of_xi, of_eta = of[:4], of[4:]

        def left(d: _Differences, k: int) -> Array:
            own = a * d.xi_xi - 2 * b * d.xi_eta + c * d.eta_eta
            own = own + of_xi[2 * k] * x.xi + of_xi[2 * k + 1] * y.xi
            return own + of_eta[2 * k] * x.eta + of_eta[2 * k + 1] * y.eta

        mean_xi, mean_eta = (of_xi[0] + of_xi[3]) / 2, (of_eta[0] + of_eta[3]) / 2
        matrix = _line_matrix(a, c, mean_xi, mean_eta, nodes.axis)
        return _Lines(*matrix, nodes.less((left(x, 0), left(y, 1)), f))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Transposed(AbstractLinear):
    """The transpose of `Linearised`: differences of products instead of products of differences."""

    def lines(self, u: Pair, f: Pair | None, nodes: _Nodes) -> _Lines:
        a, b, c, *of = self.terms
        of_xi, of_eta = of[:4], of[4:]

        def second(weight: Plane, v: Plane, part: str) -> Array:
            return getattr(nodes.differences(weight * v), part)

        def left(k: int) -> Array:
            v = u[k]
            own = second(a, v, "xi_xi") - 2 * second(b, v, "xi_eta") + second(c, v, "eta_eta")
            by_xi = of_xi[k] * u[0] + of_xi[2 + k] * u[1]
            by_eta = of_eta[k] * u[0] + of_eta[2 + k] * u[1]
            return own - nodes.differences(by_xi).xi - nodes.differences(by_eta).eta

        mean_xi, mean_eta = (of_xi[0] + of_xi[3]) / 2, (of_eta[0] + of_eta[3]) / 2
        lower, _, upper = _line_matrix(a, c, mean_xi, mean_eta, nodes.axis)
        before, after = ((-1, 0), (1, 0)) if nodes.axis == 0 else ((0, -1), (0, 1))
        # What acts on the node before is the upper coefficient of that node.
        matrix = nodes.of(upper, *before), nodes.of(2 * (a + c)), nodes.of(lower, *after)
        return _Lines(*matrix, nodes.less((left(0), left(1)), f))


def _extended(u: Array) -> Plane:
    """Values at the interior nodes with those next to them on the walls."""
    return jnp.pad(u, [(1, 1), (1, 1), *[(0, 0)] * (u.ndim - 2)], mode="edge")


def equations_of(controls: ControlFunctions) -> GridEquations:
    """The equations with controls given at the interior nodes."""
    return GridEquations(
        ControlFunctions(*(_extended(field) if field.ndim > 1 else field for field in controls))
    )


def mean_correction(
    equations: GridEquations, u: Pair, inside: np.ndarray | None = None
) -> Float[Array, "*lanes"]:
    """Mean absolute Gauss-Seidel correction of a coordinate, mm: the measure of convergence.

    - `inside`: 1 at the interior nodes that count, 0 at others; None: all do.
    """
    lines = equations.lines(u, None, _ALL)
    x, y = lines.residual
    size = (jnp.abs(x) + jnp.abs(y)) / lines.diagonal
    if inside is not None:
        return _total(size * inside) / (2 * inside.sum())
    return _total(size) / (2 * x.shape[0] * x.shape[1])


def _total(values: Array) -> Float[Array, "*lanes"]:
    """Sum of a plane, as products: a reduction would work out each value on its own, slowly."""
    for count in values.shape[:2]:
        values = jnp.tensordot(jnp.ones(count), values, 1)
    return values


def corner_jacobians(u: Pair) -> tuple[Array, Array, Array, Array]:
    """Twice the signed area of the triangle at each corner of every cell, mm^2.

    The grid is unfolded where all are positive: then every bilinear cell is one-to-one.
    """

    def corners(v: Plane) -> tuple[Array, Array, Array, Array]:
        return v[:-1, :-1], v[1:, :-1], v[1:, 1:], v[:-1, 1:]

    (ax, bx, cx, dx), (ay, by, cy, dy) = map(corners, u)
    return (
        (bx - ax) * (dy - ay) - (by - ay) * (dx - ax),
        (cx - bx) * (ay - by) - (cy - by) * (ax - bx),
        (dx - cx) * (by - cy) - (dy - cy) * (bx - cx),
        (ax - dx) * (cy - dy) - (ay - dy) * (cx - dx),
    )


def folded(u: Pair) -> Bool[Array, "*lanes"]:
    """Whether a cell has a corner that is not convex, or is no number."""
    a, b, c, d = corner_jacobians(u)
    least = jnp.minimum(jnp.minimum(a, b), jnp.minimum(c, d))
    return _total(jnp.where(least > 0, 0.0, 1.0)) > 0
