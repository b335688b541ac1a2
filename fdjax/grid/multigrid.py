"""Multigrid for the elliptic grid equations and for their linearisation, forward and transposed.

Full approximation scheme (Brandt, Math. Comp. 31, 1977): zebra line relaxation along xi before and
along eta after each coarse correction, bilinear transfers between lattices of any size, and a
start from the coarsest lattice upwards. The two coordinates are separate arrays throughout, and
line systems are solved for all lines of a colour at once: the compiler is fast with both.

Everything is per index step of its own lattice; a residual changes by the product of the steps'
ratios, squared, from lattice to lattice.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.grid.winslow import ControlFunctions

Plane = Float[Array, "ni nj"]
Pair = tuple[Plane, Plane]
"""A field of vectors: its x and its y."""

COARSEST = 7
"""A side of at most so many steps is not coarsened any more."""

_SWEEPS_AT_THE_BOTTOM = 1
_SWEEPS_TO_START = 20


def planes(r: Float[Array, "ni nj 2"]) -> Pair:
    """The coordinates apart."""
    return r[..., 0], r[..., 1]


def points(pair: Pair) -> Float[Array, "ni nj 2"]:
    """The coordinates together again."""
    return jnp.stack(pair, -1)


def _each(function: Any, *pairs: Pair) -> Pair:
    return function(*(pair[0] for pair in pairs)), function(*(pair[1] for pair in pairs))


# --- transfers, one axis at a time ---


def _coarse(count: int) -> int:
    """Nodes of the next coarser lattice along a side of `count` nodes."""
    return count if count - 1 <= COARSEST else count // 2 + 1


def _taken(u: Array, index: np.ndarray, weight: np.ndarray, axis: int) -> Array:
    """sum_t weight[t, k] u[index[t, k]] along an axis."""
    shape = [1, 1]
    shape[axis] = -1
    return sum(
        (
            jnp.take(u, i, axis, mode="clip") * w.reshape(shape)
            for i, w in zip(index, weight, strict=True)
        ),
        jnp.zeros(()),
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
        middle = (
            jax.lax.slice_in_dim(u, 1, None, axis=axis) + jax.lax.slice_in_dim(u, 0, -1, axis=axis)
        ) / 2
        return _spread(u, 0, 0, axis) + _spread(middle, 1, 1, axis)
    return _taken(u, *_between(_places(count, coarse), coarse), axis)


def _spread(u: Array, before: int, after: int, axis: int) -> Array:
    """Zeros between the values along an axis, and so many before and after them."""
    return _shifted(u, before, after, axis, between=1)


def _shifted(u: Array, before: int, after: int, axis: int, between: int = 0) -> Array:
    padding = [(0, 0, 0), (0, 0, 0)]
    padding[axis] = (before, after, between)
    return jax.lax.pad(u, jnp.zeros((), u.dtype), padding)


def _sampled(u: Array, axis: int) -> Array:
    count = u.shape[axis]
    coarse = _coarse(count)
    if count == coarse:
        return u
    if count == 2 * coarse - 1:
        return jax.lax.slice_in_dim(u, 0, None, 2, axis)
    return _taken(u, *_between(_places(coarse, count), count), axis)


def _averaged(u: Array, axis: int) -> Array:
    """The transpose of refining, made a mean."""
    count = u.shape[axis]
    coarse = _coarse(count)
    if count == coarse:
        return u
    if count == 2 * coarse - 1:
        # The same three weights everywhere but on the walls, which no residual has.
        even = jax.lax.slice_in_dim(u, 0, None, 2, axis)
        odd = jax.lax.slice_in_dim(u, 1, None, 2, axis)
        return even / 2 + (_shifted(odd, 0, 1, axis) + _shifted(odd, 1, 0, axis)) / 4
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


def restricted(u: Plane) -> Plane:
    """Values of the next coarser lattice, by bilinear interpolation."""
    return _both(_sampled, u)


def restricted_residual(u: Plane) -> Plane:
    """The mean residual around each node of the next coarser lattice, per its own steps."""
    coarse = _both(_averaged, u)
    step = np.prod([(n - 1) / (m - 1) for n, m in zip(u.shape, coarse.shape, strict=True)])
    return _interior(coarse * step**2)


def prolonged(u: Plane, shape: tuple[int, int]) -> Plane:
    return _refined(_refined(u, shape[0], 0), shape[1], 1)


def _interior(u: Plane) -> Plane:
    """The plane with zeros on the walls."""
    return jnp.pad(u[1:-1, 1:-1], 1)


# --- relaxation along lines ---


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
        """The values at the neighbours at an offset."""
        cuts = []
        for axis, offset in enumerate((di, dj)):
            skip = self.first and axis != self.axis
            start, step = (self.first, 2) if skip else (1, 1)
            cuts.append(slice(start + offset, u.shape[axis] - 1 + offset, step))
        return u[tuple(cuts)]

    def spread(self, values: Array, shape: tuple[int, int]) -> Plane:
        """A plane with these values at the nodes and zeros elsewhere."""
        padding = []
        for axis in (0, 1):
            skip = self.first and axis != self.axis
            start, step = (self.first, 2) if skip else (1, 1)
            end = shape[axis] - start - (step * (values.shape[axis] - 1) + 1)
            padding.append((start, end, step - 1))
        return jax.lax.pad(values, jnp.zeros((), values.dtype), padding)

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


def _solved(lines: _Lines, axis: int) -> Pair:
    """Thomas' algorithm, all lines at once."""
    lower, diagonal, upper, residual = jax.tree.map(lambda u: jnp.moveaxis(u, axis, 0), lines)
    none = jnp.zeros_like(diagonal[0])

    def down(carry: tuple, row: tuple) -> tuple[tuple, tuple]:
        ratio, x, y = carry
        lower, diagonal, upper, rx, ry = row
        pivot = 1 / (diagonal - lower * ratio)
        carry = upper * pivot, (rx + lower * x) * pivot, (ry + lower * y) * pivot
        return carry, carry

    _, rows = jax.lax.scan(down, (none, none, none), (lower, diagonal, upper, *residual))

    def up(carry: tuple, row: tuple) -> tuple[tuple, tuple]:
        ratio, x, y = row
        carry = x + ratio * carry[0], y + ratio * carry[1]
        return carry, carry

    _, change = jax.lax.scan(up, (none, none), rows, reverse=True)
    return _each(lambda u: jnp.moveaxis(u, 0, axis), change)


class AbstractOperator:
    """An equation `N(u) = f` on one lattice."""

    @abstractmethod
    def lines(self, u: Pair, f: Pair, nodes: _Nodes) -> _Lines:
        """Line systems for the change of u at `nodes`; the residual is N(u) - f."""

    def residual(self, u: Pair, f: Pair) -> Pair:
        """N(u) - f, zero on the walls."""
        return _each(lambda v: jnp.pad(v, 1), self.lines(u, f, _ALL).residual)

    def relaxed(self, u: Pair, f: Pair, axis: int) -> Pair:
        """u after zebra relaxation along the lines of an axis."""
        for first in (1, 2):
            nodes = _Nodes(axis, first)
            change = _solved(self.lines(u, f, nodes), axis)
            u = _each(lambda v, d, nodes=nodes: v + nodes.spread(d, v.shape), u, change)
        return u


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
    """The equations of `winslow`; controls as planes, walls included."""

    controls: ControlFunctions

    def lines(self, u: Pair, f: Pair, nodes: _Nodes) -> _Lines:
        x, y = (nodes.differences(plane) for plane in u)
        a, b, c, by_xi, by_eta = _coefficients(x, y, *map(nodes.of, self.controls))

        def residual(d: _Differences, f: Plane) -> Array:
            return (
                a * d.xi_xi
                - 2 * b * d.xi_eta
                + c * d.eta_eta
                + by_xi * d.xi
                + by_eta * d.eta
                - nodes.of(f)
            )

        matrix = _line_matrix(a, c, by_xi, by_eta, nodes.axis)
        return _Lines(*matrix, (residual(x, f[0]), residual(y, f[1])))

    def coarser(self) -> "GridEquations":
        ni, nj = self.controls.phi.shape
        xi, eta = (ni - 1) / (_coarse(ni) - 1), (nj - 1) / (_coarse(nj) - 1)
        phi, psi, p, q = map(restricted, self.controls)
        return GridEquations(ControlFunctions(phi * xi, psi * eta, p / xi, q / eta))


def _coefficients(
    x: _Differences, y: _Differences, phi: Array, psi: Array, p: Array, q: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """|r_e|^2, r_x . r_e, |r_x|^2, and what multiplies r_x and r_e."""
    a, c = x.eta**2 + y.eta**2, x.xi**2 + y.xi**2
    square = (x.xi * y.eta - x.eta * y.xi) ** 2
    return a, x.xi * x.eta + y.xi * y.eta, c, a * phi + square * p, c * psi + square * q


class Derivative(NamedTuple):
    """The linearised equations at the interior nodes, per index step.

    `a v_xx - 2 b v_xe + c v_ee + of_xi v_x + of_eta v_e` with 2 x 2 matrices `of_xi`, `of_eta` as
    (xx, xy, yx, yy), each an array of shape (ni - 2, nj - 2), zero-padded to the walls.
    """

    a: Plane
    b: Plane
    c: Plane
    of_xi: tuple[Plane, Plane, Plane, Plane]
    of_eta: tuple[Plane, Plane, Plane, Plane]


def derivative(u: Pair, equations: GridEquations) -> Derivative:
    """The equations linearised at the lattice u."""
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

        return tuple(jnp.pad(entry(i, j), 1) for i in (0, 1) for j in (0, 1))

    return Derivative(
        jnp.pad(a, 1),
        jnp.pad(b, 1),
        jnp.pad(c, 1),
        matrix(by_xi, bent_eta, along_xi, along_eta, turned_eta),
        matrix(by_eta, bent_xi, along_eta, along_xi, turned_xi),
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Linearised(AbstractOperator):
    """A `Derivative` as an operator on changes that are zero on the walls."""

    terms: Derivative

    def lines(self, u: Pair, f: Pair, nodes: _Nodes) -> _Lines:
        x, y = (nodes.differences(plane) for plane in u)
        a, b, c, of_xi, of_eta = jax.tree.map(nodes.of, self.terms)

        def residual(d: _Differences, k: int) -> Array:
            own = a * d.xi_xi - 2 * b * d.xi_eta + c * d.eta_eta
            own = own + of_xi[2 * k] * x.xi + of_xi[2 * k + 1] * y.xi
            return own + of_eta[2 * k] * x.eta + of_eta[2 * k + 1] * y.eta - nodes.of(f[k])

        mean_xi, mean_eta = (of_xi[0] + of_xi[3]) / 2, (of_eta[0] + of_eta[3]) / 2
        matrix = _line_matrix(a, c, mean_xi, mean_eta, nodes.axis)
        return _Lines(*matrix, (residual(x, 0), residual(y, 1)))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Transposed(AbstractOperator):
    """The transpose of `Linearised`: differences of products instead of products of differences."""

    terms: Derivative

    def lines(self, u: Pair, f: Pair, nodes: _Nodes) -> _Lines:
        a, b, c, of_xi, of_eta = self.terms

        def second(weight: Plane, v: Plane, part: str) -> Array:
            return getattr(nodes.differences(weight * v), part)

        def residual(k: int) -> Array:
            v = u[k]
            own = second(a, v, "xi_xi") - 2 * second(b, v, "xi_eta") + second(c, v, "eta_eta")
            by_xi = of_xi[k] * u[0] + of_xi[2 + k] * u[1]
            by_eta = of_eta[k] * u[0] + of_eta[2 + k] * u[1]
            own = own - nodes.differences(by_xi).xi - nodes.differences(by_eta).eta
            return own - nodes.of(f[k])

        mean_xi, mean_eta = (of_xi[0] + of_xi[3]) / 2, (of_eta[0] + of_eta[3]) / 2
        lower, _, upper = _line_matrix(a, c, mean_xi, mean_eta, nodes.axis)
        before, after = ((-1, 0), (1, 0)) if nodes.axis == 0 else ((0, -1), (0, 1))
        # What acts on the node before is the upper coefficient of that node.
        matrix = nodes.of(upper, *before), nodes.of(2 * (a + c)), nodes.of(lower, *after)
        return _Lines(*matrix, (residual(0), residual(1)))


# --- cycles ---


def equations_of(controls: ControlFunctions) -> GridEquations:
    """The equations with controls given at the interior nodes."""
    return GridEquations(ControlFunctions(*(jnp.pad(field, 1, mode="edge") for field in controls)))


def _shape(u: Plane) -> tuple[int, int]:
    return u.shape[0], u.shape[1]


def _depth(shape: tuple[int, int]) -> int:
    coarse = _coarse(shape[0]), _coarse(shape[1])
    return 1 if coarse == shape else 1 + _depth(coarse)


def hierarchy(equations: GridEquations) -> list[GridEquations]:
    """The equations on all lattices, finest first."""
    levels = [equations]
    for _ in range(_depth(_shape(equations.controls.phi)) - 1):
        levels.append(levels[-1].coarser())
    return levels


def cycles(
    levels: Any,
    u: Pair,
    f: Pair,
    *,
    count: int = 1,
    visits: tuple[int, ...] = (2, 2),
    fresh: Any = False,
    linear: bool = False,
) -> Pair:
    """u after `count` multigrid cycles for N(u) = f.

    - `levels`: the operators on all lattices, finest first.
    - `fresh`: whether to begin with a solution on the next coarser lattice, found in the same way:
      a full-multigrid start, for f = 0 only. May be traced.
    - `linear`: for linear operators: coarse changes start from zero.
    - `visits`: how often a lattice visits the next coarser one in a cycle, finest first, 1 below:
      the coarsest ones cost more time than they bring.

    All visits of a lattice share one loop, so that each is compiled once.
    """
    operator, *rest = levels
    if not rest:
        sweeps = jnp.where(fresh, _SWEEPS_TO_START, _SWEEPS_AT_THE_BOTTOM)
        return jax.lax.fori_loop(
            0, sweeps, lambda _, u: operator.relaxed(operator.relaxed(u, f, 0), f, 1), u
        )
    none = _each(lambda v: jnp.zeros_like(restricted(v)), u)

    def visit(number: Any, u: Pair) -> Pair:
        starting = number == 0
        u = operator.relaxed(u, f, 0)
        residual = _each(restricted_residual, operator.residual(u, f))
        coarse = none if linear else _each(restricted, u)
        own = rest[0].residual(coarse, none)
        goal = _each(lambda n, r: jnp.where(starting, 0.0, n - r), own, residual)
        found = cycles(
            rest,
            coarse,
            goal,
            count=(*visits, 1)[0],
            visits=visits[1:],
            fresh=starting,
            linear=linear,
        )
        change = _each(lambda new, old: prolonged(new - old, _shape(u[0])), found, coarse)
        u = _each(lambda v, d: v + _interior(d), u, change)
        return operator.relaxed(u, f, 1)

    return jax.lax.fori_loop(jnp.where(fresh, 0, 1), 1 + count, visit, u)


def mean_correction(equations: GridEquations, u: Pair) -> Float[Array, ""]:
    """What `winslow.mean_correction` gives, from planes."""
    lines = equations.lines(u, _each(jnp.zeros_like, u), _ALL)
    x, y = lines.residual
    return _total((jnp.abs(x) + jnp.abs(y)) / lines.diagonal) / (2 * x.size)


def _total(values: Array) -> Float[Array, ""]:
    """Sum of a plane, as products: a reduction would work out each value on its own, slowly."""
    return jnp.ones(values.shape[0]) @ (values @ jnp.ones(values.shape[1]))


def folded(u: Pair) -> Bool[Array, ""]:
    """Whether a cell has a corner that is not convex."""
    x, y = u

    def corners(v: Plane) -> tuple[Array, Array, Array, Array]:
        return v[:-1, :-1], v[1:, :-1], v[1:, 1:], v[:-1, 1:]

    (ax, bx, cx, dx), (ay, by, cy, dy) = corners(x), corners(y)
    least = jnp.minimum(
        jnp.minimum(
            (bx - ax) * (dy - ay) - (by - ay) * (dx - ax),
            (cx - bx) * (ay - by) - (cy - by) * (ax - bx),
        ),
        jnp.minimum(
            (dx - cx) * (by - cy) - (dy - cy) * (bx - cx),
            (ax - dx) * (cy - dy) - (ay - dy) * (cx - dx),
        ),
    )
    return ~(_total(jnp.where(least > 0, 0.0, 1.0)) == 0)


# --- the linearised equations ---


def linear_levels(
    r: Pair, equations: GridEquations, operator: type[Linearised] | type[Transposed]
) -> list[Any]:
    """The equations linearised at the lattice r, on all lattices, or their transposes."""
    levels = []
    for each in hierarchy(equations):
        levels.append(operator(derivative(r, each)))
        r = _each(restricted, r)
    return levels


class _Search(NamedTuple):
    """State of `solve_linear`: `size` is the residual's, `images` those of the directions."""

    x: Pair
    residual: Pair
    directions: tuple[Array, Array]
    images: tuple[Array, Array]
    steps: Array
    size: Array


def solve_linear(
    levels: Any, rhs: Pair, *, tolerance: float = 1e-11, directions: int = 6, limit: int = 60
) -> Pair:
    """Solution of a linear system by generalised conjugate residuals, a cycle each direction.

    GCR (Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20, 1983), truncated to the last
    `directions`. Stops when the residual is `tolerance` of the right side; where `limit` cycles do
    not bring it below the root of that, the result is NaN.
    """
    operator = levels[0]
    zero = _each(jnp.zeros_like, rhs)
    size = _norm(rhs)
    past = _each(lambda u: jnp.zeros((directions, *u.shape)), rhs)

    def unfinished(state: _Search) -> Array:
        return (state.size > tolerance * size) & (state.steps < limit)

    def step(state: _Search) -> _Search:
        way = cycles(levels, zero, state.residual, linear=True)
        image = operator.residual(way, zero)
        share = sum(
            (
                jnp.einsum("kij,ij->k", old, new)
                for old, new in zip(state.images, image, strict=True)
            ),
            jnp.zeros(()),
        )
        image = _each(
            lambda new, old: new - jnp.einsum("k,kij->ij", share, old), image, state.images
        )
        way = _each(
            lambda new, old: new - jnp.einsum("k,kij->ij", share, old), way, state.directions
        )
        length = _norm(image)
        scale = jnp.where(length > 0, 1 / jnp.where(length > 0, length, 1.0), 0.0)
        image, way = _each(lambda u: u * scale, image), _each(lambda u: u * scale, way)
        step = sum(
            ((a * b).sum() for a, b in zip(image, state.residual, strict=True)), jnp.zeros(())
        )
        x = _each(lambda u, d: u + step * d, state.x, way)
        residual = _each(lambda u, d: u - step * d, state.residual, image)
        place = state.steps % directions
        return _Search(
            x,
            residual,
            _each(lambda old, new: old.at[place].set(new), state.directions, way),
            _each(lambda old, new: old.at[place].set(new), state.images, image),
            state.steps + 1,
            _norm(residual),
        )

    found = jax.lax.while_loop(
        unfinished, step, _Search(zero, rhs, past, past, jnp.asarray(0), size)
    )
    failed = found.size > tolerance**0.5 * size
    return _each(lambda u: jnp.where(failed, jnp.nan, u), found.x)


def _norm(u: Pair) -> Float[Array, ""]:
    return jnp.sqrt((u[0] ** 2).sum() + (u[1] ** 2).sum())
