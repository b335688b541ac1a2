"""Measures of a grid's quality, as mesh generators give them; differentiable.

Angles are those between the two sides that meet at each corner of each cell (after Knupp, SIAM J.
Sci. Comput. 23(1), 2001, for the scaled Jacobian).
"""

from typing import Any, NamedTuple

from fdjax.arrays import namespace


class Quality(NamedTuple):
    """Quality of a lattice of nodes.

    - `scaled_jacobian`: least sine of a corner's angle, 1 at best, 0 or less where a cell folds.
    - `inverted`: cells with a corner that is not convex.
    - `angle_mean`, `angle_worst`: |90 - angle| of the corners, degrees.
    - `skew`: largest equiangle skew of a cell, 0 at best to 1.
    - `aspect`: largest ratio of a cell's mean sides, the longer to the shorter, 1 at best.
    - `growth`: largest ratio of neighbouring steps along a line, 1 at best.
    """

    scaled_jacobian: Any
    inverted: Any
    angle_mean: Any
    angle_worst: Any
    skew: Any
    aspect: Any
    growth: Any


def quality(r: Any) -> Quality:
    """Quality of the lattice r, shape (ni, nj, 2), at least 2 x 2; NumPy or JAX.

    Differentiable but for `inverted`, where no two nodes coincide.

    >>> import numpy as np
    >>> square = np.stack(np.meshgrid([0.0, 1.0, 3.0], [0.0, 1.0], indexing="ij"), -1)
    >>> [float(value) for value in quality(square)]
    [1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 2.0]
    """
    xp = namespace(r)
    a, b, c, d = r[:-1, :-1], r[1:, :-1], r[1:, 1:], r[:-1, 1:]
    corners = [(b - a, d - a), (c - b, a - b), (d - c, b - c), (a - d, c - d)]
    sines, angles = [], []
    for u, v in corners:
        cross = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        inner = (u * v).sum(-1)
        sines.append(cross / xp.sqrt(cross**2 + inner**2))
        angles.append(xp.degrees(xp.arctan2(cross, inner)))
    sine, off = xp.stack(sines), xp.abs(90 - xp.stack(angles))
    along_xi, along_eta = _lengths(xp, r[1:] - r[:-1]), _lengths(xp, r[:, 1:] - r[:, :-1])
    wide, high = along_xi[:, 1:] + along_xi[:, :-1], along_eta[1:] + along_eta[:-1]
    steps = [along_xi[1:] / along_xi[:-1], along_eta[:, 1:] / along_eta[:, :-1]]
    growth = [xp.maximum(each, 1 / each).max() for each in steps if each.size]
    return Quality(
        scaled_jacobian=sine.min(),
        inverted=(sine.min(0) <= 0).sum(),
        angle_mean=off.mean(),
        angle_worst=off.max(),
        skew=xp.minimum(off / 90, 1.0).max(),
        aspect=xp.maximum(wide / high, high / wide).max(),
        growth=xp.stack(growth).max() if growth else xp.ones(()),
    )


def _lengths(xp: Any, steps: Any) -> Any:
    return xp.sqrt((steps**2).sum(-1))
