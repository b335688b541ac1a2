"""Roads with fewer points."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import get_coordinates, linestrings, simplify

from fdjax.plan.toolpath import Road

Floats = NDArray[np.float64]


def simplify_paths(
    paths: Sequence[Floats], widths: Sequence[Floats], *, tolerance: float
) -> tuple[list[Floats], list[Floats]]:
    """Drop points that lie within `tolerance` mm of the polylines without them, all in one go.

    Douglas and Peucker's rule on each stretch of equal width, so that no change of width moves.

    - `paths`: each (points, 2), mm; `widths`: each (points - 1,), mm.
    """
    if not paths:
        return [], []
    xy, width = np.concatenate(paths), np.concatenate(widths)
    steps = np.array([len(each) for each in widths])
    path = np.repeat(np.arange(len(paths)), steps)
    segment = np.arange(len(width))
    starts = np.concatenate([[True], (width[1:] != width[:-1]) | (path[1:] != path[:-1])])
    stretch = np.cumsum(starts) - 1
    # A path has one vertex more than segments, and each stretch ends in a vertex of its own.
    ends = np.append(np.flatnonzero(starts)[1:] - 1, len(width) - 1)
    vertex = np.empty(len(width) + len(ends), int)
    vertex[segment + stretch] = segment + path
    vertex[ends + np.arange(len(ends)) + 1] = ends + path[ends] + 1
    owner = np.empty(len(vertex), int)
    owner[segment + stretch] = stretch
    owner[ends + np.arange(len(ends)) + 1] = stretch[ends]
    fewer = simplify(linestrings(xy[vertex], indices=owner), tolerance, preserve_topology=False)
    points, owner = get_coordinates(fewer, return_index=True)
    first = np.concatenate([[True], owner[1:] != owner[:-1]])
    path, width = path[ends], width[ends]
    leads = np.concatenate([[True], path[1:] != path[:-1]])
    keep = ~first | leads[owner]
    of_point, of_step = path[owner[keep]], path[owner[~first]]
    counts = [np.bincount(of, minlength=len(paths)) for of in (of_point, of_step)]
    return pieces(points[keep], counts[0]), pieces(width[owner[~first]], counts[1])


def pieces(values: Floats, counts: ArrayLike) -> list[Floats]:
    """The values in pieces of so many each, as `np.split` does slowly.

    >>> [each.tolist() for each in pieces(np.arange(3.0), [2, 1])]
    [[0.0, 1.0], [2.0]]
    """
    ends = np.cumsum(counts).tolist()
    return [values[a:b] for a, b in pairwise([0, *ends])]


def simplify_roads(roads: Sequence[Road], *, tolerance: float = 1e-3) -> list[Road]:
    """The roads with fewer points, see `simplify_paths`. A closed road keeps three at least."""
    paths, widths = simplify_paths(
        [road.path for road in roads], [road.width for road in roads], tolerance=tolerance
    )
    return [
        replace(road, xy=xy[:-1] if road.closed else xy, width=width)
        if len(xy) > 3 or not road.closed
        else road
        for road, xy, width in zip(roads, paths, widths, strict=True)
    ]


def simplify_road(road: Road, *, tolerance: float = 1e-3) -> Road:
    """Drop points that lie within `tolerance` mm of the centre line without them.

    >>> road = simplify_road(Road([(0, 0), (1, 0), (2, 0), (2, 5)], 0.4))
    >>> road.xy.tolist()
    [[0.0, 0.0], [2.0, 0.0], [2.0, 5.0]]
    """
    return simplify_roads([road], tolerance=tolerance)[0]
