"""Conformal maps of rings: Schwarz-Christoffel from an annulus onto a polygon with one hole.

With `w = exp(s)` in the annulus `exp(-span) < |w| < 1`, prevertices `s_k` on its two circles and
interior angles `pi (p_k + 1)` of the region,

    dz/ds = C exp(-s) prod_k theta_1((s - s_k) / 2i)^p_k,  nome exp(-span)

(Komatu, Proc. Japan Acad. 21, 1945; Henrici, Applied and Computational Complex Analysis III,
section 17.5). The parameter problem asks for the prevertices and the span, the modulus.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Complex, Float, Int

from fdjax.grid.conformal import FROM_END, FROM_START, WEIGHT
from fdjax.grid.theta import log_size, log_theta
from fdjax.precision import require_float64

PANELS = 384
"""About how many pieces the walls are cut into for a first guess."""


EVERY = 3
"""Of the quadrature's places, on ways that keep off all prevertices but the first."""


class Ring(NamedTuple):
    """The solved parameter problem of an outline, vertices o_k, and a hole h_k, counter-clockwise.

    - `angle`: of the prevertices, radians, those of the outline first, rising from 0 within a
      turn, then those of the hole, rising; shape (m + n,).
    - `span`: logarithm of the ratio of the annulus' radii.
    - `power`: p_k, shape (m + n,); `vertices`: shape (m + n,); `scale`: C.
    - `error`: by how much sides and ways across, of which the problem does not ask, come out
      wrong, over the outline's size.
    """

    angle: Float[Array, " n"]
    span: Float[Array, ""]
    power: Float[Array, " n"]
    vertices: Complex[Array, " n"]
    scale: Complex[Array, ""]
    error: Float[Array, ""]


def solve(outline: Float[Array, "m 2"], hole: Float[Array, "n 2"]) -> Ring:
    """The prevertices of a ring, both walls counter-clockwise.

    Raises nothing for a ring that it does not reach: `error` says it. Differentiable in the
    vertices by the implicit function theorem.
    """
    require_float64()
    m, n = len(outline), len(hole)
    w = jnp.concatenate([outline, hole]) @ jnp.array([1, 1j])
    outer = np.arange(m + n) < m
    following = _after(m, m + n)
    before = np.argsort(following)
    side = w[following] - w
    turn = jnp.angle(side / side[before])
    power = jnp.where(outer, -turn, turn) / np.pi
    length = jnp.abs(side)
    free = jax.lax.stop_gradient(_first(w, power, m))
    # Two sides of the hole that meet at an angle follow from all others.
    apex = jnp.argmax(jnp.abs(jnp.sin(turn[m:])))
    asked = jnp.append(np.arange(m), m + (apex + 1 + np.arange(n - 2)) % n)
    angle = _angles(free, m)[0]
    ways = _ways(angle, m)

    def residual(free: Array, given: tuple) -> Array:
        w, side, power, length, asked, ways = given
        angle, span, level = _angles(free, m)
        sizes = jnp.log(_side_integrals(angle, span, power, m) / length) + level
        scale = _scale(angle, span, power, level, side, m)
        middle = -span + 1j * (angle[m] + angle[m + 1]) / 2
        slope = scale * 1j * _slope(middle, angle, span, power, m)
        across = scale * _across(ways[0], angle, span, power, m)
        off = (across - (w[ways[0, 1]] - w[ways[0, 0]])) / length[:m].sum()
        leaning = jnp.angle(slope / side[m])
        return jnp.concatenate([sizes[asked], jnp.stack([leaning, off.real, off.imag])])

    given = (w, side, power, length, asked, ways)
    found = optx.root_find(
        residual,
        optx.Dogleg(rtol=1e-12, atol=1e-12),
        free,
        args=given,
        max_steps=60,
        throw=False,
    )
    angle, span, level = _angles(found.value, m)
    scale = _scale(angle, span, power, level, side, m)
    # What was not asked for.
    sizes = jnp.exp(level) * _side_integrals(angle, span, power, m) - length
    gaps = [scale * _across(way, angle, span, power, m) - (w[way[1]] - w[way[0]]) for way in ways]
    error = jnp.maximum(jnp.abs(sizes).max(), jnp.abs(jnp.stack(gaps)).max())
    return Ring(angle, span, power, w, scale, error / jnp.ptp(w.real))


def ring_map(
    found: Ring, m: int, xi: Float[Array, "..."], eta: Float[Array, "..."]
) -> Float[Array, "... 2"]:
    """Points of the ring at (xi, eta): xi runs from the hole outwards, eta once around.

    - `m`: how many of the vertices are the outline's; eta = 0 at the first of these.
    """
    xi, eta = jnp.broadcast_arrays(xi, eta)
    shape = xi.shape
    own = _places(found.angle, found.span, m)
    start, weight = FROM_START[::EVERY], EVERY * WEIGHT[::EVERY]

    def one(place: Array) -> Array:
        turns = jnp.round((place - own).imag / (2 * np.pi))
        ways = place - 2j * np.pi * turns - own
        k = jnp.argmin(jnp.abs(ways))
        along = ways[k]
        # At a prevertex itself the way has no length.
        safe = jnp.where(along == 0, 1.0, along)
        s = own[k] + safe * start
        apart = (s[:, None] - own).at[:, k].set(safe * start)
        way = _integral(s, along, apart, found.span, found.power, m, weight)
        return found.vertices[k] + found.scale * way

    places = -found.span * (1 - xi.ravel()) + 2j * np.pi * eta.ravel()
    z = jax.lax.map(one, places, batch_size=256).reshape(shape)
    return jnp.stack([z.real, z.imag], -1)


def _angles(free: Array, m: int) -> tuple[Array, Array, Array]:
    """Angles of the prevertices, the span, and the logarithm of |C|."""
    count = len(free) - 1
    walls = []
    for logs in (free[: m - 1], free[m - 1 : count - 2]):
        gap = 2 * np.pi * jax.nn.softmax(jnp.append(0.0, logs))
        walls.append(jnp.cumsum(gap) - gap)
    turn, span, level = free[-3:]
    return jnp.concatenate([walls[0], turn + walls[1]]), jnp.exp(span), level


def _side_integrals(angle: Array, span: Array, power: Array, m: int) -> Float[Array, " n"]:
    """int |dz| between neighbouring prevertices along both circles, for |C| = 1."""
    return _gaps(angle, m) * (jnp.exp(_along(angle, span, power, m)) @ WEIGHT)


def _gaps(angle: Array, m: int) -> Array:
    """From each prevertex to the next one of its wall."""
    walls = angle[:m], angle[m:]
    return jnp.concatenate([jnp.diff(wall, append=wall[:1] + 2 * np.pi) for wall in walls])


def _along(angle: Array, span: Array, power: Array, m: int) -> Array:
    """log |dz/ds| for |C| = 1 at the quadrature's places of each side, shape (m + n, NODES)."""
    outer = np.arange(len(angle)) < m
    logs = _sums(m, angle, _gaps(angle, m), span, power)
    return logs + jnp.where(outer, 0.0, span)[:, None]


def _sizes(m: int, angle: Array, gap: Array, span: Array) -> tuple[Array, Array, Array]:
    """log |theta_1| from the places of each side to all prevertices, its slopes in the place around
    and in the span; those in the place that come from the side's own ends are for a place that
    moves from there by as much as it is away.
    """
    count = len(angle)
    here, after = np.arange(count), _after(m, count)
    outer = here < m
    apart = (angle[:, None] + gap[:, None] * FROM_START)[..., None] - angle
    # From a side's ends exactly.
    apart = apart.at[here, :, here].set(gap[:, None] * FROM_START)
    apart = apart.at[here, :, after].set(-gap[:, None] * FROM_END)
    same = (outer[:, None] == outer)[:, None]
    size, along = jax.jvp(lambda a: log_size(a, span, same=same), (apart,), (jnp.ones_like(apart),))
    _, by_span = jax.jvp(lambda t: log_size(apart, t, same=same), (span,), (jnp.ones_like(span),))
    ends = np.zeros((count, 1, count), bool)
    ends[here, :, here] = ends[here, :, after] = True
    return size, jnp.where(ends, along * apart, along), by_span


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _sums(m: int, angle: Array, gap: Array, span: Array, power: Array) -> Array:
    return _sizes(m, angle, gap, span)[0] @ power


@_sums.defjvp
def _sums_jvp(m: int, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    """Slopes of all terms are worked out once, however many tangents there are."""
    angle, gap, span, power = primals
    angle_dot, gap_dot, span_dot, power_dot = tangents
    size, along, by_span = _sizes(m, angle, gap, span)
    here, after = np.arange(len(angle)), _after(m, len(angle))
    along = along * power
    ends = along[here, :, here] + along[here, :, after]
    along = along.at[here, :, here].set(0.0).at[here, :, after].set(0.0)
    moved = angle_dot[:, None] + gap_dot[:, None] * FROM_START
    change = along.sum(-1) * moved - along @ angle_dot + ends * (gap_dot / gap)[:, None]
    return size @ power, change + (by_span @ power) * span_dot + size @ power_dot


def _after(m: int, count: int) -> np.ndarray:
    """The next vertex of the same wall."""
    return np.append((np.arange(m) + 1) % m, m + (np.arange(count - m) + 1) % (count - m))


def _slope(s: Array, angle: Array, span: Array, power: Array, m: int) -> Array:
    """dz/ds for C = 1 at places of the strip."""
    outer = jnp.arange(len(angle)) < m
    logs = log_theta(s[..., None] - _places(angle, span, m), span, outer=outer)
    return jnp.exp(logs @ power.astype(complex) - s)


def _scale(
    angle: Array, span: Array, power: Array, level: Array, side: Array, m: int
) -> Complex[Array, ""]:
    """C: its argument puts the outline's first side where it is."""
    slope = 1j * _slope(1j * (angle[0] + angle[1]) / 2, angle, span, power, m)
    turn = side[0] / slope
    return jnp.exp(level) * turn / jnp.abs(turn)


def _across(way: Array, angle: Array, span: Array, power: Array, m: int) -> Complex[Array, ""]:
    """int dz for C = 1 from a prevertex of the outline straight to one of the hole."""
    a, b = way
    turn = angle[b] - angle[a]
    turns = jnp.round(turn / (2 * np.pi))
    along = -span + 1j * (turn - 2 * np.pi * turns)
    s = 1j * angle[a] + along * FROM_START
    apart = s[:, None] - _places(angle, span, m)
    # From the prevertices themselves exactly; whole turns are not to be lost.
    apart = apart.at[:, a].set(along * FROM_START)
    apart = apart.at[:, b].set(-along * FROM_END - 2j * np.pi * turns)
    return _integral(s, along, apart, span, power, m, WEIGHT)


def _places(angle: Array, span: Array, m: int) -> Complex[Array, " n"]:
    """The prevertices s_k."""
    return jnp.where(np.arange(len(angle)) < m, 0.0, -span) + 1j * angle


def _integral(
    s: Array, along: Array, apart: Array, span: Array, power: Array, m: int, weight: np.ndarray
) -> Array:
    """int dz for C = 1 on a straight way `along` with the quadrature's places `s`."""
    outer = np.arange(len(power)) < m
    logs = log_theta(apart, span, outer=jnp.asarray(outer)) @ power.astype(complex)
    return along * (weight @ jnp.exp(logs - s))


def _ways(angle: Array, m: int) -> Int[Array, "2 2"]:
    """Two pairs of prevertices, of the outline and of the hole, that lie near each other around."""
    apart = jnp.abs(jnp.angle(jnp.exp(1j * (angle[m:] - angle[:m, None]))))
    n = apart.shape[1]
    a, b = jnp.divmod(jnp.argmin(apart), n)
    others = apart.at[a].set(np.inf).at[:, b].set(np.inf)
    return jnp.stack(
        [jnp.stack([i, m + j]) for i, j in ((a, b), jnp.divmod(jnp.argmin(others), n))]
    )


def _first(w: Array, power: Array, m: int) -> Array:
    """Free numbers to start from: those of a condenser whose walls carry even charges in pieces.

    log |f| is the potential of a unit charge on the hole and its negative on the outline; a
    wall's angle is the charge up to there.
    """
    count = len(w)
    pieces = max(4, PANELS // count)
    share = (1 - np.cos(np.pi * np.arange(pieces + 1) / pieces)) / 2
    after = _after(m, count)
    edge = w[:, None] + (w[after] - w)[:, None] * share
    start, end = edge[:, :-1].ravel(), edge[:, 1:].ravel()
    sign = jnp.where(np.arange(len(start)) < m * pieces, -1.0, 1.0)
    middle, way = (start + end) / 2, (end - start) / jnp.abs(end - start)

    def from_end(end: Array) -> Array:
        z = (middle[:, None] - end) / way
        return z * jnp.log(z)

    potential = (from_end(start) - from_end(end)).real - jnp.abs(end - start)
    inner = sign > 0
    # Charges an area, the level of the potential, and the span.
    size = jnp.abs(end - start)
    rows = [
        jnp.concatenate([potential * sign, jnp.ones((len(sign), 1)), inner[:, None] * 1.0], 1),
        jnp.stack([jnp.concatenate([size * wall, jnp.zeros(2)]) for wall in (~inner, inner)]),
    ]
    found = jnp.linalg.solve(jnp.concatenate(rows), jnp.append(jnp.zeros(len(sign)), jnp.ones(2)))
    charge = jnp.maximum(found[:-2] * size, 1e-12).reshape(count, pieces)
    gap = charge.sum(1)
    # How far the hole is turned: along the shortest way across, less its ends.
    apart = jnp.where(~inner[:, None] & inner, jnp.abs(middle[:, None] - middle), np.inf)
    a, b = jnp.divmod(jnp.argmin(apart), len(sign))
    low, high = (middle[a] + t * (middle[b] - middle[a]) for t in (0.05, 0.95))
    turn = (sign * charge.ravel() * jnp.angle((high - middle) / (low - middle))).sum()
    begun = jnp.cumsum(charge.ravel()) - charge.ravel() / 2
    turn += 2 * np.pi * (begun[a] - (begun[b] - gap[:m].sum()))
    turn -= 2 * np.pi * jnp.round(turn / (2 * np.pi))
    logs = [jnp.log(wall[1:] / wall[0]) for wall in (gap[:m], gap[m:])]
    free = jnp.concatenate([*logs, jnp.stack([turn, jnp.log(found[-1]), 0.0])])
    angle, span, _ = _angles(free, m)
    level = jnp.log(jnp.abs(w[after] - w) / _side_integrals(angle, span, power, m))
    return free.at[-1].set(level.mean())
