"""Conformal maps of a polygon: Schwarz-Christoffel, from the disc and from a rectangle.

`f(z) = A + C int prod_k (1 - z / z_k)^(alpha_k - 1) dz` maps the unit disc onto the polygon with
interior angles pi alpha_k (Ives, AIAA Journal 14(8), 1976; Trefethen, SIAM J. Sci. Stat. Comput.
1(1), 1980). The parameter problem asks for the prevertices z_k. Four vertices are corners: their
prevertices are put at exp(i psi), -exp(-i psi), -exp(i psi), exp(-i psi), which a Jacobi elliptic
function maps to the corners of a rectangle.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Complex, Float

from fdjax.grid.algebraic import Spacings
from fdjax.grid.base import Sides
from fdjax.grid.elliptic import NodeMap
from fdjax.part.curve import polyline_at
from fdjax.precision import require_float64

NODES = 192
"""Of the quadrature: its error is below rounding for gaps down to 1e-8 of a turn."""

_TAU = np.linspace(-4.2, 4.2, NODES)
_STEEP = np.pi / 2 * np.sinh(_TAU)
FROM_START = 1 / (1 + np.exp(-2 * _STEEP))
"""Places of the quadrature in [0, 1], crowded doubly exponentially at both ends (Takahasi and
Mori, 1974), so that any power is integrated there; and their distances from 1."""
FROM_END = FROM_START[::-1]
WEIGHT = np.pi * np.cosh(_TAU) * FROM_START * FROM_END * (_TAU[1] - _TAU[0])


class Prevertices(NamedTuple):
    """The solved parameter problem of a polygon with vertices w_k, counter-clockwise.

    - `angle`: of the prevertices, rising, radians, shape (n,); `psi`: of the corners' prevertices.
    - `power`: alpha_k - 1, shape (n,); `scale`: C.
    - `corners`: indices of the four vertices at (xi, eta) = (0, 0), (1, 0), (1, 1), (0, 1).
    - `error`: by how much the vertices disagree about f(0), over the polygon's size.
    """

    angle: Float[Array, " n"]
    psi: Float[Array, ""]
    power: Float[Array, " n"]
    vertices: Complex[Array, " n"]
    scale: Complex[Array, ""]
    corners: Array
    error: Float[Array, ""]

    @property
    def modulus(self) -> Float[Array, ""]:
        """Height over width of the rectangle, `K'(k) / (2 K(k))` with `k = tan(psi / 2)^2`."""
        k, other = self.moduli
        return _quarter(other, k) / (2 * _quarter(k, other))

    @property
    def moduli(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """k and sqrt(1 - k^2), neither of them by a difference of near numbers."""
        k = jnp.tan(self.psi / 2) ** 2
        return k, jnp.sqrt(jnp.cos(self.psi) * (1 + k)) / jnp.cos(self.psi / 2)


def solve(vertices: Float[Array, "n 2"], corners: tuple[int, int, int, int]) -> Prevertices:
    """The prevertices of a polygon, counter-clockwise, with these four corners in order.

    Raises nothing for a polygon that it does not reach: `error` says it. Differentiable in the
    vertices by the implicit function theorem.
    """
    require_float64()
    count = len(vertices)
    turned = (np.arange(count) + corners[0]) % count
    w = vertices[turned, 0] + 1j * vertices[turned, 1]
    at = tuple(int(c - corners[0]) % count for c in corners)
    side = jnp.roll(w, -1) - w
    outer = jnp.angle(side / jnp.roll(side, 1))
    power = -outer / np.pi
    length = jnp.abs(side)
    # Two sides that meet at an angle follow from all others.
    apex = jnp.argmax(jnp.abs(jnp.sin(outer)))
    asked = (apex + 1 + np.arange(count - 2)) % count

    def residual(free: Array, given: tuple) -> Array:
        power, length, asked = given
        sizes = jnp.log(_side_integrals(_angles(free, at, count)[0], power) / length)[asked]
        return sizes[1:] - sizes[0]

    found = optx.root_find(
        residual,
        optx.Dogleg(rtol=1e-12, atol=1e-12),
        jax.lax.stop_gradient(_first(length, at)),
        args=(power, length, asked),
        max_steps=60,
        throw=False,
    )
    angle, psi = _angles(found.value, at, count)
    z = jnp.exp(1j * angle)
    inwards = jax.vmap(lambda k: _from(z, power, k, 0.0))(np.arange(count))
    scale = (w[at[2]] - w[at[0]]) / (inwards[at[0]] - inwards[at[2]])
    # Where f takes the middle of the disc, by way of each vertex.
    middle = w + scale * inwards
    error = jnp.abs(middle - middle.mean()).max() / jnp.abs(w - w.mean()).max()
    return Prevertices(angle, psi, power, w, scale, jnp.asarray(at), error)


def _first(length: Float[Array, " n"], at: tuple[int, ...]) -> Array:
    """Free numbers to start from: prevertices as far apart as vertices along the outline."""
    arcs = [length[a:b] for a, b in zip(at, (*at[1:], len(length)), strict=True)]
    level = (arcs[0].sum() + arcs[2].sum()) / (arcs[1].sum() + arcs[3].sum())
    return jnp.concatenate([jnp.log(level)[None], *(jnp.log(arc[1:] / arc[0]) for arc in arcs)])


def _angles(free: Array, at: tuple[int, ...], count: int) -> tuple[Array, Array]:
    """Angles of the prevertices, from the first corner on, and psi."""
    psi = np.pi / 2 * jax.nn.sigmoid(free[0])
    arcs = (2 * psi, np.pi - 2 * psi, 2 * psi, np.pi - 2 * psi)
    gaps, used = [], 1
    for arc, a, b in zip(arcs, at, (*at[1:], count), strict=True):
        inner = free[used : used + b - a - 1]
        used += b - a - 1
        gaps.append(arc * jax.nn.softmax(jnp.concatenate([jnp.zeros(1), inner])))
    gap = jnp.concatenate(gaps)
    return np.pi - psi + jnp.cumsum(gap) - gap, psi


def _side_integrals(angle: Array, power: Array) -> Float[Array, " n"]:
    """int |f'| between neighbouring prevertices along the circle, for C = 1."""
    count = len(angle)
    gap = jnp.append(angle[1:], angle[0] + 2 * np.pi) - angle
    here = np.arange(count)
    after = (here + 1) % count
    # Distances of the places from all prevertices; from the ends exactly.
    place = angle[:, None] + gap[:, None] * FROM_START
    half = (place[..., None] - angle) / 2
    half = half.at[here, :, here].set(gap[:, None] * FROM_START / 2)
    half = half.at[here, :, after].set(gap[:, None] * FROM_END / 2)
    logs = jnp.log(2 * jnp.abs(jnp.sin(half))) @ power
    return gap * (jnp.exp(logs) @ WEIGHT)


def _from(z: Array, power: Array, k: Array | int, point: Array | float) -> Array:
    """int f' from prevertex k straight to a point of the disc, for C = 1."""
    along = point - z[k]
    factor = 1 - (z[k] + along * FROM_START[:, None]) / z
    factor = factor.at[:, k].set(-along * FROM_START / z[k])
    # At a prevertex itself the way has no length.
    factor = jnp.where(factor == 0, 1.0, factor)
    return along * (WEIGHT @ jnp.exp(jnp.log(factor) @ power))


def disc_map(found: Prevertices, z: Complex[Array, "..."]) -> Complex[Array, "..."]:
    """f at points of the closed unit disc: from the nearest prevertex on, along a straight way."""
    at = jnp.exp(1j * found.angle)

    def one(point: Array) -> Array:
        nearest = jnp.argmin(jnp.abs(point - at))
        return found.vertices[nearest] + found.scale * _from(at, found.power, nearest, point)

    return jax.lax.map(one, z.ravel(), batch_size=1024).reshape(z.shape)


def rectangle_map(
    found: Prevertices, xi: Float[Array, "..."], eta: Float[Array, "..."]
) -> Float[Array, "... 2"]:
    """Points of the polygon at (xi, eta), places in the unit square: lines that cross squarely."""
    w = disc_map(found, _to_disc(found, xi, eta))
    return jnp.stack([w.real, w.imag], -1)


def _to_disc(
    found: Prevertices, xi: Float[Array, "..."], eta: Float[Array, "..."]
) -> Complex[Array, "..."]:
    """The disc's points of places in the unit square."""
    xi, eta = jnp.broadcast_arrays(xi, eta)
    k, other = found.moduli
    s, c, d = _jacobi((2 * xi - 1) * _quarter(k, other), k, other)
    s1, c1, d1 = _jacobi(eta * _quarter(other, k), other, k)
    # sn of a complex argument, as a fraction whose denominator may vanish.
    above, below = s * d1 + 1j * c * d * s1 * c1, c1**2 + (k * s * s1) ** 2
    q = 1j / jnp.tan(found.psi / 2)
    return (above - q * below) / (above + q * below)


def _angle_at(found: Prevertices, t: Float[Array, " n"], side: np.ndarray) -> Float[Array, " n"]:
    """Angle of the disc's points at a share t of the sides of the unit square, as they run."""
    zero = jnp.zeros_like(t)
    xi = jnp.stack([t, zero + 1, 1 - t, zero])[side, jnp.arange(len(t))]
    eta = jnp.stack([zero, t, zero + 1, 1 - t])[side, jnp.arange(len(t))]
    angle = jnp.angle(_to_disc(found, xi, eta))
    # From the first corner on, once around.
    first = np.pi - found.psi
    return first + (angle - first + 1e-9) % (2 * np.pi) - 1e-9


_LANDEN = 8


def _means(k: Array, other: Array) -> list[tuple[Array, Array]]:
    """Arithmetic-geometric means from 1 and sqrt(1 - k^2), with half their differences."""
    a, b, c = jnp.ones_like(k), other, k
    found = [(a, c)]
    for _ in range(_LANDEN):
        a, b, c = (a + b) / 2, jnp.sqrt(a * b), (a - b) / 2
        found.append((a, c))
    return found


def _quarter(k: Array, other: Array) -> Array:
    """K(k), the complete elliptic integral of the first kind; `other` is sqrt(1 - k^2)."""
    return np.pi / 2 / _means(k, other)[-1][0]


def _jacobi(u: Array, k: Array, other: Array) -> tuple[Array, Array, Array]:
    """sn, cn and dn of real u and modulus k (Abramowitz and Stegun 16.4)."""
    means = _means(k, other)
    phi = 2.0**_LANDEN * means[-1][0] * u
    for a, c in means[:0:-1]:
        phi = (phi + jnp.arcsin(jnp.clip(c / a * jnp.sin(phi), -1, 1))) / 2
    s, c = jnp.sin(phi), jnp.cos(phi)
    return s, c, jnp.sqrt(c**2 + (other * s) ** 2)


CHART = 65
"""Nodes each way of the lattice that a chart goes through."""


def chart(vertices: np.ndarray, corners: tuple[int, int, int, int]) -> tuple[NodeMap, float]:
    """The map of the unit square onto a polygon whose lines cross squarely, and its `error`.

    Cubic splines between nodes of the exact map; the sides are kept exactly. For polygons whose
    coordinates are known; `solve` and `rectangle_map` are what can be differentiated.

    - `vertices`: counter-clockwise, shape (n, 2), mm; `corners`: as for `solve`.
    """
    found, nodes, t = _solved(jnp.asarray(vertices), corners)
    places = np.linspace(0, 1, CHART)
    own = np.asarray(jnp.stack([found.vertices.real, found.vertices.imag], 1))
    lattice = np.asarray(nodes)
    at = (*np.asarray(found.corners).tolist(), len(own))
    walls = lattice[:, 0], lattice[-1], lattice[::-1, -1], lattice[0, ::-1]
    curves = []
    for wall, a, b in zip(walls, at, at[1:], strict=False):
        inner = np.asarray(t)[a + 1 : b]
        breaks = np.concatenate([places, inner])
        points = np.concatenate([wall, own[a + 1 : b]])
        order = np.argsort(breaks)
        order = order[np.diff(breaks[order], prepend=-1.0) > 1e-9]
        curves.append(polyline_at(breaks[order], points[order]))
    bottom, right, top, left = curves
    sides = Sides(bottom, right, top.reversed(), left.reversed())
    return NodeMap.through(nodes, sides, Spacings()), float(found.error)


@partial(jax.jit, static_argnums=1)
def _solved(
    vertices: Float[Array, "n 2"], corners: tuple[int, int, int, int]
) -> tuple[Prevertices, Array, Array]:
    """The prevertices, the chart's nodes, and where along its side each vertex lies, 0 to 1."""
    found = solve(vertices, corners)
    places = jnp.linspace(0, 1, CHART)
    nodes = rectangle_map(found, places[:, None], places[None])
    # A corner is where rounding in the disc would be magnified most.
    ends = np.array([0, -1, -1, 0]), np.array([0, 0, -1, -1])
    corner = found.vertices[found.corners]
    nodes = nodes.at[ends].set(jnp.stack([corner.real, corner.imag], -1))
    # By halving, along the side as it runs.
    count = len(vertices)
    at = [(c - corners[0]) % count for c in corners]
    side = np.searchsorted(at, np.arange(count), side="right") - 1

    def halved(_: int, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bounds
        middle = (low + high) / 2
        beyond = _angle_at(found, middle, side) > found.angle
        return jnp.where(beyond, low, middle), jnp.where(beyond, middle, high)

    low, high = jax.lax.fori_loop(0, 52, halved, (jnp.zeros(count), jnp.ones(count)))
    return found, nodes, (low + high) / 2
