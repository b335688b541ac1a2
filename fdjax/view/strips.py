"""Roads as the strips that they cover, seen from above."""

from collections.abc import Iterator

import numpy as np
import shapely
from matplotlib.path import Path
from numpy.typing import NDArray

from fdjax.plan.toolpath import Road
from fdjax.view.sheet import compound_path

_STEP = 0.01
"""Widths nearer than this are drawn alike, mm."""

_LONGEST = 64
"""Most segments of one strip: the time for one grows faster than its length."""


def strips(road: Road) -> list[Path]:
    """What the road covers at its true width, mm, as closed paths with round joins and ends.

    A long road is several paths, which overlap where they meet.

    >>> (strip,) = strips(Road(np.array([(0, 0), (10, 0)]), 0.5))
    >>> [float(side) for side in strip.get_extents().extents]
    [-0.25, -0.25, 10.25, 0.25]
    """
    lines, radii = [], []
    for part, width in _runs(road):
        lines.append(shapely.linestrings(road.path[part]))
        radii.append(width / 2)
    shapes = shapely.buffer(np.array(lines), np.array(radii), quad_segs=6)
    return [compound_path(shape) for shape in shapes if not shape.is_empty]


def _runs(road: Road) -> Iterator[tuple[NDArray[np.intp], float]]:
    """Indices of the points of pieces that are equally wide, and their widths, mm."""
    steps = np.round(road.width / _STEP)
    changes = np.flatnonzero(np.diff(steps)) + 1
    cuts = np.union1d(changes, np.arange(0, len(steps), _LONGEST))
    for start, end in zip(cuts, [*cuts[1:], len(steps)], strict=True):
        yield np.arange(start, end + 1), float(road.width[start])
