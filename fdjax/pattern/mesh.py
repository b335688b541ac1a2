"""Meshes as roads: what a user says of them, and how they begin.

Triangulations whose cells are as large as the target asks, that are given, or drawn in a chart.
"""

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import shapely

from fdjax.errors import InputError
from fdjax.keys import FLAG, choice, choices, key, number, pair, whole
from fdjax.limits import Limits
from fdjax.mesh.dual import centre_points, circumcentres
from fdjax.mesh.front import ORDERS, Rules, advanced
from fdjax.mesh.given import DIAGONALS, Given, fringed
from fdjax.mesh.triangulation import Triangulation, relaxed
from fdjax.part.part import Part
from fdjax.part.region import Region
from fdjax.pattern.base import AbstractSettings, corrections_key, road_width_key
from fdjax.pattern.coarse import Lattice
from fdjax.pattern.mesh_pattern import LEAST_ANGLE, Cells, Edges, MeshPattern
from fdjax.pattern.mesh_sheets import Sheet, corners_of, offsets, pieces_of, sheets_of, stacks_of
from fdjax.pattern.mesh_sizes import Mesher, Stack, fields_of, rim_of
from fdjax.pattern.mesh_source import CHARTS, MESHES, Begun, Chart, of_given, of_quads
from fdjax.pattern.mesh_wedges import wedges_of
from fdjax.pattern.width import free_of
from fdjax.road.bead import SECTIONS
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

_PIECES = 3
"""Pieces of an edge to a window's side, at least."""

_WINDOW_STEPS = 4
"""With 2, 4 and 8 the file of triangles on a kidney had an RMS of .0063, .0048 and .0064 for a
slope, and for half of it solid .0101 and .0050 with 2 and 4: windows hold few edges, and with soft
ones a design knows little of where they end; with sharp ones its nodes come to no better place."""

_WALL_STEPS = 16
"""Places to a window's side at which the distance from the walls is taken."""

_COARSE = (2, 4, 8, 16)
"""Cells along the part of the lattices by which nodes step together."""

_KEPT = 0.9
"""Angles and edges of a given mesh that are less than others may be may shrink by this share."""

_CROSSED = 1e-9
"""Share of a side's length by which rounding may have a Voronoi edge turned over."""

_ALIKE = 1e-9
"""Layers whose heights differ by less, mm, are alike."""

_SPARE = 0.01
"""Share by which widths that are free keep from the machine's least and largest."""

_NONE = Points(np.zeros((0, 3)), np.zeros(0))

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
    mesh: tuple[Given, ...] | None = key(
        MESHES, "meshes that are laid in place of ones made for the target, in mm unless they say; "
        "several follow each other over the layers", default=None, shown="-",
    )  # fmt: skip
    through: str | None = key(
        choice(*CHARTS), "map of the unit square through which `mesh` is drawn, or else quads, "
        "each split in two", default=None, shown="-",
    )  # fmt: skip
    quads: tuple[int, int] | None = key(
        pair(whole(2, 2000)), "quads along xi and along eta of the map", default=None,
        shown="chosen",
    )  # fmt: skip
    diagonal: str = key(
        choice(*DIAGONALS), "along which quads are split: (0, 0) to (1, 1), the other, or in turn",
        default="alternating",
    )  # fmt: skip
    walls: bool = key(
        FLAG, "of edges: a closed road along each wall, at which they end", default=False
    )
    crossing: bool = key(
        FLAG, "of edges: whether roads may run across fresh ones of their layer where they meet in "
        "a node; else they touch there at most", default=True,
    )  # fmt: skip
    count: str = key(
        choice(*SECTIONS), "what a solid share is, designed for and reported: of the volume laid, "
        "which counts beads that meet in nodes twice there, or of the area covered as seen from "
        "above, which counts it once; of edges", default="volume",
    )  # fmt: skip
    method: str = key(
        choice("delaunay", "front"), "how meshes are made for the target: nodes relaxed and "
        "triangulated, or a front that advances from the walls, by the rules that follow",
        default="delaunay",
    )  # fmt: skip
    front_order: str = key(
        choice(*ORDERS), "front: the side that gets the next triangle", default="oldest"
    )
    front_height: float = key(
        number(0.5, 1.5), "front: of new triangles, in those of equal sides", default=1.0
    )
    front_reuse: float = key(
        number(0.5, 1.5), "front: cells around the place of a new node within which one of the "
        "front is taken instead", default=0.75,
    )  # fmt: skip
    front_sweeps: int = key(whole(0, 100), "front: sweeps of smoothing afterwards", default=5)
    phases: int = key(
        whole(1, 100), "meshes that follow each other over the layers, where these are alike",
        default=5,
    )  # fmt: skip
    road_width: float = road_width_key()
    corrections: int | None = corrections_key(  # pyright: ignore[reportIncompatibleVariableOverride]
        None, shown="2, of Voronoi duals 8"
    )
    controls: tuple[str, ...] = key(
        choices("nodes", "width", least=0), "what the design may change: the meshes' nodes, the "
        "road width of each edge",
        default=["nodes"], table="design",
    )  # fmt: skip

    def __post_init__(self) -> None:
        if self.cells not in CELLS:
            raise InputError(f'cells: "{self.cells}" is not one of {", ".join(CELLS)}')
        if not self.controls:
            object.__setattr__(self, "corrections", 0)
        if self.corrections is None:
            # Nodes of blunt triangles are held back; which these are is looked at anew each time.
            often = 8 if "voronoi" in CELLS[self.cells] else 2
            object.__setattr__(self, "corrections", often)
        if self.method == "front" and (self.mesh is not None or self.through is not None):
            raise InputError('method: "front" makes meshes; give no mesh and no map for them')
        for each in fields(self):
            changed = getattr(self, each.name) != each.default
            if each.name.startswith("front_") and changed and self.method != "front":
                raise InputError(f'{each.name}: it is a rule of method = "front"')
        if self.quads is not None and (self.mesh is not None or self.through is None):
            raise InputError("quads: they are of a map; give through, and no mesh")
        if self.walls and self.laid == "polygons":
            raise InputError("walls: polygons have a road along each wall anyway")
        if self.count not in SECTIONS:
            raise InputError(f'count: "{self.count}" is not one of {", ".join(SECTIONS)}')
        if self.count == "coverage" and self.laid == "polygons":
            raise InputError("count: coverage is of edges; polygons meet in no nodes")
        if self.width_is_free and self.laid == "polygons":
            raise InputError('controls: "width" is of edges; polygons have one width')

    @property
    def window_steps(self) -> int:
        return _WINDOW_STEPS

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> MeshPattern:
        """Meshes as fine as the target asks, relaxed.

        Raises `InputError` for a target without material somewhere or with cells that are too
        large or too many, and for a region with no room for a road; and for meshes that are given
        and do not lie in the part, or fold.
        """
        alike = np.ptp([slab.height for slab in part.slabs]) < _ALIKE
        flat = target.is_flat_over(part) and bool(alike)
        phases = self.phases if self.mesh is None else len(self.mesh)
        sheets = list(sheets_of(part, CELLS[self.cells], phases, flat))
        free, widths = self._widths(limits)
        margin = (widths[1] if free else self.road_width) / 2 + self.walls * self.road_width
        rooms = {region: region.inset(margin) for region in part.regions}
        stacks = stacks_of(sheets)
        rim = _NONE
        if self.laid == "polygons":
            rim = rim_of(part, target, self.road_width, flat=flat, count=self.count)
        elif self.walls:
            rim = rim_of(part, None, self.road_width, flat=flat, count=self.count)
        begun = [
            _trimmed(each, rooms[stack.region])
            for each, stack in zip(
                self._begun(stacks, part, target, flat, rim, window), stacks, strict=True
            )
        ]
        meshes = [each.mesh for each in begun]
        _check_within(meshes, rooms)
        places = list(rooms)
        nodes = np.concatenate([mesh.xy for mesh in meshes])
        edges, ends = self._edges(sheets, meshes, len(nodes), places)
        firsts = offsets([len(mesh.xy) for mesh in meshes])
        links = [mesh.edges + first for mesh, first in zip(meshes, firsts, strict=False)]
        dual = CELLS[self.cells][-1]
        triangles = Cells(
            np.concatenate([m.triangles + n for m, n in zip(meshes, firsts, strict=False)]),
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
        if dual == "voronoi":
            _check_delaunay(nodes, graph, edges, shapely.union_all(list(rooms.values())))
        length = np.hypot(*np.diff(graph[edges.nodes], axis=1)[:, 0].T)
        made = self.mesh is None and self.through is None and self.method == "delaunay"
        angles = np.concatenate([mesh.angles.min(1) for mesh in meshes])
        walls = WallDistance.of(list(rooms.values()), window / _WALL_STEPS)
        return MeshPattern(
            first=jnp.asarray(nodes),
            rest=jnp.asarray(nodes),
            size=jnp.asarray(np.concatenate([each.size for each in begun])),
            links=jnp.asarray(np.concatenate(links)),
            edges=jax.tree.map(jnp.asarray, edges),
            wedges=None
            if self.count == "volume"
            else jax.tree.map(jnp.asarray, wedges_of(sheets, meshes, len(nodes), places)),
            pieces=jax.tree.map(jnp.asarray, pieces_of(length, window / _PIECES)),
            triangles=jax.tree.map(jnp.asarray, triangles),
            walls=jax.tree.map(jnp.asarray, walls),
            coarse=tuple(
                jax.tree.map(jnp.asarray, Lattice.over(nodes, count)) for count in _COARSE
            ),
            least_angle=jnp.asarray(
                np.full(len(angles), LEAST_ANGLE)
                if made
                else np.minimum(LEAST_ANGLE, _KEPT * angles)
            ),
            least_length=jnp.asarray(np.full(len(length), np.inf) if made else _KEPT * length),
            width=self.road_width,
            free=jnp.full(len(length), free_of(self.road_width, *widths)) if free else None,
            width_range=widths,
            margin=margin,
            dual="voronoi" if dual == "voronoi" else "centre",
            sheets=ends,
            layers=len(part.slabs),
            rim=jax.tree.map(jnp.asarray, rim),
            kind=self.cells,
            polygons=self.laid == "polygons",
            ringed=self.walls,
            # The angles at nodes are those of the edges as they were joined.
            flips=made
            and dual == "voronoi"
            and "nodes" in self.controls
            and self.count == "volume",
            moving="nodes" in self.controls,
            crossing=self.crossing,
            notes=tuple(note for each in self.mesh or () for note in each.notes),
        )

    def _widths(self, limits: Limits) -> tuple[bool, tuple[float, float]]:
        """Whether edges have widths of their own, and their range, mm."""
        low, high = limits.road_width
        if not self.width_is_free:
            return False, (low, high)
        if not high < np.inf:
            raise InputError('controls: "width" needs a machine with a range of road widths')
        # Sections may still be trimmed until the mean is met.
        return True, (low * (1 + _SPARE), high * (1 - _SPARE))

    def _begun(
        self,
        stacks: list[Stack],
        part: Part,
        target: Target,
        flat: bool,
        rim: Points,
        window: float,
    ) -> list[Begun]:
        """The mesh of each stack."""
        chart = Chart.of(self.through, part, target, self.road_width) if self.through else None
        if self.mesh is not None:
            some = of_given(self.mesh, chart)
        elif chart is not None:
            counts = self.quads or chart.counts(stacks, target, self.road_width, self.count)
            some = of_quads(chart, counts, self.diagonal, len(stacks))
        else:
            polygons = self.laid == "polygons"
            sizes = fields_of(
                stacks,
                target,
                self.road_width,
                flat=flat,
                rim=rim,
                polygons=polygons,
                window=window,
                count=self.count,
                mesher=self._mesher(),
            )
            some = []
            for k, (field, stack) in enumerate(zip(sizes, stacks, strict=True)):
                mesh = self._mesher()(stack.region.geometry, field, k * _GOLDEN % 1)
                mesh = mesh if self.method == "delaunay" else fringed(mesh)
                some.append(Begun(mesh, field.at(mesh.xy)))
        return [some[k % len(some)] for k in range(len(stacks))]

    def _mesher(self) -> Mesher:
        if self.method == "delaunay":
            return lambda region, field, phase: relaxed(field, phase)
        rules = Rules(self.front_order, self.front_height, self.front_reuse, self.front_sweeps)
        return lambda region, field, phase: advanced(region, field, rules, phase)

    def _edges(
        self, sheets: list[Sheet], meshes: list[Triangulation], nodes: int, places: list[Region]
    ) -> tuple[Edges, tuple[tuple[int, int], ...]]:
        """The edges of all sheets, and where each sheet's begin and end."""
        first_node = offsets([len(mesh.xy) for mesh in meshes])
        first_cell = offsets([len(mesh.triangles) for mesh in meshes])
        pieces = []
        for sheet in sheets:
            mesh, node, cell = meshes[sheet.mesh], first_node[sheet.mesh], first_cell[sheet.mesh]
            laid = mesh.inner
            sides, cells = mesh.edges[laid] + node, mesh.beside[laid] + cell
            ends = sides if sheet.kind == "triangles" else nodes + cells[:, ::-1]
            height = sum(slab.height for slab in sheet.slabs) / len(sheet.slabs)
            alike: tuple[Any, ...] = (places.index(sheet.slabs[0].region), sheet.z, height)
            alike = (*alike, float(len(sheet.slabs)))
            graph = (
                mesh.xy
                if sheet.kind == "triangles"
                else POINTS[sheet.kind](mesh.xy, mesh.triangles)
            )
            own = mesh.edges[laid] if sheet.kind == "triangles" else mesh.beside[laid]
            alike = (*alike, corners_of(graph, own))
            pieces.append((ends, cells, sides, *(np.full(len(ends), each) for each in alike)))
        bounds = offsets([len(piece[0]) for piece in pieces])
        return (
            Edges(*(np.concatenate(column) for column in zip(*pieces, strict=True))),
            tuple(pairwise(bounds)),
        )


def _check_delaunay(
    nodes: np.ndarray, graph: np.ndarray, edges: Edges, room: shapely.Geometry
) -> None:
    """Raise `InputError` where the two ends of a Voronoi edge in the room have changed places."""
    over = np.diff(nodes[edges.sides], axis=1)[:, 0]
    ends = graph[edges.nodes]
    along = ends[:, 1] - ends[:, 0]
    order = over[:, 0] * along[:, 1] - over[:, 1] * along[:, 0]
    wrong = (order < -_CROSSED * (over**2).sum(1)) & (edges.nodes[:, 0] >= len(nodes))
    wrong &= shapely.contains_xy(room, *ends.mean(1).T)
    if wrong.any():
        x, y = nodes[edges.sides[wrong][0]].mean(0)
        raise InputError(
            f"cells: {wrong.sum()} sides of the mesh, the first at ({x:.4g}, {y:.4g}) mm, are not "
            "those of a Delaunay triangulation, so Voronoi's polygons would cross; use the "
            "centre-dual"
        )


def _check_within(meshes: list[Triangulation], rooms: dict[Region, Any]) -> None:
    """Raise `InputError` for meshes of which nothing lies in the part."""
    room = shapely.union_all(list(rooms.values()))
    for mesh in meshes:
        if not len(mesh.triangles) or not mesh.inner.any():
            low, high = np.reshape(room.bounds, (2, 2))
            raise InputError(
                f"mesh: none of its triangles lies in the part, which reaches from ({low[0]:.4g}, "
                f"{low[1]:.4g}) to ({high[0]:.4g}, {high[1]:.4g}) mm"
            )


def _trimmed(begun: Begun, room: shapely.Geometry) -> Begun:
    """The triangles that lie in the room for centre lines or within a cell of it."""
    mesh, size = begun
    middle = mesh.xy[mesh.triangles].mean(1)
    shapely.prepare(room)
    near = shapely.distance(room, shapely.points(middle)) <= size[mesh.triangles].mean(1)
    return Begun(mesh.part(near), size[np.unique(mesh.triangles[near])])
