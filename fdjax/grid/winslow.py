"""The elliptic grid equations of the paper, (5) to (7), on a lattice of nodes.

With central differences per index step,

    A (r_xx + phi r_x) + 2 B r_xe + C (r_ee + psi r_e) + J^2 (P r_x + Q r_e) = 0
    A = |r_e|^2,  B = -(r_x . r_e),  C = |r_x|^2,  J = det [r_x r_e]

where x and e stand for xi and eta. phi and psi are the controls of computational space; P and Q
those of physical space, lap(xi) = P and lap(eta) = Q, so that P = phi A / J^2, Q = psi C / J^2.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from fdjax.grid.base import norm


class ControlFunctions(NamedTuple):
    """Control functions per index step at the interior nodes, each of shape (ni - 2, nj - 2).

    One that is the same everywhere may be a scalar: solvers need not read it node by node. From
    values on the unit square: `phi / (ni - 1)`, `psi / (nj - 1)`, and P, Q multiplied by `ni - 1`,
    `nj - 1`.
    """

    phi: Float[Array, "i j"] | Float[Array, ""]
    psi: Float[Array, "i j"] | Float[Array, ""]
    p: Float[Array, "i j"] | Float[Array, ""]
    q: Float[Array, "i j"] | Float[Array, ""]


class _Differences(NamedTuple):
    xi: Float[Array, "i j 2"]
    eta: Float[Array, "i j 2"]
    xi_xi: Float[Array, "i j 2"]
    eta_eta: Float[Array, "i j 2"]
    xi_eta: Float[Array, "i j 2"]


def _differences(r: Float[Array, "ni nj 2"]) -> _Differences:
    centre = r[1:-1, 1:-1]
    east, west, north, south = r[2:, 1:-1], r[:-2, 1:-1], r[1:-1, 2:], r[1:-1, :-2]
    return _Differences(
        (east - west) / 2,
        (north - south) / 2,
        east - 2 * centre + west,
        north - 2 * centre + south,
        (r[2:, 2:] - r[:-2, 2:] - r[2:, :-2] + r[:-2, :-2]) / 4,
    )


def _dot(a: Float[Array, "... 2"], b: Float[Array, "... 2"]) -> Float[Array, "... 1"]:
    return (a * b).sum(-1, keepdims=True)


def _jacobian(d: _Differences) -> Float[Array, "i j 1"]:
    return d.xi[..., :1] * d.eta[..., 1:] - d.xi[..., 1:] * d.eta[..., :1]


def residual(r: Float[Array, "ni nj 2"], controls: ControlFunctions) -> Float[Array, "i j 2"]:
    """Left side of the equations at the interior nodes of the lattice `r`, mm^3."""
    d = _differences(r)
    phi, psi, p, q = (field[..., None] for field in controls)
    return (
        _dot(d.eta, d.eta) * (d.xi_xi + phi * d.xi)
        - 2 * _dot(d.xi, d.eta) * d.xi_eta
        + _dot(d.xi, d.xi) * (d.eta_eta + psi * d.eta)
        + _jacobian(d) ** 2 * (p * d.xi + q * d.eta)
    )


def correction(r: Float[Array, "ni nj 2"], controls: ControlFunctions) -> Float[Array, "i j 2"]:
    """The Gauss-Seidel correction of each interior node, mm: residual over 2 (A + C)."""
    d = _differences(r)
    return residual(r, controls) / (2 * (_dot(d.eta, d.eta) + _dot(d.xi, d.xi)))


def boundary_controls(r: Float[Array, "ni nj 2"]) -> tuple[Array, Array]:
    """phi and psi per index step that carry the sides' spacing into the interior.

    On each side phi = -(r_x . r_xx) / |r_x|^2, which makes the side's own spacing a solution along
    it, and linear in between (Thomas and Middlecoff, AIAA Journal 18(6), 1980); psi likewise.
    Shapes (ni - 2, nj - 2).
    """

    def along(side: Float[Array, "n 2"]) -> Float[Array, " n"]:
        first = (side[2:] - side[:-2]) / 2
        second = side[2:] - 2 * side[1:-1] + side[:-2]
        return -(first * second).sum(-1) / norm(first) ** 2

    f = jnp.linspace(0, 1, r.shape[0])[1:-1, None]
    g = jnp.linspace(0, 1, r.shape[1])[None, 1:-1]
    phi = (1 - g) * along(r[:, 0])[:, None] + g * along(r[:, -1])[:, None]
    psi = (1 - f) * along(r[0])[None] + f * along(r[-1])[None]
    return phi, psi
