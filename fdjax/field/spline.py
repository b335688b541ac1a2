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
        first, weights = self.local(places, derivative)
        result = np.zeros((len(places), self.count))
        np.put_along_axis(result, first[:, None] + np.arange(4), weights, 1)
        return result

    def local(self, places: Floats, derivative: int = 0) -> tuple[NDArray[np.intp], Floats]:
        """The first of the four splines that are not zero at each place, and `basis` of these."""
        scaled = (places - self.low) / self.step
        first = np.clip(np.floor(scaled).astype(int), 0, self.count - 4)
        f = (scaled - first)[:, None]
        weights = np.polynomial.polynomial.polyval(
            f,
            np.stack([_derived(piece, derivative) for piece in _PIECES], 1)[:, None],
            tensor=False,
        )
        return first, np.asarray(weights / self.step**derivative, float)

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
    """Splines on a lattice, (..., n, m, p), from coefficients (..., K, L, M) and a basis of each
    axis; those of x and y may be many, (..., 1, n, K).
    """
    xp = namespace(coefficients, x, y, z)
    planes = xp.moveaxis(xp.tensordot(coefficients, z.T, 1), -1, -3)
    return xp.moveaxis(x @ planes @ xp.swapaxes(y, -1, -2), -3, -1)


def scattered(
    coefficients: Floats, axes: tuple[Axis, Axis], xy: Floats, *orders: tuple[int, int]
) -> list[Floats]:
    """Splines (K, L, functions) at places (n, 2), derived so often along x and along y.

    One array (n, functions) for each of `orders`; (0, 0) is the value.

    >>> axis = Axis(0.0, 3.0, 6)
    >>> x = np.linspace(0, 3, 9)
    >>> rising = np.repeat(axis.fit(x) @ x[:, None], 6, 1)
    >>> at = scattered(rising[..., None], (axis, axis), np.array([[1.5, 0.2]]), (0, 0), (1, 0))
    >>> [each.round(6).tolist() for each in at]
    [[[1.5]], [[1.0]]]
    """
    made = [
        {order: axis.local(xy[:, k], order) for order in {each[k] for each in orders}}
        for k, axis in enumerate(axes)
    ]
    (row, _), (column, _) = (next(iter(each.values())) for each in made)
    beside = np.arange(4)
    near = coefficients[(row[:, None] + beside)[:, :, None], (column[:, None] + beside)[:, None]]
    # One axis after the other: what several derivatives share is summed once.
    many, functions = len(row), coefficients.shape[2:]
    near = near.reshape(many, 4, -1)
    along = {
        x: (weights[:, None] @ near).reshape(many, 4, -1) for x, (_, weights) in made[0].items()
    }
    return [(made[1][y][1][:, None] @ along[x]).reshape(many, *functions) for x, y in orders]
