"""The exact porosity of a build, window by window. This is the one definition of porosity."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import (
    STRtree,
    area,
    bounds,
    box,
    contains_properly,
    contains_xy,
    intersection,
    intersects,
    points,
    prepare,
)

from fdjax.errors import InputError
from fdjax.plan.counted import Counted
from fdjax.plan.toolpath import Build, Outline

Floats = NDArray[np.float64]

HALF = 0.5 * (1 - 1e-9)
"""Share of a window that must lie inside the outline: half, give or take rounding."""


@dataclass(frozen=True, eq=False)
class Filled:
    """One outline and the layers that fill it.

    - `middles`, `heights`: of the layers, shape (layers,), mm; the middles above the bed.
    """

    outline: Outline
    middles: Floats
    heights: Floats

    @property
    def height(self) -> float:
        """Sum of its layers' heights, mm."""
        return float(self.heights.sum())


@dataclass(frozen=True, eq=False)
class Clip:
    """Square windows clipped to an outline.

    - `area`: of what is left of each, shape (nx, ny), mm^2.
    - `bounds`: least x and y, largest x and y of that, shape (nx, ny, 4), mm; nan where it is
      empty.
    - `cut`: the windows that are not inside as a whole, shape (nx, ny).
    """

    area: Floats
    bounds: Floats
    cut: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Measurement:
    """Deposited volume and room in square windows; axis 0 of the fields is x, axis 1 is y.

    - `x`, `y`: window edges, shapes (nx + 1,), (ny + 1,), mm.
    - `area`: of the outline inside each window, mean over the layers, shape (nx, ny), mm^2.
    - `volume`: deposited in each window, shape (nx, ny), mm^3, or covered, times the height.
    - `total_volume`: of the whole build, mm^3, likewise.
    - `filled`: the layers' outlines, each once, with the layers that fill it.
    - `clips`: the windows clipped to each of these.
    """

    x: Floats
    y: Floats
    area: Floats
    volume: Floats
    total_volume: float
    filled: tuple[Filled, ...]
    clips: tuple[Clip, ...]

    @property
    def height(self) -> float:
        """Sum of the layer heights, mm."""
        return sum(each.height for each in self.filled)

    @property
    def outlines(self) -> tuple[Outline, ...]:
        """The layers' outlines, each once."""
        return tuple(each.outline for each in self.filled)

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
        room = sum(each.outline.area * each.height for each in self.filled)
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
    outline: Outline | None = None,
    count: str = "volume",
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

    With `count` "coverage" the area that roads cover, seen from above, times the layers' heights
    stands in for the volume: what overlaps counts once, and a bead is as wide at all heights.

    Raises `InputError` without layers or outline, or where no window is half inside.

    >>> from fdjax.plan.toolpath import Layer, Road
    >>> road = Road([(0, 1), (4, 1)], 0.5)
    >>> plate = Build((Layer(0.5, 0.5, (road,), box(0, 0, 4, 2)),))
    >>> measure(plate, window=2).solid.round(6).tolist()
    [[0.19635], [0.19635]]
    """
    if not (window > 0 and np.isfinite(window)):
        raise InputError(f"window: {window:g} mm; it must be positive")
    filled = layer_outlines(build, outline)
    boxes = np.array([each.outline.bounds for each in filled])
    x, y = (
        _edges(boxes[:, axis].min(), boxes[:, axis + 2].max(), window, shift[axis])
        for axis in (0, 1)
    )
    clips = tuple(_clipped(each.outline, x, y) for each in filled)
    heights = [each.height for each in filled]
    inside = np.average([clip.area for clip in clips], axis=0, weights=heights)
    deposits, total = _deposits(build, x, y, count)
    measurement = Measurement(x, y, inside, deposits, total, filled, clips)
    if not measurement.kept.any():
        raise InputError(f"window: none of {window:g} mm is half inside; ask for a smaller one")
    return measurement


def layer_outlines(build: Build, outline: Outline | None) -> tuple[Filled, ...]:
    """The layers' outlines, or the one given, each once with the layers that fill it.

    Raises `InputError` where a layer has none or there is no layer.
    """
    if not build.layers:
        raise InputError("build: it has no layers, so there is nothing to measure")
    found: defaultdict[Outline, list[tuple[float, float]]] = defaultdict(list)
    for number, layer in enumerate(build.layers):
        own = outline if outline is not None else layer.outline
        if own is None:
            raise InputError(f"layer {number}: no outline; give one to measure against")
        if own not in found and not (own.is_valid and own.area > 0):
            raise InputError(f"layer {number}: the outline crosses itself or has no area")
        found[own].append((layer.z - layer.height / 2, layer.height))
    return tuple(Filled(own, *np.array(layers).T) for own, layers in found.items())


def _edges(low: float, high: float, window: float, shift: float) -> Floats:
    first = low - (1 - shift % 1) * window if shift % 1 else low
    count = max(1, int(np.ceil((high - first) / window - 1e-9)))
    return first + window * np.arange(count + 1.0)


def _clipped(outline: Outline, x: Floats, y: Floats) -> Clip:
    """The windows between these edges clipped to the outline."""
    windows = box(x[:-1, None], y[None, :-1], x[1:, None], y[None, 1:])
    prepare(outline)
    cut = ~contains_properly(outline, windows)
    # Strips first: each window then meets the few points of its strip alone.
    columns = box(x[:-1], y[0], x[1:], y[-1])
    columns[cut.any(1)] = intersection(outline, columns[cut.any(1)])
    met = cut & intersects(outline, windows)
    windows[met] = intersection(np.broadcast_to(columns[:, None], cut.shape)[met], windows[met])
    left = np.where(cut & ~met, 0.0, area(windows))
    return Clip(left, np.where(left[..., None] > 0, bounds(windows), np.nan), cut)


def _deposits(build: Build, x: Floats, y: Floats, count: str) -> tuple[Floats, float]:
    """What counts in each window, shape (nx, ny), and in all, mm^3."""
    shape = (len(x) - 1, len(y) - 1)
    corner, side = np.array([[x[0]], [y[0]]]), x[1] - x[0]
    total, whole = np.zeros(shape), 0.0
    for layer in build.layers:
        pieces = Counted.of(layer, count)
        volume = pieces.volume
        whole += float(volume.sum())
        # In units of windows, so that edges are whole numbers.
        start, end = (
            _snapped((np.ascontiguousarray(xy.T) - corner) / side)
            for xy in (pieces.start, pieces.end)
        )
        volume, middle = _split(start, end, volume)
        middle = _snapped(middle)
        i, j = np.floor(middle).astype(int)
        # The last edge of all has no window beyond it.
        for index, place, last in zip((i, j), middle, shape, strict=True):
            index -= (place == last) & (index == last)
        inside = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
        if not inside.all():
            i, j, volume = i[inside], j[inside], volume[inside]
        total += np.bincount(i * shape[1] + j, volume, total.size).reshape(shape)
    return total, whole


def _snapped(u: Floats) -> Floats:
    whole = np.round(u)
    return np.where(np.abs(u - whole) < 1e-9, whole, u)


def _split(start: Floats, end: Floats, volume: Floats) -> tuple[Floats, Floats]:
    """Segments split where a coordinate is whole: volumes and middles of the pieces.

    Points have shape (2, n). Of a segment that is split nothing is left in its own place.
    """
    first = np.floor(np.minimum(start, end)) + 1
    count = np.maximum(np.ceil(np.maximum(start, end)) - first, 0).astype(int)
    middle = (start + end) / 2
    cut = np.flatnonzero(count.any(0))
    if not len(cut):
        return volume, middle
    start, end, first, count = start[:, cut], end[:, cut], first[:, cut], count[:, cut]
    owners = [np.arange(len(cut)), np.arange(len(cut))]
    shares = [np.zeros(len(cut)), np.ones(len(cut))]
    for a, b, low, many in zip(start, end, first, count, strict=True):
        owner = np.repeat(np.arange(len(a)), many)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(many) - many, many)
        owners.append(owner)
        shares.append((low[owner] + step - a[owner]) / (b - a)[owner])
    owner, at = np.concatenate(owners), np.concatenate(shares)
    order = np.lexsort((at, owner))
    owner, at = owner[order], at[order]
    within = owner[1:] == owner[:-1]
    owner, low, high = owner[1:][within], at[:-1][within], at[1:][within]
    pieces = volume[cut][owner] * (high - low)
    volume = volume.copy()
    volume[cut] = 0.0
    middles = start[:, owner] + (low + high) / 2 * (end - start)[:, owner]
    return np.concatenate([volume, pieces]), np.concatenate([middle, middles], 1)


def solid_shares(build: Build, outlines: Sequence[Outline], *, step: float = 0.5) -> Floats:
    """Solid share of all layers in each of some outlines, shape (outlines,).

    Roads are cut into pieces of `step` mm at most, each counted where its middle lies.
    """
    places, volumes = build.deposits(step)
    height = sum(layer.height for layer in build.layers)
    # Boxes first: most pieces are near few of many outlines.
    near = STRtree(np.asarray(points(places[:, :2]))).query(outlines)
    shares = []
    many = np.bincount(near[0], minlength=len(outlines))
    for outline, own in zip(outlines, np.split(near[1], np.cumsum(many)[:-1]), strict=True):
        prepare(outline)
        inside = own[contains_xy(outline, places[own, 0], places[own, 1])]
        shares.append(float(volumes[inside].sum()) / (outline.area * height))
    return np.array(shares)
