"""Places of a layer where two functions have given values. Loads no JAX."""

import numpy as np
from numpy.typing import NDArray

from fdjax.field.spline import Axis, scattered

Floats = NDArray[np.float64]

_STEPS, _CLOSE = 12, 1e-10
"""Newton's steps at most, and the error of the values, in periods, at which they end."""

_AT_ONCE = 1 << 16
"""Places that are looked for together: more do not fit the caches."""


def inverse(
    coefficients: Floats, axes: tuple[Axis, Axis], values: Floats, guess: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Places (n, 2), mm, where splines (K, L, 2) have these values, (n, 2), and which are found.

    Newton's method from `guess` (n, 2), mm; no step is longer than a knot. Found is what lies in
    the box of the axes, or within a knot of it, where the map does not fold.
    """
    xy = np.array(guess, float)
    found = np.zeros(len(xy), bool)
    for low in range(0, len(xy), _AT_ONCE):
        part = slice(low, low + _AT_ONCE)
        xy[part], found[part] = _newton(coefficients, axes, values[part], xy[part])
    return xy, found


def _newton(
    coefficients: Floats, axes: tuple[Axis, Axis], values: Floats, xy: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    xy = xy.copy()
    found = np.zeros(len(xy), bool)
    knot = np.array([axis.step for axis in axes])
    least, most = (np.array([getattr(axis, side) for axis in axes]) for side in ("low", "high"))
    left = np.arange(len(xy))
    for _ in range(_STEPS):
        at = xy[left]
        got, along_x, along_y = scattered(coefficients, axes, at, (0, 0), (1, 0), (0, 1))
        miss = values[left] - got
        fold = along_x[:, 0] * along_y[:, 1] - along_y[:, 0] * along_x[:, 1]
        close = np.abs(miss).max(1) < _CLOSE
        found[left[close & (fold > 0)]] = True
        going = ~close & (np.abs(fold) > 0)
        left, miss, fold = left[going], miss[going], fold[going, None]
        if not len(left):
            break
        x, y = along_x[going], along_y[going]
        step = np.stack([
            y[:, 1] * miss[:, 0] - y[:, 0] * miss[:, 1], x[:, 0] * miss[:, 1] - x[:, 1] * miss[:, 0]
        ], 1) / fold  # fmt: skip
        step /= np.maximum(np.abs(step / knot).max(1, keepdims=True), 1)
        xy[left] = np.clip(at[going] + step, least - 2 * knot, most + 2 * knot)
    found &= ((xy >= least - knot) & (xy <= most + knot)).all(1)
    return xy, found
