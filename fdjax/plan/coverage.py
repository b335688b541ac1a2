"""Coverage: how much of the outline the roads cover, seen from above."""

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.plan.measure import layer_outlines
from fdjax.plan.segments import Segments
from fdjax.plan.stadium import stadium_chord
from fdjax.plan.toolpath import Build, Outline

Floats = NDArray[np.float64]

_ANGLE = 0.4
"""Direction of the scan lines, radians: roads seldom run along it."""
_MANY = 1000
"""Pieces of road in a layer above which scan lines may lie further apart."""


def coverage(
    build: Build, *, outline: Outline | None = None, resolution: float | None = None
) -> float:
    """The share of the outline that roads cover, layer by layer, then averaged over the height.

    Roads are as wide as their width and have round ends; what overlaps counts once, what lies
    outside the outline counts too. Measured by scan lines `resolution` mm apart (by default a
    fifth of the narrowest road, and more in layers of many pieces), each exactly along itself;
    they run at 0.4 radians to the x axis. Roads that run along them are measured worst. With the
    default 1e-5 was seen for a layer of hundreds of roads' lengths, 2e-3 for twenty short tangled
    roads and 6e-3 for four.

    `outline` stands in for the layers' own. Raises `InputError` without layers or outline.

    >>> from shapely import box
    >>> from fdjax.plan.toolpath import Layer, Road
    >>> road = Road([(0, 5), (100, 5)], 0.5)
    >>> round(coverage(Build((Layer(0.2, 0.2, (road,), box(0, 0, 100, 10)),))), 3)
    0.05
    """
    filled = layer_outlines(build, outline)
    if resolution is not None and not resolution > 0:
        raise InputError(f"resolution: {resolution:g} mm; it must be positive")
    room = sum(each.outline.area * each.height for each in filled)
    covered = sum(
        _union_area(Segments.of(layer.roads), resolution) * layer.height for layer in build.layers
    )
    return float(covered / room)


def _step(segments: Segments) -> float:
    """Distance of the scan lines, mm: the more pieces, the more their errors even out."""
    width = max(float(segments.width.min()), float(np.median(segments.width)) / 4)
    return width / 5 * float(np.clip(len(segments.width) / _MANY, 1, 4))


def _union_area(segments: Segments, resolution: float | None) -> float:
    """Area of the union of all beads seen from above, mm^2."""
    if not len(segments.length):
        return 0.0
    step = resolution or _step(segments)
    turn = np.array([[np.cos(_ANGLE), -np.sin(_ANGLE)], [np.sin(_ANGLE), np.cos(_ANGLE)]])
    start, end, radius = segments.start @ turn, segments.end @ turn, segments.width / 2
    # Scan lines lie at (k + 1/2) step; a stadium is met by those from `first` to `last`.
    first = np.ceil((np.minimum(start[:, 1], end[:, 1]) - radius) / step - 0.5).astype(int)
    last = np.floor((np.maximum(start[:, 1], end[:, 1]) + radius) / step - 0.5).astype(int)
    count = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(count)), count)
    scan = first[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    origin = np.stack([np.zeros(len(scan)), (scan + 0.5) * step], 1)
    low, high = stadium_chord(origin, [1.0, 0.0], start[owner], end[owner], radius[owner])
    hit = low <= high
    return step * _union_length(scan[hit], low[hit], high[hit])


def _union_length(scan: NDArray[np.intp], low: Floats, high: Floats) -> float:
    """Length of the union of intervals, scan line by scan line."""
    if not len(scan):
        return 0.0
    # Scan lines laid end to end, far enough apart not to touch.
    shift = (scan - scan.min()) * (high.max() - low.min() + 1.0) - low.min()
    low, high = low + shift, high + shift
    order = np.argsort(low)
    low, reached = low[order], np.maximum.accumulate(high[order])
    gaps = np.maximum(low[1:] - reached[:-1], 0).sum()
    return float(reached[-1] - low[0] - gaps)
