"""Meshes as roads: what a user says of them, and how they begin.

Triangulations whose cells are as large as the target asks, by the relation of the ideal mesh: the
length of edges an area is 2 sqrt(3) / a of triangles with side a, and 2 / a of their dual, the
honeycomb.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import shapely

from fdjax.errors import InputError
from fdjax.keys import choice, choices, key, whole
from fdjax.limits import Limits
from fdjax.mesh.dual import centre_points, circumcentres
from fdjax.mesh.size import MOST_CELLS, SizeField
from fdjax.mesh.triangulation import Triangulation, relaxed
from fdjax.part.part import Part, Slab
from fdjax.part.region import Region
from fdjax.pattern.base import AbstractSettings, road_width_key
from fdjax.pattern.coarse import Lattice
from fdjax.pattern.mesh_pattern import Cells, Edges, MeshPattern, Pieces
from fdjax.road.bead import section_area
from fdjax.road.deposit import Points
from fdjax.road.wall_distance import WallDistance
from fdjax.target.target import Target

CELLS = {
    "triangles": ("triangles",),
    "centre-dual": ("centre",),
    "voronoi-dual": ("voronoi",),
    "triangles-and-centre-dual": ("triangles", "centre"),
    "triangles-and-voronoi-dual": ("triangles", "voronoi"),
}
"""What is laid on one layer, or on one and the next."""

POINTS = {"centre": centre_points, "voronoi": circumcentres}
"""Nodes of the duals, from those of a triangulation and its triangles."""

LENGTH = {"triangles": 2 * np.sqrt(3), "centre": 2.0, "voronoi": 2.0}
"""Length of edges an area, times the distance of the triangulation's nodes, of the ideal mesh."""

_PIECES = 3
"""Pieces of an edge to a window's side, at least."""

_WALL_STEPS = 16
"""Places to a window's side at which the distance from the walls is taken."""

_COARSE = (2, 4, 8, 16)
"""Cells along the part of the lattices by which nodes step together."""

_GOLDEN = 0.6180339887498949
"""Multiples of it begin the meshes' sequences far from each other."""


@dataclass(frozen=True)
class Mesh(AbstractSettings):
    """The edges of triangulations or of their duals, for any outline.

    Lengths in mm. See the job's keys for what each value means.
    """

    cells: str = key(
        choice(*CELLS), "what the edges enclose: triangles, the polygons around their nodes with a "
        "corner in the middle of each triangle or by Voronoi, or one on the other layer by layer",
        default="triangles",
    )  # fmt: skip
    laid: str = key(
        choice("edges", "polygons"), "each edge once, or each polygon as a closed road inside its "
        "edges", default="edges",
    )  # fmt: skip
    phases: int = key(
        whole(1, 100), "meshes that follow each other over the layers, where these are alike",
        default=5,
    )  # fmt: skip
    road_width: float = road_width_key()
    corrections: int = key(
        whole(0, 10), "times that what the plan lays beside the model is made up for", default=2,
        table="design",
    )  # fmt: skip
    controls: tuple[str, ...] = key(
        choices("nodes", least=0), "what the design may change: the meshes' nodes",
        default=["nodes"], table="design",
    )  # fmt: skip

    def __post_init__(self) -> None:
        if self.cells not in CELLS:
            raise InputError(f'cells: "{self.cells}" is not one of {", ".join(CELLS)}')

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> MeshPattern:
        """Meshes as fine as the target asks, relaxed.

        Raises `InputError` for a target without material somewhere or with cells that are too
        large or too many, and for a region with no room for a road.
        """
        flat = target.is_flat_over(part)
        sheets = list(_sheets(part, CELLS[self.cells], self.phases, flat))
        rooms = {region: region.inset(self.road_width / 2) for region in part.regions}
        stacks = _stacks(sheets)
        rim = self._rim(part, target, flat)
        fields = self._fields(stacks, target, flat, rim)
        meshes = [
            _trimmed(relaxed(field, k * _GOLDEN % 1), field, rooms[stack.region])
            for k, (field, stack) in enumerate(zip(fields, stacks, strict=True))
        ]
        places = list(rooms)
        nodes = np.concatenate([mesh.xy for mesh in meshes])
        edges, ends = self._edges(sheets, meshes, len(nodes), places)
        offsets = _offsets([len(mesh.xy) for mesh in meshes])
        links = [mesh.edges + first for mesh, first in zip(meshes, offsets, strict=False)]
        sizes = [field.at(mesh.xy) for field, mesh in zip(fields, meshes, strict=True)]
        dual = CELLS[self.cells][-1]
        triangles = Cells(
            np.concatenate([m.triangles + n for m, n in zip(meshes, offsets, strict=False)]),
            *(
                np.repeat(each, [len(mesh.triangles) for mesh in meshes])
                for each in (
                    [places.index(stack.region) for stack in stacks],
                    [stack.z for stack in stacks],
                    [stack.height for stack in stacks],
                )
            ),
        )
        points = POINTS.get(dual, centre_points)
        graph = np.concatenate([nodes, points(nodes, triangles.nodes)])
        length = np.hypot(*np.diff(graph[edges.nodes], axis=1)[:, 0].T)
        walls = WallDistance.of(list(rooms.values()), window / _WALL_STEPS)
        return MeshPattern(
            first=jnp.asarray(nodes),
            rest=jnp.asarray(nodes),
            size=jnp.asarray(np.concatenate(sizes)),
            links=jnp.asarray(np.concatenate(links)),
            edges=jax.tree.map(jnp.asarray, edges),
            pieces=jax.tree.map(jnp.asarray, _pieces(length, window / _PIECES)),
            triangles=jax.tree.map(jnp.asarray, triangles),
            walls=jax.tree.map(jnp.asarray, walls),
            coarse=tuple(
                jax.tree.map(jnp.asarray, Lattice.over(nodes, count)) for count in _COARSE
            ),
            width=self.road_width,
            dual="voronoi" if dual == "voronoi" else "centre",
            sheets=ends,
            layers=len(part.slabs),
            rim=jax.tree.map(jnp.asarray, rim),
            kind=self.cells,
            polygons=self.laid == "polygons",
        )

    def _rim(self, part: Part, target: Target, flat: bool) -> Points:
        """The roads that polygons have along the walls: none where edges are laid."""
        places, volumes = [np.zeros((0, 3))], [np.zeros(0)]
        slabs = part.slabs if self.laid == "polygons" else ()
        middles = np.full(len(part.slabs), part.height / 2) if flat else part.middles
        for slab, z in zip(slabs, middles, strict=False):
            wall = slab.region.inset(self.road_width / 2).boundary
            section = float(section_area(self.road_width, slab.height))
            for ring in shapely.get_parts(wall):
                count = max(int(np.ceil(ring.length)), 3)
                share = (np.arange(count) + 0.5) / count
                at = shapely.line_interpolate_point(ring, share, normalized=True)
                xy = shapely.get_coordinates(at)
                places.append(np.column_stack([xy, np.full(count, z)]))
                solid = np.asarray(target.solid(xy[:, 0], xy[:, 1], z))
                # It is open by a width where an edge meets the wall: 2 / pi of their density.
                packed = 1 - self.road_width * slab.height * solid / section
                open_share = 2 / np.pi * (1 - np.sqrt(np.maximum(packed, 0.0)))
                volumes.append(section * ring.length / count * (1 - open_share))
        return Points(np.concatenate(places), np.concatenate(volumes))

    def _fields(
        self, stacks: "list[_Stack]", target: Target, flat: bool, rim: Points
    ) -> list[SizeField]:
        """The size of the cells of each mesh, mm."""
        if self.laid == "polygons":
            target = _less(target, rim, stacks)
        fields: list[SizeField] = []
        for stack in stacks[:1] if flat else stacks:
            length = sum(
                LENGTH[kind] * section_area(self.road_width, slab.height)
                for kind, slab in zip(stack.kinds, stack.slabs, strict=True)
            )

            def size(x: Any, y: Any, stack: _Stack = stack, length: float = length) -> np.ndarray:
                solid = np.asarray(target.solid(x, y, stack.z))
                with np.errstate(divide="ignore"):
                    if self.laid == "edges":
                        return length / (stack.height * solid)
                    return self._of_polygons(stack, solid, length)

            fields.append(SizeField.over(stack.region.geometry, size))
        fields *= len(stacks) if flat else 1
        count = sum(
            2 * field.count(stack.region.geometry)
            for field, stack in zip(fields, stacks, strict=True)
        )
        if count > MOST_CELLS:
            raise InputError(
                f"mesh: {len(stacks)} meshes of {count:.3g} triangles together; "
                f"{MOST_CELLS:.0e} at most"
            )
        # Cells of a real mesh are no equal triangles: how much longer its edges are the first says.
        region, field = stacks[0].region, fields[0]
        mesh = relaxed(field)
        lines = shapely.linestrings(mesh.xy[mesh.edges])
        got = shapely.length(shapely.intersection(lines, region.geometry)).sum()
        ideal = field.integral(LENGTH["triangles"] / field.size, region.geometry)
        return [SizeField(each.x, each.y, each.size * got / ideal) for each in fields]

    def _of_polygons(self, stack: "_Stack", solid: np.ndarray, length: float) -> np.ndarray:
        """The size, mm, at which polygons hold a solid share.

        An edge density r gives 2 r - width r^2 of road: two roads an edge, less at the corners.
        """
        twice = sum(
            LENGTH[kind] ** 2 * section_area(self.road_width, slab.height) * self.road_width
            for kind, slab in zip(stack.kinds, stack.slabs, strict=True)
        )
        left = length**2 - twice * stack.height * solid
        if (left < 0).any():
            most = length**2 / (twice * stack.height)
            raise InputError(
                f"mesh: polygons of roads {self.road_width:g} mm wide hold a solid share of "
                f"{most:.3f} at most, and {solid.max():.3f} is asked"
            )
        return twice / (length - np.sqrt(left))

    def _edges(
        self, sheets: "list[_Sheet]", meshes: list[Triangulation], nodes: int, places: list[Region]
    ) -> tuple[Edges, tuple[tuple[int, int], ...]]:
        """The edges of all sheets, and where each sheet's begin and end."""
        first_node = _offsets([len(mesh.xy) for mesh in meshes])
        first_cell = _offsets([len(mesh.triangles) for mesh in meshes])
        pieces = []
        for sheet in sheets:
            mesh, node, cell = meshes[sheet.mesh], first_node[sheet.mesh], first_cell[sheet.mesh]
            laid = mesh.inner
            sides, cells = mesh.edges[laid] + node, mesh.beside[laid] + cell
            ends = sides if sheet.kind == "triangles" else nodes + cells[:, ::-1]
            section = sum(section_area(self.road_width, slab.height) for slab in sheet.slabs)
            alike: tuple[Any, ...] = (places.index(sheet.slabs[0].region), sheet.z, section)
            graph = (
                mesh.xy
                if sheet.kind == "triangles"
                else POINTS[sheet.kind](mesh.xy, mesh.triangles)
            )
            own = mesh.edges[laid] if sheet.kind == "triangles" else mesh.beside[laid]
            alike = (*alike, _corners(graph, own))
            pieces.append((ends, cells, sides, *(np.full(len(ends), each) for each in alike)))
        bounds = _offsets([len(piece[0]) for piece in pieces])
        return (
            Edges(*(np.concatenate(column) for column in zip(*pieces, strict=True))),
            tuple(pairwise(bounds)),
        )


class _Sheet(NamedTuple):
    """What some layers hold alike: the number of its mesh, what of it is laid, and the layers."""

    mesh: int
    kind: str
    slabs: tuple[Slab, ...]
    z: float


class _Stack(NamedTuple):
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


def _less(target: Target, rim: Points, stacks: list[_Stack]) -> Target:
    """The target with as much less everywhere as the roads along the walls hold in all."""
    held = float(np.sum(rim.volume))
    asked = 0.0
    for stack in stacks:
        x0, y0, x1, y1 = stack.region.geometry.bounds
        x, y = (each.ravel() for each in np.meshgrid(*np.linspace((x0, y0), (x1, y1), 60).T))
        inside = shapely.contains_xy(stack.region.geometry, x, y)
        solid = np.mean(np.asarray(target.solid(x[inside], y[inside], stack.z)))
        asked += float(solid) * stack.region.geometry.area * stack.height
    share = 1 - held / asked
    if share <= 0:
        raise InputError("mesh: the polygons' roads along the walls hold all that is asked")
    return Target(lambda x, y, z: share * target.solid(x, y, z), quantity="solid")


def _sheets(part: Part, kinds: tuple[str, ...], phases: int, flat: bool) -> Iterator[_Sheet]:
    """Alike layers take the sheets in turn; else each layer has one, with a mesh of its own."""
    if not flat:
        for k, (slab, middle) in enumerate(zip(part.slabs, part.middles, strict=True)):
            yield _Sheet(k, kinds[k % len(kinds)], (slab,), float(middle))
        return
    count = min(phases * len(kinds), len(part.slabs))
    for k in range(count):
        kind = kinds[k % len(kinds)]
        yield _Sheet(k // len(kinds), kind, part.slabs[k::count], part.height / 2)


def _stacks(sheets: list[_Sheet]) -> list[_Stack]:
    found = []
    for mesh in range(1 + max(sheet.mesh for sheet in sheets)):
        own = [sheet for sheet in sheets if sheet.mesh == mesh]
        slabs = tuple(slab for sheet in own for slab in sheet.slabs)
        kinds = tuple(sheet.kind for sheet in own for _ in sheet.slabs)
        found.append(_Stack(slabs, kinds, own[0].z))
    return found


def _trimmed(mesh: Triangulation, field: SizeField, room: shapely.Geometry) -> Triangulation:
    """The triangles that lie in the room for centre lines or within a cell of it."""
    middle = mesh.xy[mesh.triangles].mean(1)
    shapely.prepare(room)
    return mesh.part(shapely.distance(room, shapely.points(middle)) <= field.at(middle))


def _corners(xy: np.ndarray, edges: np.ndarray) -> float:
    """Road widths by which the two roads beside an edge are shorter than it, together, in the mean.

    In an angle t between two edges the road half a width inside loses cot(t / 2) widths.
    """
    ends = np.concatenate([edges, edges[:, ::-1]])
    along = xy[ends[:, 1]] - xy[ends[:, 0]]
    angle = np.arctan2(along[:, 1], along[:, 0])
    order = np.lexsort((angle, ends[:, 0]))
    node, angle = ends[order, 0], angle[order]
    degree = np.bincount(node, minlength=len(xy))
    first = np.cumsum(degree) - degree
    following = np.arange(len(node)) + 1
    last = following == (first + degree)[node]
    following[last] = first[node[last]]
    turn = (angle[following] - angle) % (2 * np.pi)
    # Nodes at the rim of a mesh have faces on one side only.
    whole = (degree[node] > 2) & (turn > 0) & (turn < np.pi)
    return float((1 / np.tan(turn[whole] / 2)).sum() / whole.sum() * 2)


def _offsets(counts: list[int]) -> list[int]:
    return [0, *np.cumsum(counts).tolist()]


def _pieces(length: np.ndarray, longest: float) -> Pieces:
    """Equal parts of edges of these lengths, none longer than this, mm."""
    count = np.maximum(np.ceil(length / longest), 1).astype(int)
    edge = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    return Pieces(edge, number / count[edge], (number + 1) / count[edge])
