"""How large the cells of meshes are to be for a target, and what roads along the walls take of it.

The length of edges an area is 2 sqrt(3) / a of triangles with side a, and 2 / a of their dual, the
honeycomb.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import shapely

from fdjax.errors import InputError
from fdjax.mesh.size import MOST_CELLS, Outline, SizeField
from fdjax.mesh.triangulation import Triangulation
from fdjax.part.part import Part, Slab
from fdjax.part.region import Region
from fdjax.road.bead import SECTIONS, section_area
from fdjax.road.deposit import Points
from fdjax.target.target import Target

LENGTH = {"triangles": 2 * np.sqrt(3), "centre": 2.0, "voronoi": 2.0}
"""Length of edges an area, times the distance of the triangulation's nodes, of the ideal mesh."""


Mesher = Callable[[Outline, SizeField, float], Triangulation]
"""What makes a triangulation of a region, or of more, from a size field and a phase, 0 to 1."""


class Stack(NamedTuple):
    """The layers that hold one mesh, and what each of them holds of it."""

    slabs: tuple[Slab, ...]
    kinds: tuple[str, ...]
    z: float

    @property
    def region(self) -> Region:
        return self.slabs[0].region

    @property
    def height(self) -> float:
        return sum(slab.height for slab in self.slabs)


def fields_of(
    stacks: list[Stack],
    target: Target,
    width: float,
    *,
    flat: bool,
    rim: Points,
    polygons: bool,
    window: float,
    count: str,
    mesher: Mesher,
) -> list[SizeField]:
    """The size of the cells of each mesh, mm, for roads of a width, mm, of which `count` counts."""
    section = SECTIONS[count]
    if polygons:
        target = _less(target, rim, stacks)
    ringed = bool(len(rim.volume)) and not polygons
    fields: list[SizeField] = []
    for stack in stacks[:1] if flat else stacks:
        length = sum(
            LENGTH[kind] * section(width, slab.height)
            for kind, slab in zip(stack.kinds, stack.slabs, strict=True)
        )

        def size(x: Any, y: Any, stack: Stack = stack, length: float = length) -> np.ndarray:
            solid = np.asarray(target.solid(x, y, stack.z))
            if ringed:
                solid = _beside(stack, solid, x, y, width, window, count)
            with np.errstate(divide="ignore"):
                if polygons:
                    return _of_polygons(stack, solid, length, width)
                if count == "coverage":
                    return _covering(stack, solid, length, width)
                return length / (stack.height * solid)

        fields.append(SizeField.over(stack.region.geometry, size))
    fields *= len(stacks) if flat else 1
    cells = sum(
        2 * field.count(stack.region.geometry) for field, stack in zip(fields, stacks, strict=True)
    )
    if cells > MOST_CELLS:
        raise InputError(
            f"mesh: {len(stacks)} meshes of {cells:.3g} triangles together; {MOST_CELLS:.0e} at "
            "most"
        )
    # Cells of a real mesh are no equal triangles: how much longer its edges are the first says.
    region, field = stacks[0].region, fields[0]
    mesh = mesher(region.geometry, field, 0.0)
    lines = shapely.linestrings(mesh.xy[mesh.edges[mesh.inner]])
    got = shapely.length(shapely.intersection(lines, region.geometry)).sum()
    ideal = field.integral(LENGTH["triangles"] / field.size, region.geometry)
    return [SizeField(each.x, each.y, each.size * got / ideal) for each in fields]


def _of_polygons(stack: Stack, solid: np.ndarray, length: float, width: float) -> np.ndarray:
    """The size, mm, at which polygons hold a solid share.

    An edge density r gives 2 r - width r^2 of road: two roads an edge, less at the corners.
    """
    twice = sum(
        LENGTH[kind] ** 2 * section_area(width, slab.height) * width
        for kind, slab in zip(stack.kinds, stack.slabs, strict=True)
    )
    left = length**2 - twice * stack.height * solid
    if (left < 0).any():
        most = length**2 / (twice * stack.height)
        raise InputError(
            f"mesh: polygons of roads {width:g} mm wide hold a solid share of {most:.3f} at most, "
            f"and {solid.max():.3f} is asked"
        )
    return twice / (length - np.sqrt(left))


def _covering(stack: Stack, solid: np.ndarray, length: float, width: float) -> np.ndarray:
    """The size, mm, at which edges cover a solid share.

    Of an ideal cell with edges of the density r `(1 - width r / 2)^2` stays open.
    """
    twice = sum(
        (LENGTH[kind] * width) ** 2 * slab.height
        for kind, slab in zip(stack.kinds, stack.slabs, strict=True)
    )
    held = stack.height * solid
    return (length + np.sqrt(np.maximum(length**2 - twice * held, 0.0))) / (2 * held)


def _beside(
    stack: Stack, solid: np.ndarray, x: Any, y: Any, width: float, window: float, count: str
) -> np.ndarray:
    """The solid share that is left for edges beside a road along the walls.

    What the road holds is taken off within a window of it, most of it near the wall, and nowhere
    more than half of what is asked.
    """
    wall = stack.region.geometry.boundary
    shapely.prepare(wall)
    away = np.minimum(shapely.distance(wall, shapely.points(x, y)) / window, 1)
    section = sum(SECTIONS[count](width, slab.height) for slab in stack.slabs) / stack.height
    return np.maximum(solid - 2 * (1 - away) * section / window, solid / 2)


def rim_of(part: Part, target: Target | None, width: float, *, flat: bool, count: str) -> Points:
    """The roads along the walls, of a width, mm: whole, or those of polygons of a target."""
    places, volumes = [np.zeros((0, 3))], [np.zeros(0)]
    middles = np.full(len(part.slabs), part.height / 2) if flat else part.middles
    for slab, z in zip(part.slabs, middles, strict=True):
        wall = slab.region.inset(width / 2).boundary
        section = float(SECTIONS[count](width, slab.height))
        for ring in shapely.get_parts(wall):
            many = max(int(np.ceil(ring.length)), 3)
            share = (np.arange(many) + 0.5) / many
            at = shapely.line_interpolate_point(ring, share, normalized=True)
            xy = shapely.get_coordinates(at)
            places.append(np.column_stack([xy, np.full(many, z)]))
            if target is None:
                volumes.append(np.full(many, section * ring.length / many))
                continue
            solid = np.asarray(target.solid(xy[:, 0], xy[:, 1], z))
            # It is open by a width where an edge meets the wall: 2 / pi of their density.
            packed = 1 - width * slab.height * solid / section
            open_share = 2 / np.pi * (1 - np.sqrt(np.maximum(packed, 0.0)))
            volumes.append(section * ring.length / many * (1 - open_share))
    return Points(np.concatenate(places), np.concatenate(volumes))


def _less(target: Target, rim: Points, stacks: list[Stack]) -> Target:
    """The target with as much less everywhere as the roads along the walls hold in all."""
    held = float(np.sum(rim.volume))
    asked = sum(
        mean_solid(target, stack) * stack.region.geometry.area * stack.height for stack in stacks
    )
    share = 1 - held / asked
    if share <= 0:
        raise InputError("mesh: the polygons' roads along the walls hold all that is asked")
    return Target(lambda x, y, z: share * target.solid(x, y, z), quantity="solid")


def mean_solid(target: Target, stack: Stack) -> float:
    """The mean solid share that is asked in a stack's region."""
    x0, y0, x1, y1 = stack.region.geometry.bounds
    x, y = (each.ravel() for each in np.meshgrid(*np.linspace((x0, y0), (x1, y1), 60).T))
    inside = shapely.contains_xy(stack.region.geometry, x, y)
    return float(np.mean(np.asarray(target.solid(x[inside], y[inside], stack.z))))
