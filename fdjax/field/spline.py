"""Functions of the place as tensor products of uniform cubic B-splines over a box.

Along each axis K coefficients span K - 3 equal intervals; one coefficient means a constant. All
is linear in the coefficients and twice continuously differentiable in the place.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdjax.arrays import namespace
from fdjax.errors import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Axis:
    """One axis of the box, from `low` to `high` (mm), with `count` coefficients: 1, or 4 and more.

    >>> Axis(0.0, 6.0, 5).basis(np.array([0.0, 3.0])).round(3).tolist()
    [[0.167, 0.667, 0.167, 0.0, 0.0], [0.0, 0.167, 0.667, 0.167, 0.0]]
    """

    low: float
    high: float
    count: int

    def __post_init__(self) -> None:
        if not self.high > self.low:
            raise InputError(f"axis: from {self.low:g} to {self.high:g} mm is no interval")
        if self.count != 1 and self.count < 4:
            raise InputError(f"knots: {self.count} coefficients; 1, or 4 and more")

    @property
    def step(self) -> float:
        """Distance of the knots, mm."""
        return (self.high - self.low) / max(self.count - 3, 1)

    def basis(self, places: Floats, derivative: int = 0) -> Floats:
        """Values, or a `derivative` of up to 3, of each spline at `places` (n,): (n, count)."""
        places = np.asarray(places, float)
        if self.count == 1:
            return np.full((len(places), 1), float(derivative == 0))
        scaled = (places - self.low) / self.step
        first = np.clip(np.floor(scaled).astype(int), 0, self.count - 4)
        f = (scaled - first)[:, None]
        weights = np.polynomial.polynomial.polyval(
            f,
            np.stack([_derived(piece, derivative) for piece in _PIECES], 1)[:, None],
            tensor=False,
        )
        result = np.zeros((len(places), self.count))
        np.put_along_axis(result, first[:, None] + np.arange(4), weights, 1)
        return np.asarray(result / self.step**derivative)

    def fit(self, places: Floats) -> Floats:
        """Matrix (count, n) from values at `places` (n,) to the coefficients that fit them best."""
        return np.asarray(np.linalg.pinv(self.basis(places)), float)


_PIECES = (
    np.array([1.0, -3.0, 3.0, -1.0]) / 6,
    np.array([4.0, 0.0, -6.0, 3.0]) / 6,
    np.array([1.0, 3.0, 3.0, -3.0]) / 6,
    np.array([0.0, 0.0, 0.0, 1.0]) / 6,
)
"""The four pieces of a cubic B-spline, from its right to its left, as powers of the place."""


def _derived(piece: Floats, times: int) -> Floats:
    derived = np.polynomial.polynomial.polyder(piece, times) if times else piece
    return np.asarray(np.pad(derived, (0, 4 - len(derived))), float)


def product(coefficients: Any, x: Any, y: Any, z: Any) -> Any:
    """The spline on a lattice, (n, m, p), from coefficients (K, L, M) and a basis of each axis."""
    xp = namespace(coefficients, x, y, z)
    rows = xp.tensordot(x, coefficients, 1)
    along_y = xp.tensordot(xp.swapaxes(rows, 1, 2), y.T, 1)
    return xp.tensordot(xp.swapaxes(along_y, 1, 2), z.T, 1)
