"""Where a straight line lies on a road: the chord of a stadium."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def stadium_chord(
    point: ArrayLike, direction: ArrayLike, start: ArrayLike, end: ArrayLike, radius: ArrayLike
) -> tuple[Floats, Floats]:
    """Between which t the point `point + t * direction` lies within `radius` of a segment.

    `direction` has length 1, the segment from `start` to `end` more than 0; points have shape
    (..., 2), mm, and all broadcast. Returns the least and the largest t; the first is above the
    second where the line misses. What lies within the radius is a rectangle and two discs; it is
    convex, so the three chords make one.

    >>> low, high = stadium_chord([0, -5], [0, 1], [-3, 0], [3, 0], 0.5)
    >>> float(low), float(high)
    (4.5, 5.5)
    """
    p, d, a, b = (np.asarray(value, float) for value in (point, direction, start, end))
    radius = np.asarray(radius, float)
    along = b - a
    length = np.hypot(along[..., 0], along[..., 1])
    unit = along / length[..., None]
    chords = [
        _disc(a - p, d, radius),
        _disc(b - p, d, radius),
        _rectangle(p - a, d, unit, length, radius),
    ]
    lows, highs = zip(*chords, strict=True)
    return np.minimum.reduce(lows), np.maximum.reduce(highs)


def _dot(a: Floats, b: Floats) -> Floats:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def _cross(a: Floats, b: Floats) -> Floats:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _disc(centre: Floats, d: Floats, radius: Floats) -> tuple[Floats, Floats]:
    middle, room = _dot(centre, d), radius**2 - _cross(centre, d) ** 2
    half = np.where(room >= 0, np.sqrt(np.maximum(room, 0)), -np.inf)
    return middle - half, middle + half


def _rectangle(
    p: Floats, d: Floats, unit: Floats, length: Floats, radius: Floats
) -> tuple[Floats, Floats]:
    low_a, high_a = _slab(_dot(p, unit), _dot(d, unit), 0.0, length)
    low_b, high_b = _slab(_cross(unit, p), _cross(unit, d), -radius, radius)
    low, high = np.maximum(low_a, low_b), np.minimum(high_a, high_b)
    misses = low > high
    return np.where(misses, np.inf, low), np.where(misses, -np.inf, high)


def _slab(value: Floats, rate: Floats, low: Floats | float, high: Floats) -> tuple[Floats, Floats]:
    """Between which t `low <= value + rate t <= high`."""
    along = rate == 0
    safe = np.where(along, 1.0, rate)
    t0, t1 = (low - value) / safe, (high - value) / safe
    inside = (value >= low) & (value <= high)
    first = np.where(along, np.where(inside, -np.inf, np.inf), np.minimum(t0, t1))
    last = np.where(along, np.where(inside, np.inf, -np.inf), np.maximum(t0, t1))
    return first, last
