"""How often as dense as its chart a curve is to be, to begin with."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from fdjax.field.spline import Axis
from fdjax.pattern.chart_settings import Start, spline_of

Floats = NDArray[np.float64]

_SHARE = 0.5
"""Of what a target varies by, as a power: what the depth takes on, the chart the rest."""

_LEAST = 0.05
"""Share of the material that may be asked for in sparser places than the chart begins with, and in
denser ones than the depth goes to."""

_EVEN = 0.25
"""Of a step of the depth, what the chart takes on alone."""

_ENDS = 0.01
"""Of the range of `times`, how near to its ends it begins."""


def depths_of(start: Start) -> int:
    """How often squares are to be halved for what a target varies by."""
    least, most = _quantiles(start)
    return max(0, int(np.ceil(_SHARE * np.log2(most / least) - _EVEN)))


def varies(start: Start) -> float:
    """How much a target varies: 0 where it is even, 1 where it doubles and beyond."""
    least, most = _quantiles(start)
    return float(np.clip(np.log2(most / least), 0.0, 1.0))


def times_of(start: Start, finest: float) -> Floats:
    """How often as dense as the chart a curve is to be at the places of a start, shape (n,)."""
    return np.clip((start.demand / _quantiles(start)[0]) ** _SHARE, 1.0, finest)


def free_spline(start: Start, places: list[Floats], times: Floats, finest: float) -> Floats:
    """Coefficients (K, L, M) of a spline of the free number that `width.within` maps to what
    `times` is at the nearest place of a start; fitted at `places` along x and y, (n,) and (m,).
    """
    share = np.clip((times - 1) / (finest - 1), _ENDS, 1 - _ENDS)
    free = np.log(share / (1 - share))
    x, y, z = start.axes
    level = x, y, Axis(z.low, z.high, 1)
    tree = KDTree(start.xyz)
    made = []
    for height in np.linspace(z.low, z.high, z.count):
        at = np.stack(np.meshgrid(*places, [height], indexing="ij"), -1)[:, :, 0]
        made.append(spline_of(level, places, free[tree.query(at)[1]])[..., 0])
    return np.stack(made, -1)


def _quantiles(start: Start) -> tuple[float, float]:
    """The demand below which there is little material, and above which."""
    order = np.argsort(start.demand)
    passed = np.cumsum(start.weight[order])
    at = np.searchsorted(passed, passed[-1] * np.array([_LEAST, 1 - _LEAST]))
    least, most = start.demand[order][at]
    return float(least), float(most)
