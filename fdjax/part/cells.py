"""The exact area of a region in each cell of a lattice. Loads no JAX."""

import numpy as np
import shapely
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def cells(start: float, end: float, side: float) -> tuple[Floats, Floats]:
    """Edges and middles of cells of about this side that fill the interval exactly."""
    edges = np.linspace(start, end, max(1, round((end - start) / side)) + 1)
    return edges, (edges[1:] + edges[:-1]) / 2


def cell_areas(region: shapely.Geometry, x: Floats, y: Floats) -> Floats:
    """Area of polygons with holes in each cell between equally spaced edges, shape (nx, ny), mm^2.

    What lies outside the lattice counts nowhere. By Green's theorem: each piece of boundary within
    a cell says what lies to its right in that cell and in all the cells beyond.

    >>> box = shapely.box(0.5, 0, 2, 1)
    >>> cell_areas(box, np.arange(3.0), np.arange(2.0)).tolist()
    [[0.5], [1.0]]
    """
    nx, ny = len(x) - 1, len(y) - 1
    side = np.array([(x[-1] - x[0]) / nx, (y[-1] - y[0]) / ny])
    start, end = _boundary(region)
    start, end = ((points - [x[0], y[0]]) / side for points in (start, end))
    start, end = _cut(*_cut(start, end, 1), 0)
    middle, rise = (start + end) / 2, end[:, 1] - start[:, 1]
    row = np.floor(middle[:, 1]).astype(int)
    column = np.clip(np.floor(middle[:, 0]).astype(int), -1, nx - 1)
    kept = (row >= 0) & (row < ny) & (middle[:, 0] < nx)
    row, column, rise, at = row[kept], column[kept], rise[kept], middle[kept, 0]
    # An upward edge of a counter-clockwise ring has the region on its left.
    place, size = (column + 1) * ny + row, (nx + 1) * ny
    beyond = np.bincount(place, -rise, size).reshape(nx + 1, ny)
    within = np.bincount(place, -rise * (column + 1 - at), size).reshape(nx + 1, ny)
    passed = np.cumsum(beyond, 0)[:-1]
    return np.maximum(passed + within[1:], 0.0) * side.prod()


def _boundary(region: shapely.Geometry) -> tuple[Floats, Floats]:
    """Starts and ends of all edges, outlines counter-clockwise and holes clockwise."""
    oriented = shapely.orient_polygons(region)
    rings = shapely.get_rings(shapely.get_parts(oriented))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    own = ring[1:] == ring[:-1]
    return points[:-1][own], points[1:][own]


def _cut(start: Floats, end: Floats, axis: int) -> tuple[Floats, Floats]:
    """The segments cut where this coordinate is whole."""
    a, b = start[:, axis], end[:, axis]
    low = np.floor(np.minimum(a, b)) + 1
    count = np.maximum(np.ceil(np.maximum(a, b)) - low, 0).astype(int)
    pieces = count + 1
    owner = np.repeat(np.arange(len(a)), pieces)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    rising = (b >= a)[owner]
    # The k-th cut from the start on, rising or falling.
    whole = np.where(rising, low[owner] + number, low[owner] + count[owner] - 1 - number)
    last = number == count[owner]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (whole - a[owner]) / (b - a)[owner]
    cut = start[owner] + np.where(last, 1.0, share)[:, None] * (end - start)[owner]
    cut[~last, axis] = whole[~last]
    cut[last] = end[owner[last]]
    first = number == 0
    before = np.empty_like(cut)
    before[first] = start
    before[~first] = cut[:-1][~first[1:]]
    return before, cut
