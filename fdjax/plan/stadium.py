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
    (px, py), (dx, dy), (ax, ay), (bx, by) = (
        np.moveaxis(np.asarray(value, float), -1, 0) for value in (point, direction, start, end)
    )
    radius = np.asarray(radius, float)
    length = np.hypot(bx - ax, by - ay)
    ux, uy = (bx - ax) / length, (by - ay) / length
    x, y = px - ax, py - ay
    # How the point lies ahead of the segment's start and aside of it, and where the line goes.
    ahead, aside = x * ux + y * uy, ux * y - uy * x
    forward, sideward = dx * ux + dy * uy, ux * dy - uy * dx
    middle, miss = -(x * dx + y * dy), x * dy - y * dx
    low, high = _disc(middle, miss, radius)
    low_b, high_b = _disc(middle + length * forward, miss - length * sideward, radius)
    low, high = np.minimum(low, low_b), np.maximum(high, high_b)
    # Between the discs lies a rectangle.
    low_l, high_l = _slab(ahead, forward, 0.0, length)
    low_w, high_w = _slab(aside, sideward, -radius, radius)
    low_r, high_r = np.maximum(low_l, low_w), np.minimum(high_l, high_w)
    hits = low_r <= high_r
    return np.where(hits, np.minimum(low, low_r), low), np.where(
        hits, np.maximum(high, high_r), high
    )


def _disc(middle: Floats, miss: Floats, radius: Floats) -> tuple[Floats, Floats]:
    room = radius**2 - miss**2
    half = np.where(room >= 0, np.sqrt(np.maximum(room, 0)), -np.inf)
    return middle - half, middle + half


def _slab(value: Floats, rate: Floats, low: Floats | float, high: Floats) -> tuple[Floats, Floats]:
    """Between which t `low <= value + rate t <= high`."""
    along = rate == 0
    safe = np.where(along, 1.0, rate)
    t0, t1 = (low - value) / safe, (high - value) / safe
    inside = (value >= low) & (value <= high)
    first = np.where(along, np.where(inside, -np.inf, np.inf), np.minimum(t0, t1))
    last = np.where(along, np.where(inside, np.inf, -np.inf), np.maximum(t0, t1))
    return first, last
