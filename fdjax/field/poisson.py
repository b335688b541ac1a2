"""Functions with a given Laplacian, as tensor-product splines: `lap(xi) = P` of the paper's (5)."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.arrays import namespace
from fdjax.errors import InputError
from fdjax.field.spline import Axis

Floats = NDArray[np.float64]


class Poisson(NamedTuple):
    """`lap(u) = P` over a box with given values on its rim, by Galerkin's method.

    Data are arrays (K, L, M) of the shape of u's coefficients: the rim holds what u is on the box's
    sides, as splines along them, and the inside holds the coefficients of P (1/mm^2), splines of
    K - 2 and L - 2. Each plane along z is solved by itself. The system is separable: the
    eigenvectors of its two axes solve it exactly, so u is linear in the data and its derivative
    is the same solve.
    """

    blend: tuple[Any, Any]
    modes: tuple[Any, Any]
    inverse: Any
    stiffness: tuple[Any, Any]
    mass: tuple[Any, Any]
    source: tuple[Any, Any]
    values: tuple[Any, Any]
    to_source: tuple[Any, Any]

    @classmethod
    def over(cls, x: Axis, y: Axis) -> "Poisson":
        """The solver for these axes. Raises `InputError` for fewer than 6 coefficients."""
        if min(x.count, y.count) < 6:
            raise InputError("knots: P and Q need at least 6 coefficients along x and y")
        parts = [_axis(axis) for axis in (x, y)]
        columns = {name: tuple(part[name] for part in parts) for name in parts[0]}
        rates = columns.pop("rates")
        return cls(inverse=1 / (rates[0][:, None] + rates[1][None]), **columns)

    def coefficients(self, data: Any) -> Any:
        """Coefficients (K, L, M) of u."""
        xp = namespace(data)
        rim = xp.asarray(data) * _rim(data.shape)[..., None]
        # With rim values alone and nothing inside, what the equations are short of.
        load = _both(xp, self.stiffness[0], rim, self.mass[1])
        load = load + _both(xp, self.mass[0], rim, self.stiffness[1])
        load = load + _both(xp, self.source[0], data[1:-1, 1:-1], self.source[1])
        x, y = self.modes
        inner = self.inverse[..., None] * _both(xp, x.T, load, y.T)
        inner = _both(xp, x, inner, y)
        whole = rim - xp.pad(inner, ((1, 1), (1, 1), (0, 0)))
        return _both(xp, self.blend[0], whole, self.blend[1])

    def data(self, coefficients: Floats) -> Floats:
        """Data whose u is, as nearly as their splines allow, that of these coefficients."""
        result = _both(np, self.values[0], coefficients, self.values[1])
        inner = _both(np, self.to_source[0][1], coefficients, self.to_source[1][0])
        inner = inner + _both(np, self.to_source[0][0], coefficients, self.to_source[1][1])
        result[1:-1, 1:-1] = inner
        return result


def _both(xp: Any, x: Any, values: Any, y: Any) -> Any:
    """A matrix applied along x and one along y."""
    return xp.einsum("ajm,bj->abm", xp.einsum("ai,ijm->ajm", x, values), y)


def _rim(shape: tuple[int, ...]) -> Floats:
    rim = np.ones(shape[:2])
    rim[1:-1, 1:-1] = 0
    return rim


def _axis(axis: Axis) -> dict[str, Any]:
    count = axis.count
    # Values at both ends in place of the first and the last coefficient.
    values = np.eye(count)
    ends = axis.basis(np.array([axis.low, axis.high]))
    values[[0, -1]] = ends
    blend = np.linalg.inv(values)
    node, weight = np.polynomial.legendre.leggauss(4)
    knots = np.linspace(axis.low, axis.high, count - 2)
    places = (knots[:-1, None] + axis.step * (node + 1) / 2).ravel()
    weights = np.tile(weight * axis.step / 2, count - 3)
    sources = Axis(axis.low, axis.high, count - 2)
    basis, slope = axis.basis(places) @ blend, axis.basis(places, 1) @ blend
    inner = slice(1, -1)
    mass = (basis.T * weights) @ basis
    stiffness = (slope.T * weights) @ slope
    root = np.linalg.cholesky(mass[inner, inner])
    whitened = np.linalg.solve(root, np.linalg.solve(root, stiffness[inner, inner]).T)
    rates, vectors = np.linalg.eigh((whitened + whitened.T) / 2)
    fit = sources.fit(places)
    return {
        "blend": blend,
        "modes": np.linalg.solve(root.T, vectors),
        "rates": rates,
        "stiffness": stiffness[inner],
        "mass": mass[inner],
        "source": (basis[:, inner].T * weights) @ sources.basis(places),
        "values": values,
        "to_source": (fit @ axis.basis(places), fit @ axis.basis(places, 2)),
    }
