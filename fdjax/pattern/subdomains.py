"""A region cut into sub-domains: a grid, Voronoi cells, level sets of the target, or as given.

Loads no JAX.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from contourpy import FillType, contour_generator

from fdjax.errors import InputError
from fdjax.part.region import Region
from fdjax.target.target import Target

Outline = shapely.Polygon | shapely.MultiPolygon

_SAME = 1e-6
"""Sub-domains overlap or leave gaps from this share of the region's area on."""

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
    apart = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    if len(xy) > 1 and apart.min() < 1e-6:
        x, y = xy[np.unravel_index(np.argmin(apart), apart.shape)[0]]
        raise InputError(f"sub-domains: two sites at ({x:g}, {y:g})")
    size = float(np.ptp(np.concatenate([xy, np.reshape(region.bounds, (2, 2))]), axis=0).max())
    cells = []
    for k, site in enumerate(xy):
        cell = shapely.box(*(site - 3 * size), *(site + 3 * size))
        # Half planes, one by one: exact on regular sites, where diagrams of libraries are not.
        for other in xy[np.argsort(apart[k], kind="stable")[:-1]]:
            farthest = np.hypot(*(shapely.get_coordinates(cell) - site).T).max()
            if np.hypot(*(other - site)) > 2 * farthest:
                break
            middle, along = (site + other) / 2, (other - site) / np.hypot(*(other - site))
            across = np.array([-along[1], along[0]])
            far = 8 * size
            corners = [
                middle - far * across,
                middle + far * across,
                middle + far * across - far * along,
                middle - far * across - far * along,
            ]
            cell = cell.intersection(shapely.Polygon(corners))
        cells.append(cell)
    return _parts(region, cells)


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


def places_in(outline: Outline, along: int) -> np.ndarray:
    """Places evenly over an outline, (n, 2), mm: `along` of them on the longer side of its box; at
    least one.
    """
    x0, y0, x1, y1 = outline.bounds
    step = max(x1 - x0, y1 - y0) / along
    x, y = (np.arange(a + step / 2, b, step) for a, b in ((x0, x1), (y0, y1)))
    xy = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    xy = xy[shapely.contains_xy(outline, *xy.T)]
    return xy if len(xy) else shapely.get_coordinates(shapely.point_on_surface(outline))


def _parts(region: Region, cells: Sequence[shapely.Geometry]) -> list[Outline]:
    """What of the region lies in each cell; cells beside it are left out."""
    found = []
    for cell in cells:
        inside = shapely.intersection(region.geometry, cell)
        polygons = [
            part
            for part in shapely.get_parts(inside)
            if isinstance(part, shapely.Polygon) and part.area > _SAME * region.area
        ]
        if polygons:
            found.append(polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons))
    return found


def _place(geometry: shapely.Geometry) -> str:
    at = shapely.get_coordinates(shapely.point_on_surface(geometry))[0]
    return f"({at[0]:.4g}, {at[1]:.4g}) mm"
