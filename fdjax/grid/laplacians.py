"""The Laplacians of xi and eta of a lattice of nodes, whatever map it is of."""

from typing import Any

from fdjax.arrays import namespace


def laplacians(r: Any) -> tuple[Any, Any]:
    """P = lap(xi) and Q = lap(eta) of eq. (5) at inner nodes, each (ni - 2, nj - 2), 1/mm^2.

    - `r`: nodes at equal steps of the unit square, shape (ni, nj, 2), mm; NumPy or JAX.

    By central differences: from A r_xixi + 2 B r_xieta + C r_etaeta, less its share along xi and
    along eta, eqs. (5) to (7). Not finite where the grid folds flat.

    >>> import numpy as np
    >>> xi, eta = np.meshgrid(np.linspace(0, 1, 101), np.linspace(0, 1, 5), indexing="ij")
    >>> p, q = laplacians(np.stack([(1 + xi) ** 2, eta], -1))
    >>> bool(np.allclose(p[:, 0], -1 / (4 * (1 + xi[1:-1, 0]) ** 3))), float(np.abs(q).max())
    (True, 0.0)
    """
    xp = namespace(r)
    ni, nj = r.shape[0] - 1, r.shape[1] - 1
    xi, eta = (r[2:, 1:-1] - r[:-2, 1:-1]) * ni / 2, (r[1:-1, 2:] - r[1:-1, :-2]) * nj / 2
    middle = 2 * r[1:-1, 1:-1]
    xi_xi = (r[2:, 1:-1] - middle + r[:-2, 1:-1]) * ni**2
    eta_eta = (r[1:-1, 2:] - middle + r[1:-1, :-2]) * nj**2
    xi_eta = (r[2:, 2:] - r[2:, :-2] - r[:-2, 2:] + r[:-2, :-2]) * ni * nj / 4
    a, b, c = (eta**2).sum(-1), -(xi * eta).sum(-1), (xi**2).sum(-1)
    jacobian = xi[..., 0] * eta[..., 1] - xi[..., 1] * eta[..., 0]
    rest = a[..., None] * xi_xi + 2 * b[..., None] * xi_eta + c[..., None] * eta_eta
    to_xi = rest[..., 0] * eta[..., 1] - rest[..., 1] * eta[..., 0]
    to_eta = rest[..., 1] * xi[..., 0] - rest[..., 0] * xi[..., 1]
    scale = xp.where(jacobian == 0, xp.nan, jacobian) ** 3
    return -to_xi / scale, -to_eta / scale
