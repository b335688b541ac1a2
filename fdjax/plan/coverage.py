"""Coverage: how much of the outline the roads cover, seen from above."""

import numpy as np

from fdjax.errors import InputError
from fdjax.plan.covered import Covered, fine_step
from fdjax.plan.measure import layer_outlines
from fdjax.plan.segments import Segments
from fdjax.plan.toolpath import Build, Outline

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
    covered = 0.0
    for layer in build.layers:
        segments = Segments.of(layer.roads)
        if len(segments.length):
            step = resolution or _step(segments)
            covered += float(Covered.by(segments, step).area.sum()) * layer.height
    return covered / room


def _step(segments: Segments) -> float:
    """Distance of the scan lines, mm: the more pieces, the more their errors even out."""
    return fine_step(segments) * float(np.clip(len(segments.width) / _MANY, 1, 4))
