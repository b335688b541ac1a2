"""The exact porosity of a build, window by window. This is the one definition of porosity."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, area, box, contains_properly, contains_xy, intersection, prepare
from shapely import bounds as bounds_of

from fdjax.errors import InputError
from fdjax.plan.segments import Segments
from fdjax.plan.toolpath import Build
from fdjax.road.bead import section_area

Floats = NDArray[np.float64]

HALF = 0.5 * (1 - 1e-9)
"""Share of a window that must lie inside the outline: half, give or take rounding."""

_POINTS = 8
"""Points a side at which a target is averaged over a window."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """Deposited volume and room in square windows; axis 0 of the fields is x, axis 1 is y.

    - `x`, `y`: window edges, shapes (nx + 1,), (ny + 1,), mm.
    - `area`: of the outline inside each window, mean over the layers, shape (nx, ny), mm^2.
    - `volume`: deposited in each window, shape (nx, ny), mm^3.
    - `total_volume`: deposited in the whole build, mm^3.
    - `outlines`: the layers' outlines, each once, with the summed height of its layers, mm.
    """

    x: Floats
    y: Floats
    area: Floats
    volume: Floats
    total_volume: float
    outlines: tuple[tuple[Polygon, float], ...]

    @property
    def height(self) -> float:
        """Sum of the layer heights, mm."""
        return sum(height for _, height in self.outlines)

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Windows of which at least half is inside, shape (nx, ny)."""
        return self.area >= HALF * (self.x[1] - self.x[0]) ** 2

    @property
    def solid(self) -> Floats:
        """Solid share of each window, shape (nx, ny); nan where a window is left out."""
        room = np.where(self.kept, self.area * self.height, np.nan)
        return self.volume / room

    @property
    def porosity(self) -> Floats:
        """`1 - solid`, shape (nx, ny)."""
        return 1 - self.solid

    @property
    def mean_solid(self) -> float:
        """Solid share of the whole part, whatever the windows."""
        room = sum(outline.area * height for outline, height in self.outlines)
        return self.total_volume / room

    @property
    def mean_porosity(self) -> float:
        """Porosity of the whole part, whatever the windows."""
        return 1 - self.mean_solid


def measure(
    build: Build,
    *,
    window: float,
    shift: tuple[float, float] = (0.0, 0.0),
    outline: Polygon | None = None,
) -> Measurement:
    """Measure the solid share of a build in square windows of side `window`, mm.

    The solid share of a window is the deposited volume whose centre line lies in it, over the
    area of the outline less its holes inside the window times the height, both summed over the
    layers; porosity is 1 - solid share. The volume of a segment is its section (see
    `section_area`) times its length; what overlaps counts twice, turn-arounds count. Segments are
    split exactly at the windows' edges; on an edge they belong to the window right of it or above.

    The windows start at the lower left corner of the outlines' bounding box, and cover it; `shift`
    moves them left and down by 1 less these shares of a window (0 to 1). Windows are clipped
    to the outline; those with less than half of their area inside are left out of the shares.
    `outline` stands in for the layers' own. Deposits outside the windows count in the mean alone.

    Raises `InputError` without layers or outline, or where no window is half inside.

    >>> from fdjax.plan.toolpath import Layer, Road
    >>> road = Road([(0, 1), (4, 1)], 0.5)
    >>> plate = Build((Layer(0.5, 0.5, (road,), box(0, 0, 4, 2)),))
    >>> measure(plate, window=2).solid.round(6).tolist()
    [[0.19635], [0.19635]]
    """
    if not (window > 0 and np.isfinite(window)):
        raise InputError(f"window: {window:g} mm; it must be positive")
    outlines = layer_outlines(build, outline)
    bounds = np.array([polygon.bounds for polygon, _ in outlines])
    x, y = (
        _edges(bounds[:, axis].min(), bounds[:, axis + 2].max(), window, shift[axis])
        for axis in (0, 1)
    )
    height = sum(own for _, own in outlines)
    inside = np.sum([_clipped(polygon, x, y)[0] * own for polygon, own in outlines], 0) / height
    measurement = Measurement(x, y, inside, _deposits(build, x, y), build.volume, outlines)
    if not measurement.kept.any():
        raise InputError(f"window: none of {window:g} mm is half inside; ask for a smaller one")
    return measurement


def layer_outlines(build: Build, outline: Polygon | None) -> tuple[tuple[Polygon, float], ...]:
    """The layers' outlines, or the one given, each once with the summed height of its layers.

    Raises `InputError` where a layer has none or there is no layer.
    """
    if not build.layers:
        raise InputError("build: it has no layers, so there is nothing to measure")
    found: dict[Polygon, float] = {}
    for number, layer in enumerate(build.layers):
        own = outline if outline is not None else layer.outline
        if own is None:
            raise InputError(f"layer {number}: no outline; give one to measure against")
        if own not in found and not (own.is_valid and own.area > 0):
            raise InputError(f"layer {number}: the outline crosses itself or has no area")
        found[own] = found.get(own, 0.0) + layer.height
    return tuple(found.items())


def _edges(low: float, high: float, window: float, shift: float) -> Floats:
    first = low - (1 - shift % 1) * window if shift % 1 else low
    count = max(1, int(np.ceil((high - first) / window - 1e-9)))
    return first + window * np.arange(count + 1.0)


def _clipped(polygon: Polygon, x: Floats, y: Floats) -> tuple[Floats, NDArray[np.object_]]:
    """Area of the polygon in each window, and the windows clipped to it."""
    windows = box(x[:-1, None], y[None, :-1], x[1:, None], y[None, 1:])
    prepare(polygon)
    cut = ~contains_properly(polygon, windows)
    windows[cut] = intersection(polygon, windows[cut])
    return area(windows), windows


def _deposits(build: Build, x: Floats, y: Floats) -> Floats:
    """Volume deposited in each window, shape (nx, ny)."""
    shape = (len(x) - 1, len(y) - 1)
    side = x[1] - x[0]
    total = np.zeros(shape)
    for layer in build.layers:
        segments = Segments.of(layer.roads)
        per_length = section_area(segments.width, layer.height)
        # In units of windows, so that edges are whole numbers.
        start, end = (_snapped((xy - [x[0], y[0]]) / side) for xy in (segments.start, segments.end))
        owner, share, middle = _split(start, end)
        middle = _snapped(middle)
        index = np.floor(middle).astype(int)
        # The last edge of all has no window beyond it.
        index -= (middle == shape) & (index == shape)
        inside = ((index >= 0) & (index < shape)).all(1)
        volume = (per_length * segments.length)[owner] * share
        flat = np.ravel_multi_index(tuple(index[inside].T), shape)
        total += np.bincount(flat, volume[inside], total.size).reshape(shape)
    return total


def _snapped(u: Floats) -> Floats:
    whole = np.round(u)
    return np.where(np.abs(u - whole) < 1e-9, whole, u)


def _split(start: Floats, end: Floats) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Split segments where a coordinate is whole: owner, share of the length, middle of each."""
    owners = [np.arange(len(start)), np.arange(len(start))]
    shares = [np.zeros(len(start)), np.ones(len(start))]
    for axis in (0, 1):
        a, b = start[:, axis], end[:, axis]
        low = np.floor(np.minimum(a, b)) + 1
        count = np.maximum(np.ceil(np.maximum(a, b)) - low, 0).astype(int)
        owner = np.repeat(np.arange(len(a)), count)
        step = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        owners.append(owner)
        shares.append((low[owner] + step - a[owner]) / (b - a)[owner])
    owner, at = np.concatenate(owners), np.concatenate(shares)
    order = np.lexsort((at, owner))
    owner, at = owner[order], at[order]
    within = owner[1:] == owner[:-1]
    owner, low, high = owner[1:][within], at[:-1][within], at[1:][within]
    middle = start[owner] + ((low + high) / 2)[:, None] * (end - start)[owner]
    return owner, high - low, middle


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


def compare(measurement: Measurement, target: Callable[[Floats, Floats], Floats]) -> Comparison:
    """Compare a measurement with a target porosity `target(x, y)`, called on arrays in mm.

    The target is averaged over each window within the outline, at 8 x 8 Gauss points of the
    window, or of the bounding box of what the outline leaves of it, those inside counting.

    >>> from fdjax.plan.toolpath import Layer, Road
    >>> plate = Build((Layer(0.5, 0.5, (), box(0, 0, 4, 2)),))
    >>> compare(measure(plate, window=2), lambda x, y: x / 4).asked.round(9).tolist()
    [[0.25], [0.75]]
    """
    weight = np.zeros_like(measurement.area)
    total = np.zeros_like(weight)
    for polygon, height in measurement.outlines:
        inside, windows = _clipped(polygon, measurement.x, measurement.y)
        room = inside * height
        total += room * _target_means(polygon, windows, inside > 0, target)
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


def _target_means(
    polygon: Polygon,
    windows: NDArray[np.object_],
    used: NDArray[np.bool_],
    target: Callable[[Floats, Floats], Floats],
) -> Floats:
    """Mean of the target over each clipped window; 0 where a window is not used."""
    node, gauss = np.polynomial.legendre.leggauss(_POINTS)
    x0, y0, x1, y1 = bounds_of(windows[used]).T[..., None, None]
    x = x0 + (x1 - x0) * (node[:, None] + 1) / 2
    y = y0 + (y1 - y0) * (node[None, :] + 1) / 2
    x, y = (np.broadcast_to(each, (used.sum(), _POINTS, _POINTS)) for each in (x, y))
    value = np.broadcast_to(np.asarray(target(x, y), float), x.shape)
    if not np.isfinite(value).all():
        bad = np.unravel_index(np.argmin(np.isfinite(value)), value.shape)
        raise InputError(f"target: not finite at ({x[bad]:g}, {y[bad]:g})")
    inside = contains_xy(polygon, x, y)
    # Of a sliver between the points every point counts.
    inside |= ~inside.any(axis=(1, 2), keepdims=True)
    weight = inside * np.outer(gauss, gauss)
    means = np.zeros(windows.shape)
    means[used] = (weight * value).sum((1, 2)) / weight.sum((1, 2))
    return means
