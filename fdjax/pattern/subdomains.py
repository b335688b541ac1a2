"""A region cut into sub-domains: a grid, Voronoi cells, level sets of the target, or as given.

Loads no JAX.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from contourpy import FillType, contour_generator
from numpy.typing import NDArray
from scipy.spatial import KDTree

from fdjax.errors import InputError
from fdjax.part.region import Region
from fdjax.target.target import Target

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Outline = shapely.Polygon | shapely.MultiPolygon

_SAME = 1e-6
"""Sub-domains overlap or leave gaps from this share of the region's area on."""

_BEYOND = 1e-3
"""Cells around sites reach so far beyond the region's box, as a share of what lies between sites
that are far apart: they end at the region's walls."""

_NEIGHBOURS = 16
"""So many neighbours of a site are looked for at first; most cells have six."""

_LOOKS = 240
"""Places along each side of a region at which level sets of the target are looked for."""


def whole(region: Region) -> list[Outline]:
    return [region.geometry]


def grid(region: Region, columns: int, rows: int) -> list[Outline]:
    """Cells of a grid over the bounding box, row by row from the lower left."""
    x0, y0, x1, y1 = region.bounds
    x, y = np.linspace(x0, x1, columns + 1), np.linspace(y0, y1, rows + 1)
    boxes = [
        shapely.box(x[i], y[j], x[i + 1], y[j + 1]) for j in range(rows) for i in range(columns)
    ]
    return _parts(region, boxes)


def voronoi(region: Region, sites: Sequence[tuple[float, float]]) -> list[Outline]:
    """What lies nearer to each of some sites, mm, than to all others, in their order.

    Raises `InputError` for two sites at one place.
    """
    xy = np.asarray(sites, float)
    tree = KDTree(xy)
    if len(twins := tree.query_pairs(1e-6, output_type="ndarray")):
        x, y = xy[twins.min()]
        raise InputError(f"sub-domains: two sites at ({x:g}, {y:g})")
    low, high = np.reshape(region.bounds, (2, 2))
    far = 8 * float(np.ptp(np.concatenate([xy, [low, high]]), axis=0).max())
    cells = np.full(len(xy), shapely.box(*(low - _BEYOND * far), *(high + _BEYOND * far)))
    # Half planes, one by one: exact on regular sites, where diagrams of libraries are not.
    left, looked, known = np.arange(len(xy)), 0, 1
    while len(left):
        known = min(max(2 * known, _NEIGHBOURS), len(xy))
        near = tree.query(xy[left], known)[1].reshape(len(left), -1)
        going = np.ones(len(left), bool)
        for nth in range(looked + 1, known):
            going[going] = _cut(cells, left[going], xy, near[going, nth], far)
        left, looked = left[going & (known < len(xy))], known - 1
    return _parts(region, cells)


def _cut(
    cells: NDArray[np.object_], owners: Ints, xy: Floats, others: Ints, far: float
) -> NDArray[np.bool_]:
    """Cut the cells of these sites by the half planes nearer to them than to others; whether a site
    that is further than the other may do so as well.
    """
    towards = xy[others] - xy[owners]
    apart = np.hypot(*towards.T)
    corners, of = shapely.get_coordinates(cells[owners], return_index=True)
    away = corners - xy[owners][of]
    reach = np.zeros(len(owners))
    np.maximum.at(reach, of, np.hypot(*away.T))
    over = np.zeros(len(owners), bool)
    np.logical_or.at(over, of, (away * towards[of]).sum(1) > apart[of] ** 2 / 2)
    along = (towards / apart[:, None])[over]
    across = np.stack([-along[:, 1], along[:, 0]], 1)
    middle = (xy[owners] + towards / 2)[over]
    square = [middle - far * across, middle + far * across]
    square += [square[1] - far * along, square[0] - far * along]
    cells[owners[over]] = shapely.intersection(
        cells[owners[over]], shapely.polygons(np.stack(square, 1))
    )
    return apart <= 2 * reach


def levels(region: Region, target: Target, values: Sequence[float], z: float) -> list[Outline]:
    """Where the solid share that is asked lies between one value and the next, from the least on.

    `z`: height at which the target is looked at, mm. Raises `InputError` for values that do not
    rise or leave a sub-domain empty.
    """
    if any(b <= a for a, b in pairwise(values)):
        raise InputError("sub-domains: levels must rise")
    x0, y0, x1, y1 = region.bounds
    # A little beyond, so that the region's walls are not the lattice's.
    x, y = (
        np.linspace(a - 0.01 * (b - a), b + 0.01 * (b - a), _LOOKS) for a, b in ((x0, x1), (y0, y1))
    )
    solid = np.asarray(target.solid(x[None, :], y[:, None], z))
    bounds = [-1.0, *values, 2.0]
    generator = contour_generator(x, y, np.nan_to_num(solid), fill_type=FillType.OuterOffset)
    parts = []
    for low, high in pairwise(bounds):
        polygons = []
        for points, offsets in zip(*generator.filled(low, high), strict=True):
            loops = np.split(points, offsets[1:-1])
            loops = [loop for loop in loops if len(loop) > 3]
            if loops:
                polygons.append(shapely.make_valid(shapely.Polygon(loops[0], loops[1:])))
        parts.append(shapely.union_all(polygons))
    return _parts(region, parts)


def given(region: Region, polygons: Sequence[Any]) -> list[Outline]:
    """Polygons as given. Raises `InputError`, with the place, where they overlap or leave gaps."""
    made = [shapely.Polygon(points) for points in polygons]
    for number, polygon in enumerate(made, 1):
        if not polygon.is_valid or polygon.area == 0:
            raise InputError(f"sub-domain {number} crosses itself or has no area")
    small = _SAME * region.area
    pairs = shapely.STRtree(made).query(made, predicate="intersects").T
    for i, j in sorted(pairs[pairs[:, 1] < pairs[:, 0]].tolist()):
        both = made[i].intersection(made[j]).intersection(region.geometry)
        if both.area > small:
            raise InputError(f"sub-domains {j + 1} and {i + 1} overlap at {_place(both)}")
    left = region.geometry.difference(shapely.union_all(made))
    if left.area > small:
        raise InputError(f"sub-domains leave a gap at {_place(left)}")
    return _parts(region, made)


def places_in(outline: Outline, along: int, least: float = 0.0) -> Floats:
    """Places evenly over an outline, (n, 2), mm: `along` of them on the longer side of its box, or
    as many as are `least` mm apart; at least one.
    """
    x0, y0, x1, y1 = outline.bounds
    step = max(max(x1 - x0, y1 - y0) / along, least)
    x, y = (np.arange(a + step / 2, b, step) for a, b in ((x0, x1), (y0, y1)))
    xy = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    xy = xy[shapely.contains_xy(outline, *xy.T)]
    return xy if len(xy) else shapely.get_coordinates(shapely.point_on_surface(outline))


def _parts(region: Region, geometries: Iterable[Any]) -> list[Outline]:
    """What of the region lies in each cell; cells beside it are left out."""
    cells = np.array(geometries, object)
    outline = region.geometry
    shapely.prepare(outline)
    # Most of many cells lie inside.
    cut = ~shapely.covers(outline, cells)
    inside = cells.copy()
    inside[cut] = shapely.intersection(outline, cells[cut])
    parts, owner = shapely.get_parts(inside, return_index=True)
    keep = (shapely.get_type_id(parts) == shapely.GeometryType.POLYGON) & (
        shapely.area(parts) > _SAME * region.area
    )
    parts, owner = parts[keep], owner[keep]
    many = np.bincount(owner, minlength=len(cells))
    return [
        polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
        for polygons in np.split(parts, np.cumsum(many)[:-1])
        if len(polygons)
    ]


def _place(geometry: shapely.Geometry) -> str:
    at = shapely.get_coordinates(shapely.point_on_surface(geometry))[0]
    return f"({at[0]:.4g}, {at[1]:.4g}) mm"
