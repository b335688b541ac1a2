"""Parametrised plane curves as piecewise cubics; evaluated on NumPy or JAX arrays alike."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fdjax.arrays import namespace
from fdjax.errors import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve over the parameter s in [0, 1], cubic between its breaks.

    - `breaks`: shape (pieces + 1,), rising from 0 to 1.
    - `coefficients`: shape (pieces, 4, 2); piece k is `sum_p coefficients[k, p] (s - breaks[k])^p`,
      in mm.
    - `corners`: whether the curve is a polyline, with kinks at its breaks.
    """

    breaks: Floats
    coefficients: Floats
    corners: bool = False

    def __call__(self, s: Any) -> Any:
        """Points at the parameters `s` (any shape, in [0, 1]), shape s.shape + (2,), mm.

        Differentiable in s; for polylines with kinks at the breaks.
        """
        xp = namespace(s, self.breaks)
        s = xp.asarray(s)
        breaks, coefficients = xp.asarray(self.breaks), xp.asarray(self.coefficients)
        if len(self.breaks) == 2:
            piece = 0
        else:
            piece = xp.searchsorted(breaks, s, side="right") - 1
            piece = xp.clip(piece, 0, len(self.breaks) - 2)
        t = (s - breaks[piece])[..., None]
        c = coefficients[piece]
        return ((c[..., 3, :] * t + c[..., 2, :]) * t + c[..., 1, :]) * t + c[..., 0, :]

    @property
    def start(self) -> Floats:
        return self(np.array(0.0))

    @property
    def end(self) -> Floats:
        return self(np.array(1.0))

    def reversed(self) -> "Curve":
        """The same curve run from its end to its start."""
        h = np.diff(self.breaks)[:, None]
        a, b, c, d = np.moveaxis(self.coefficients, 1, 0)
        flipped = [a + h * (b + h * (c + h * d)), -(b + h * (2 * c + 3 * h * d)), c + 3 * h * d, -d]
        return Curve(1 - self.breaks[::-1], np.stack(flipped, 1)[::-1], self.corners)

    def polyline(self, pieces: int | None = None) -> Floats:
        """Points along the curve, both ends included, shape (n, 2), mm.

        A polyline gives its own points. Any other curve is cut into `pieces` chords between two
        breaks, or by default into so many that none leaves the curve by more than 3e-7 of the
        curve's size (the area of a circle is then right to 1e-6).
        """
        if self.corners:
            return self(self.breaks)
        h = np.diff(self.breaks)
        counts = self._chord_counts() if pieces is None else np.full(len(h), pieces)
        first = np.repeat(np.cumsum(counts) - counts, counts)
        share = (np.arange(counts.sum()) - first) / np.repeat(counts, counts)
        s = np.repeat(self.breaks[:-1], counts) + np.repeat(h, counts) * share
        return self(np.append(s, 1.0))

    @property
    def length(self) -> float:
        """Of its `polyline`, mm.

        >>> polyline([(0, 0), (3, 0), (3, 1)]).length
        4.0
        """
        return float(np.hypot(*np.diff(self.polyline(), axis=0).T).sum())

    def _chord_counts(self) -> NDArray[np.int64]:
        """Chords a piece, from the sag of a chord over dt: at most dt^2 max|r''| / 8."""
        h = np.diff(self.breaks)
        sag = 3e-7 * np.ptp(self(self.breaks), axis=0).max()
        at_start = 2 * self.coefficients[:, 2]
        at_end = at_start + 6 * self.coefficients[:, 3] * h[:, None]
        bend = np.maximum(np.hypot(*at_start.T), np.hypot(*at_end.T))
        return np.maximum(1, np.ceil(h * np.sqrt(bend / (8 * sag)))).astype(np.int64)


def polyline(points: ArrayLike) -> Curve:
    """The polyline through `points`, shape (n, 2), mm, parametrised by arc length.

    Raises `InputError` for fewer than two points, repeated points or values not finite.

    >>> polyline([(0, 0), (3, 0), (3, 1)])(0.75).tolist()
    [3.0, 0.0]
    """
    xy = as_points(points, "polyline")
    return polyline_at(_chords(xy, "polyline"), xy)


def polyline_at(breaks: Floats, xy: Floats) -> Curve:
    """The polyline that is at the points `xy`, (n, 2), mm, at `breaks`, n rising from 0 to 1."""
    coefficients = np.zeros((len(xy) - 1, 4, 2))
    coefficients[:, 0] = xy[:-1]
    coefficients[:, 1] = np.diff(xy, axis=0) / np.diff(breaks)[:, None]
    return Curve(breaks, coefficients, corners=True)


def spline(points: ArrayLike, parameters: ArrayLike | None = None) -> Curve:
    """The cubic spline through `points`, shape (n, 2), mm.

    `parameters` (n rising values) says at which s each point lies, by default at its share of the
    chord length. End conditions are "not a knot" from four points on, so cubics are reproduced;
    natural below. Raises `InputError` for points or parameters that cannot be used.

    >>> spline([(0, 0), (1, 1), (2, 0)])(0.5).tolist()
    [1.0, 1.0]
    """
    xy = as_points(points, "spline")
    if parameters is None:
        breaks = _chords(xy, "spline")
    else:
        breaks = np.asarray(parameters, float)
        # written so that NaN fails too
        if breaks.shape != (len(xy),) or not (np.diff(breaks) > 0).all():
            raise InputError(f"spline: needs {len(xy)} rising parameters, one a point")
        breaks = (breaks - breaks[0]) / (breaks[-1] - breaks[0])
    return _hermite(breaks, xy, _spline_slopes(breaks, xy))


def arc(start: ArrayLike, through: ArrayLike, end: ArrayLike) -> Curve:
    """The circular arc from `start` by `through` to `end`, mm, parametrised by its angle.

    As cubics that leave the circle by less than 1e-9 of its radius. Raises `InputError`
    when the three points lie on one line, or the arc ends where it starts.
    """
    a, b, c = (as_point(p, "arc") for p in (start, through, end))
    ab, ac = b - a, c - a
    if (a == c).all():
        raise InputError(f"arc: ends where it starts, at {_at(a)}; a full circle is two arcs")
    cross = 2 * (ab[0] * ac[1] - ab[1] * ac[0])
    if abs(cross) < 1e-12 * (ab @ ab + ac @ ac):
        raise InputError(f"arc: {_at(a)}, {_at(b)} and {_at(c)} lie on one line; use a polyline")
    centre = a + np.array([ac[1] * (ab @ ab) - ab[1] * (ac @ ac),
                           ab[0] * (ac @ ac) - ac[0] * (ab @ ab)]) / cross  # fmt: skip
    radius = float(np.hypot(*(a - centre)))
    angles = [np.arctan2(*(p - centre)[::-1]) for p in (a, b, c)]
    sweep = (angles[2] - angles[0]) % (2 * np.pi)
    if (angles[1] - angles[0]) % (2 * np.pi) > sweep:
        sweep -= 2 * np.pi
    s = np.linspace(0, 1, int(np.ceil(abs(sweep) / 0.02)) + 1)
    theta = angles[0] + sweep * s
    points = centre + radius * np.stack([np.cos(theta), np.sin(theta)], 1)
    points[0], points[-1] = a, c
    # a cubic with the circle's tangents at both ends leaves it by angle^4 / 384
    return _hermite(s, points, sweep * radius * np.stack([-np.sin(theta), np.cos(theta)], 1))


def _at(point: Floats) -> str:
    return f"({point[0]:g}, {point[1]:g})"


def as_points(points: ArrayLike, what: str) -> Floats:
    """`points` as an array of shape (n, 2), n >= 2; `what` names them in an `InputError`."""
    try:
        xy = np.asarray(points, float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what}: points must be a list of [x, y] pairs of numbers") from None
    if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 2:
        raise InputError(f"{what}: points have shape {xy.shape}; (n, 2) with n >= 2 is needed")
    if not np.isfinite(xy).all():
        raise InputError(f"{what}: point {int(np.argmin(np.isfinite(xy).all(1)))} is not finite")
    return xy


def as_point(point: ArrayLike, what: str) -> Floats:
    """`point` as an array of shape (2,); `what` names it in an `InputError`."""
    twice: Any = [point, point]
    return as_points(twice, what)[0]


def _chords(xy: Floats, what: str) -> Floats:
    """The share of the chord length at each point, rising from 0 to 1."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    if not (np.diff(length) > 1e-14 * length[-1]).all():
        at = int(np.argmin(np.diff(length)))
        raise InputError(
            f"{what}: points {at} and {at + 1} are the same, ({xy[at, 0]:g}, {xy[at, 1]:g})"
        )
    return length / length[-1]


_NEAR = 0.1
"""Points nearer to one neighbour than this share of the way to the other are looked at for that."""
_STEEPEST = 60.0
"""Largest angle between a spline and the longer line to a neighbour of a point of it, degrees."""


def smooth(points: ArrayLike) -> Curve:
    """`spline(points)` of an outline that is to keep to its points.

    Raises `InputError`, with the place, also where a point is so near to another that the curve
    turns away from the others there.
    """
    curve = spline(points)
    xy, slope = as_points(points, "spline"), curve.coefficients[:, 1]
    steps = np.diff(xy, axis=0)
    length = np.hypot(*steps.T)
    longer = np.where((length[1:] > length[:-1])[:, None], steps[1:], steps[:-1])
    near = np.minimum(length[1:], length[:-1])
    cosine = (longer * slope[1:]).sum(1)
    cosine /= np.hypot(*longer.T) * np.maximum(np.hypot(*slope[1:].T), 1e-300)
    wrong = (cosine < np.cos(np.radians(_STEEPEST))) & (near < _NEAR * np.hypot(*longer.T))
    if wrong.any():
        worst = int(np.argmax(wrong))
        raise InputError(
            f"spline: turns away from its own points at {_at(xy[worst + 1])}, which has another "
            f"{near[worst]:.3g} mm beside it; leave one out, or draw a corner there"
        )
    return curve


def _hermite(breaks: Floats, xy: Floats, slope: Floats) -> Curve:
    """The cubics with these points and slopes d(xy)/ds at the breaks."""
    h = np.diff(breaks)[:, None]
    secant = np.diff(xy, axis=0) / h
    left, right = slope[:-1], slope[1:]
    quadratic = (3 * secant - 2 * left - right) / h
    cubic = (left + right - 2 * secant) / h**2
    return Curve(breaks, np.stack([xy[:-1], left, quadratic, cubic], 1))


def _spline_slopes(t: Floats, xy: Floats) -> Floats:
    """Slopes at the points of the C2 cubic spline: not-a-knot ends, or natural below 4 points.

    Row k of the tridiagonal system is `lower[k] m[k-1] + diagonal[k] m[k] + upper[k] m[k+1]`
    (de Boor, A Practical Guide to Splines, chapter IV).
    """
    n, h = len(t), np.diff(t)
    secant = np.diff(xy, axis=0) / h[:, None]
    lower, diagonal, upper = np.zeros((3, n))
    rhs = np.zeros((n, 2))
    lower[1:-1], diagonal[1:-1], upper[1:-1] = h[1:], 2 * (h[:-1] + h[1:]), h[:-1]
    rhs[1:-1] = 3 * (h[1:, None] * secant[:-1] + h[:-1, None] * secant[1:])
    for end, beside, near, far in ((0, upper, 0, 1), (n - 1, lower, n - 2, n - 3)):
        if n < 4:
            diagonal[end], beside[end] = 2, 1
            rhs[end] = 3 * secant[near]
        else:
            both = h[near] + h[far]
            diagonal[end], beside[end] = h[far], both
            rhs[end] = (
                (h[near] + 2 * both) * h[far] * secant[near] + h[near] ** 2 * secant[far]
            ) / both
    for k in range(1, n):
        factor = lower[k] / diagonal[k - 1]
        diagonal[k] -= factor * upper[k - 1]
        rhs[k] -= factor * rhs[k - 1]
    rhs[-1] /= diagonal[-1]
    for k in range(n - 2, -1, -1):
        rhs[k] = (rhs[k] - upper[k] * rhs[k + 1]) / diagonal[k]
    return rhs
