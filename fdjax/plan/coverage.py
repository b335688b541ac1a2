"""Coverage: how much of the outline the roads cover, seen from above."""

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.plan.measure import layer_outlines
from fdjax.plan.segments import Segments
from fdjax.plan.toolpath import Build, Outline

Floats = NDArray[np.float64]

_ANGLE = 0.4
"""Direction of the scan lines, radians: roads seldom run along it."""
_FLAT = 1e-300
"""mm; a road that rises less along the scan lines' normal is taken to rise so much."""
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
    width = float(segments.width.min())
    if width < segments.width.max() / 4:
        width = max(width, float(np.median(segments.width)) / 4)
    return width / 5 * float(np.clip(len(segments.width) / _MANY, 1, 4))


def _union_area(segments: Segments, resolution: float | None) -> float:
    """Area of the union of all beads seen from above, mm^2."""
    if not len(segments.length):
        return 0.0
    step = resolution or _step(segments)
    turn = np.array([[np.cos(_ANGLE), -np.sin(_ANGLE)], [np.sin(_ANGLE), np.cos(_ANGLE)]])
    (ax, ay), (bx, by) = (turn.T @ points.T for points in (segments.start, segments.end))
    radius = segments.width / 2
    # Scan lines lie at (k + 1/2) step; a stadium is met by those from `first` to `last`.
    first = np.ceil((np.minimum(ay, by) - radius) / step - 0.5).astype(int)
    last = np.floor((np.maximum(ay, by) + radius) / step - 0.5).astype(int)
    count = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(count)), count)
    scan = np.arange(len(owner)) + (first - np.cumsum(count) + count)[owner]
    ahead = (scan + 0.5) * step - ay[owner]
    # The chord ends on the side of the stadium that faces it, or on the disc at that side's end.
    rise = by - ay
    rise[np.abs(rise) < _FLAT] = _FLAT
    side = np.copysign(radius, rise) * (bx - ax) / segments.length
    radius, side, rise = radius[owner], side[owner], rise[owner]
    origin, run = ax[owner], (bx - ax)[owner]
    ends = []
    for sign in (-1, 1):
        share = np.clip((ahead + sign * side) / rise, 0, 1)
        aside = ahead - share * rise
        half = np.sqrt(np.maximum(radius * radius - aside * aside, 0))
        ends.append(share * run + sign * half + origin)
    return step * _union_length(scan, *ends)


def _union_length(scan: NDArray[np.intp], low: Floats, high: Floats) -> float:
    """Length of the union of intervals, scan line by scan line."""
    if not len(scan):
        return 0.0
    scan = scan - scan.min()
    # Line by line roads come nearly in order, which a stable sort makes use of.
    lines = scan.astype(np.uint16) if scan.max() < 1 << 16 else scan
    order = np.argsort(lines, kind="stable")
    # Scan lines laid end to end, far enough apart not to touch.
    shift = scan * (high.max() - low.min() + 1.0) - low.min()
    low, high = ((each + shift)[order] for each in (low, high))
    low.sort(kind="stable")
    high.sort(kind="stable")
    # There is a gap where as many intervals have ended as have begun.
    gaps = np.maximum(low[1:] - high[:-1], 0).sum()
    return float(high[-1] - low[0] - gaps)
