"""The faces of a graph as closed roads: each polygon laid alone, half a road inside its edges."""

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely import MultiPolygon, Polygon

from fdjax.part.region import Region
from fdjax.plan.laid import Laid, shortest_road
from fdjax.plan.room import Room
from fdjax.plan.toolpath import Road
from fdjax.plan.trail import checked
from fdjax.road.stroke import Polygons

_APART = 2e-3
"""Roads of neighbours keep so much more than their width apart, mm, for what rounding takes."""

_SMALL = 0.3
"""A face that a wall has cut to less than this share of the median joins a neighbour."""

_SPIKE = 3.0
"""Corners sharper than of about 40 degrees are blunted: so many half widths from side to tip."""


def lay_polygons(
    polygons: Polygons,
    room: Room | Region | Polygon | MultiPolygon,
    *,
    least_road: float = 0.0,
    tolerance: float = 0.0,
    start: ArrayLike | None = None,
    **_: object,
) -> Laid:
    """Lay each face of a graph as a closed road, half the largest road width inside its sides.

    Faces end at the walls; one of which a wall leaves little joins the neighbour with which it
    shares most. A face with no room for a road inside is left out.

    - `least_road`: shorter roads are not laid, mm; nor any of less than `SHORTEST_ROAD` widths.
    - `tolerance`: what dropping points may take off a road, mm; no corner is dropped.
    - `start`: where the head comes from; the roads start near it.

    What else other strokes are laid by has no say. Raises `InputError` for edges that do not fit.

    >>> square = np.array([(0.0, 0), (4, 0), (4, 4), (0, 4)])
    >>> edges = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)])
    >>> stroke = Polygons(square, edges, np.full(5, 0.4), "mesh")
    >>> [road.closed for road in lay_polygons(stroke, shapely.box(0, 0, 4, 4)).roads]
    [True, True]
    """
    xy, edges, width = checked(polygons)
    if not len(edges):
        return Laid()
    geometry = Room.of(room).geometry
    wide = float(width.max())
    lines = np.asarray(shapely.linestrings(xy[edges]))
    meet = shapely.union_all([*lines, geometry.boundary])
    faces = np.asarray(shapely.get_parts(shapely.polygonize([meet])))
    shapely.prepare(geometry)
    faces = faces[shapely.contains(geometry, shapely.point_on_surface(faces))]
    faces = _whole(faces)
    # Where a road would lie on its own other side it does not go.
    inset = shapely.buffer(faces, -(wide + _APART) / 2, join_style="mitre", mitre_limit=20)
    deep = shapely.buffer(faces, -wide - _APART / 2, join_style="mitre", mitre_limit=20)
    opened = shapely.buffer(deep, wide / 2, join_style="mitre", mitre_limit=_SPIKE)
    inner = shapely.intersection(opened, inset)
    roads = []
    for part in np.asarray(shapely.get_parts(inner)).tolist():
        if not isinstance(part, Polygon) or part.is_empty:
            continue
        outer = shapely.simplify(part.exterior, tolerance / 2)
        ring = shapely.get_coordinates(outer)[:-1]
        if len(ring) > 2:
            roads.append(Road(ring, np.full(len(ring), wide), polygons.material, True, "polygon"))
    shortest = [shortest_road(road.width, least_road + tolerance) for road in roads]
    return Laid.of(roads, shortest, start=start)


def _whole(faces: np.ndarray) -> np.ndarray:
    """The faces, small ones joined to the neighbour with the longest common side."""
    areas = shapely.area(faces)
    small = np.flatnonzero(areas < _SMALL * np.median(areas))
    faces = faces.copy()
    tree = shapely.STRtree(faces)
    gone = np.zeros(len(faces), bool)
    for k in small[np.argsort(areas[small])].tolist():
        near = tree.query(faces[k], predicate="intersects")
        near = near[(near != k) & ~gone[near]]
        common = shapely.length(shapely.intersection(faces[near], faces[k]))
        if len(near) and common.max() > 0:
            other = near[int(np.argmax(common))]
            joined = shapely.union(faces[other], faces[k])
            if isinstance(joined, Polygon):
                faces[other], gone[k] = joined, True
    return faces[~gone]
