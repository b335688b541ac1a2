"""Roads with fewer points."""

from dataclasses import replace

import numpy as np
from shapely import get_coordinates, linestrings, simplify

from fdjax.plan.toolpath import Road


def simplify_road(road: Road, *, tolerance: float = 1e-3) -> Road:
    """Drop points that lie within `tolerance` mm of the centre line without them.

    Douglas and Peucker's rule on each stretch of equal width, so that no change of width moves.

    >>> road = simplify_road(Road([(0, 0), (1, 0), (2, 0), (2, 5)], 0.4))
    >>> road.xy.tolist()
    [[0.0, 0.0], [2.0, 0.0], [2.0, 5.0]]
    """
    path, width = road.path, road.width
    stretch = np.concatenate([[0], np.cumsum(np.diff(width) != 0)])
    # Where the width changes a point ends one stretch and starts the next: it stands twice.
    vertex = np.arange(len(width))
    twice = np.flatnonzero(np.diff(stretch)) + 1
    index = np.concatenate([vertex, twice, [len(width)]])
    owner = np.concatenate([stretch, stretch[twice - 1], stretch[-1:]])
    order = np.lexsort((index, owner))
    courses = linestrings(path[index[order]], indices=owner[order])
    xy, owner = get_coordinates(
        simplify(courses, tolerance, preserve_topology=False), return_index=True
    )
    starts = np.concatenate([[0], twice])
    first = np.concatenate([[True], owner[1:] != owner[:-1]])
    points, widths = np.vstack([xy[first][:1], xy[~first]]), width[starts][owner[~first]]
    if len(points) < 3 and road.closed:
        return road
    return replace(road, xy=points[:-1] if road.closed else points, width=widths)
