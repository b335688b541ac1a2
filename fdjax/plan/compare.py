"""What a build has got beside what was asked for, window by window."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely import contains_xy

from fdjax.errors import InputError
from fdjax.plan.measure import Clip, Filled, Measurement
from fdjax.target.field import Field, field_of

Floats = NDArray[np.float64]

_POINTS = 8
"""Points a side at which a target is averaged over a window."""

_JUMP, _MANY = 0.05, 64
"""Where a target changes by more from point to point, it is averaged over this many a side."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A measurement beside the porosity that was asked for.

    - `asked`, `got`, `error`: porosity of each window and their difference (got - asked), shape
      (nx, ny), nan where a window is left out.
    - `rms`, `largest`, `mean_error`: of the error over the windows, weighted by area; the largest
      is an absolute value.
    - `mean_asked`, `mean_got`: of the whole part.
    """

    asked: Floats
    got: Floats
    error: Floats
    rms: float
    largest: float
    mean_error: float
    mean_asked: float
    mean_got: float


def compare(measurement: Measurement, target: Callable[..., Any]) -> Comparison:
    """Compare a measurement with a target porosity `target(x, y)` or `target(x, y, z)`.

    The target is called on arrays in mm, z above the bed. It is averaged over each window within
    the outline, at 8 x 8 Gauss points of the window, or of the bounding box of what the outline
    leaves of it, those inside counting, and where it has steps at 64 x 64 points; and over the
    layers, at their middles, each weighted by its volume. Raises `InputError` for a target that is
    not finite at one of these.

    >>> from shapely import box
    >>> from fdjax.plan.measure import measure
    >>> from fdjax.plan.toolpath import Build, Layer
    >>> plate = Build((Layer(0.5, 0.5, (), box(0, 0, 4, 2)),))
    >>> compare(measure(plate, window=2), lambda x, y: x / 4).asked.round(9).tolist()
    [[0.25], [0.75]]
    """
    field = field_of(target)
    weight = np.zeros_like(measurement.area)
    total = np.zeros_like(weight)
    for filled, clip in zip(measurement.filled, measurement.clips, strict=True):
        room = clip.area * filled.height
        total += room * _target_means(filled, clip, field)
        weight += room
    asked = np.divide(total, weight, out=np.zeros_like(total), where=weight > 0)
    kept = measurement.kept
    got = measurement.porosity
    error = np.where(kept, got - asked, np.nan)
    share = weight[kept] / weight[kept].sum()
    return Comparison(
        asked=np.where(kept, asked, np.nan),
        got=got,
        error=error,
        rms=float(np.sqrt((share * error[kept] ** 2).sum())),
        largest=float(np.abs(error[kept]).max()),
        mean_error=float((share * error[kept]).sum()),
        mean_asked=float(total.sum() / weight.sum()),
        mean_got=measurement.mean_porosity,
    )


def _target_means(filled: Filled, clip: Clip, field: Field) -> Floats:
    """Mean of the target over each clipped window and the layers; 0 where a window is not used."""
    used = clip.area > 0
    means = np.zeros(used.shape)
    node, gauss = np.polynomial.legendre.leggauss(_POINTS)
    even = (np.arange(_MANY) + 0.5) / _MANY * 2 - 1
    if field.varies_in_z:
        levels = zip(filled.middles, filled.heights / filled.height, strict=True)
    else:
        levels = [(filled.middles[0], 1.0)]
    points = _Points.of(filled, clip, used, node, gauss)
    for z, share in levels:
        value = points.values(field, z)
        mean = points.means(value)
        steep = _steepest(value) > _JUMP
        if steep.any():
            there = used.copy()
            there[used] = steep
            more = _Points.of(filled, clip, there, even, np.ones(_MANY))
            mean[steep] = more.means(more.values(field, z))
        means[used] += share * mean
    return means


class _Points(NamedTuple):
    """Points of windows, x and y of shape (n, m, m), mm, and their weights, which sum to 1."""

    x: Floats
    y: Floats
    weight: Floats

    @classmethod
    def of(
        cls, filled: Filled, clip: Clip, used: NDArray[np.bool_], node: Floats, weight: Floats
    ) -> "_Points":
        """Those of the windows that are `used`, of a rule on (-1, 1) for either axis."""
        x0, y0, x1, y1 = clip.bounds[used].T[..., None, None]
        x = x0 + (x1 - x0) * (node[:, None] + 1) / 2
        y = y0 + (y1 - y0) * (node[None, :] + 1) / 2
        x, y = (np.broadcast_to(each, (used.sum(), len(node), len(node))) for each in (x, y))
        inside = np.ones(x.shape, bool)
        cut = clip.cut[used]
        inside[cut] = contains_xy(filled.outline, x[cut], y[cut])
        # Of a sliver between the points every point counts.
        inside |= ~inside.any(axis=(1, 2), keepdims=True)
        share = inside * np.outer(weight, weight)
        return cls(x, y, share / share.sum((1, 2), keepdims=True))

    def values(self, field: Field, z: float) -> Floats:
        value = np.broadcast_to(np.asarray(field(self.x, self.y, z), float), self.x.shape)
        if not np.isfinite(value).all():
            bad = np.unravel_index(np.argmin(np.isfinite(value)), value.shape)
            at = f"{self.x[bad]:g}, {self.y[bad]:g}"
            place = f"({at}, {z:g})" if field.varies_in_z else f"({at})"
            raise InputError(f"target: not finite at {place}")
        return value

    def means(self, value: Floats) -> Floats:
        return (self.weight * value).sum((1, 2))


def _steepest(value: Floats) -> Floats:
    """The largest difference of neighbouring points of each window, (n,), of values (n, m, m)."""
    return np.maximum(
        *(np.abs(np.diff(value, axis=axis)).max((1, 2), initial=0.0) for axis in (1, 2))
    )
