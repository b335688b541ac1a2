"""Edges of meshes as roads: the nodes of several meshes, one a layer, are the controls.

The deposit is that of the edges themselves, cut at the walls: nothing is a mean but the layers, and
the nodes move until it is right. Where Voronoi's polygons are laid, meshes that were made for a
target are joined anew, as Delaunay's triangles, where nodes have moved; others stay joined as they
are, for a flip of theirs moves a road at once, and a design gains nothing by it.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.limits import Limits
from fdjax.mesh.dual import centre_points, circumcentres
from fdjax.mesh.flips import Joined, flipped
from fdjax.mesh.triangulation import Triangulation
from fdjax.pattern.base import AbstractPattern, Penalties
from fdjax.pattern.coarse import Lattice
from fdjax.pattern.mesh_sheets import Pieces
from fdjax.pattern.mesh_wedges import Wedges, excess
from fdjax.pattern.width import within
from fdjax.road.bead import SECTIONS
from fdjax.road.deposit import Points
from fdjax.road.stroke import Graph, Polygons, Rings, Stroke
from fdjax.road.wall_distance import WallDistance, inside

FAMILY = "mesh"
"""The name that its roads carry."""

RING = "wall"
"""The name of those along the walls."""

LEAST_ANGLE = 17.0
"""Of a triangle that is made for a target, degrees: nodes come no nearer to folding it."""

_STIFF = 10.0
"""Nodes that move against each other by this share of a cell everywhere are a roughness of one,
turned over."""


_WIDTHS = 5.0
"""A step of widths beside one of nodes: with 1, 5 and 30 the error in the model of a plate was
.0024, .0013 and .0008, but that of its file .0072, .0076 and .0084, as with 30 many roads come to
the machine's least and largest."""

_PATIENCE = {"centre": 0.1, "voronoi": 0.04}
"""A window with sharp edges differs from a soft one by more than what a longer design gains; but
Voronoi's points come along slowly."""

_TURNED = 0.5
"""Share of the least length by which a Voronoi edge that is flipped later may be turned over."""

_BLUNT = 4
"""Power of a triangle's bluntness by which its nodes step less: with 1, 2, 4 and 8 the error in the
model after forty steps was .0078, .0064, .0060 and .0065, and .0082 with none."""


class Edges(NamedTuple):
    """All edges of all meshes, sheet by sheet: a sheet is what one layer holds.

    Numbers are over all meshes together; of the graph's nodes those of the triangulations come
    first, then the points in the triangles.

    - `nodes`: of the graph, shape (e, 2), of a dual's edge that of the triangle right of the edge
      it crosses first; `sides`: the two of the triangulation's edge itself or crossed, (e, 2).
    - `cells`: the triangles that an edge belongs to by halves, shape (e, 2).
    - `room`: number of the room that it lies in; `z`: mm; `height`: of the layers that it is laid
      on, mm, and `layers`: how many these are; each of shape (e,).
    - `corners`: road widths by which the two roads beside it, half a width from it, are shorter
      than the edge together, (e,).
    """

    nodes: Any
    cells: Any
    sides: Any
    room: Any
    z: Any
    height: Any
    layers: Any
    corners: Any


class Cells(NamedTuple):
    """The triangles of all meshes.

    - `nodes`: shape (t, 3); `room`, `z` (mm), `height` (of the layers it is laid on, together, mm).
    """

    nodes: Any
    room: Any
    z: Any
    height: Any


class Controls(NamedTuple):
    """Nodes of the triangulations, (n, 2), mm, and the edges' widths, (e,), where these are free:
    real numbers as `within` takes them.
    """

    nodes: Any
    width: Any


class Realised(NamedTuple):
    """The graph's nodes (n, 2), the ends of its edges (e, 2, 2) and their widths (e,), mm, the area
    of their sections times the number of their layers (e,), mm^2, and whether nothing folds.
    """

    xy: Array
    ends: Array
    width: Array
    section: Array
    made: Bool[Array, ""]


class MeshPattern(AbstractPattern):
    """The edges of triangulations, or of their duals, are laid; their nodes are free.

    - `first`: the nodes to start from, `rest`: where they lay before any design, both (n, 2), mm.
    - `size`: of the cells around each node, shape (n,), mm.
    - `links`: pairs of nodes that are joined in a triangulation at first, shape (l, 2).
    - `wedges`: at nodes, where they count once what beads that meet there cover.
    - `least_angle`: of each triangle, degrees; `least_length`: what of a given mesh is shorter than
      roads may be apart keeps to, of each edge, mm.
    - `walls`: distance from the walls; `width`: of the roads, mm, or where theirs begin.
    - `free`: widths of edges to start from, shape (e,), where they are controls, of what lies
      within `width_range`, mm; `moving`: whether nodes are; `margin`: what centre lines keep from
      the walls or their roads, mm.
    - `coarse`: by which nodes step together.
    - `dual`: "centre" or "voronoi" points in the triangles.
    - `sheets`: first edge of each sheet and the one beyond its last; layer k holds sheet k modulo
      their number.
    - `rim`: of polygons, the roads along the walls, and those that are laid there as such.
    - `kind`: what is laid, as the settings name it; `polygons`: whether faces are laid and not
      edges; `ringed`: whether a road is laid along each wall; `flips`: whether nodes are joined
      anew where they have moved; `crossing`: whether roads may cross in nodes; `notes`: what was
      found in given meshes, in words.
    """

    first: Array
    rest: Array
    size: Array
    links: Array
    edges: Edges
    pieces: Pieces
    wedges: Wedges | None
    triangles: Cells
    walls: WallDistance
    coarse: tuple[Lattice, ...]
    least_angle: Array
    least_length: Array
    width: float
    free: Array | None
    width_range: tuple[float, float]
    margin: float
    rim: Points
    dual: str = eqx.field(static=True)
    sheets: tuple[tuple[int, int], ...] = eqx.field(static=True)
    layers: int = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    polygons: bool = eqx.field(static=True)
    ringed: bool = eqx.field(static=True)
    flips: bool = eqx.field(static=True)
    moving: bool = eqx.field(static=True)
    crossing: bool = eqx.field(static=True)
    notes: tuple[str, ...] = eqx.field(static=True)

    def controls(self) -> Any:
        """The nodes, or `Controls` where widths are free."""
        return self.first if self.free is None else Controls(self.first, self.free)

    def at(self, controls: Any) -> "MeshPattern":
        if self.free is None:
            return eqx.tree_at(lambda p: p.first, self, controls)
        return eqx.tree_at(lambda p: (p.first, p.free), self, (controls.nodes, controls.width))

    def mended(self) -> "MeshPattern":
        """Joined as Delaunay's triangles: an edge that is not is the other diagonal of its two.

        A Voronoi edge has no length when that happens, so nothing that is laid changes at once.
        """
        if not self.flips:
            return self
        xy = np.asarray(self.first)
        sides, cells, nodes = (
            np.asarray(each) for each in (self.edges.sides, self.edges.cells, self.edges.nodes)
        )
        # An edge and what crosses it may lie on two sheets.
        _, once, number = np.unique(
            np.sort(sides, axis=1), axis=0, return_index=True, return_inverse=True
        )
        was = Joined(np.asarray(self.triangles.nodes), sides[once], cells[once])
        now, changed = flipped(xy, was)
        if not changed.any():
            return self
        sides, cells = now.edges[number], now.beside[number]
        ends = np.where(nodes[:, :1] < len(xy), sides, len(xy) + cells[:, ::-1])
        edges = self.edges._replace(
            nodes=jnp.asarray(ends), sides=jnp.asarray(sides), cells=jnp.asarray(cells)
        )
        triangles = self.triangles._replace(nodes=jnp.asarray(now.triangles))
        return eqx.tree_at(lambda p: (p.edges, p.triangles), self, (edges, triangles))

    def _split(self, controls: Any) -> tuple[Any, Any]:
        """Nodes, (n, 2), and widths of the edges, (e,), mm."""
        if self.free is None:
            return controls, jnp.full(len(self.edges.room), self.width)
        nodes = controls.nodes if self.moving else self.first
        return nodes, within(jnp.asarray(controls.width), *self.width_range)

    def realise(self, controls: Any) -> Realised:
        nodes, width = self._split(controls)
        xy = self.nodes(nodes)
        corner = nodes[self.triangles.nodes]
        area = _cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        made = (area > 0).all() & jnp.isfinite(xy).all()
        count = SECTIONS["volume" if self.wedges is None else "coverage"]
        section = count(width, self.edges.height) * self.edges.layers
        return Realised(xy, xy[self.edges.nodes], width, section, made)

    def nodes(self, nodes: Any) -> Any:
        """The graph's nodes: those of the triangulations, then the points in the triangles."""
        points = centre_points if self.dual == "centre" else circumcentres
        return jnp.concatenate([nodes, points(nodes, self.triangles.nodes)])

    def deposit(self, realised: Realised) -> Points:
        pieces, edge = self.pieces, self.pieces.edge
        first, along = realised.ends[:, 0], realised.ends[:, 1] - realised.ends[:, 0]
        start, end = (first[edge] + at[:, None] * along[edge] for at in (pieces.start, pieces.end))
        room = self.edges.room[edge]
        share, middle = inside(start, end, self.walls.at(start, room), self.walls.at(end, room))
        run = share * (pieces.end - pieces.start) * self._laid(_length(along), realised.width)[edge]
        xyz = jnp.concatenate([middle, self.edges.z[edge][:, None]], 1)
        some = [(xyz, run * realised.section[edge]), self.rim]
        if self.wedges is not None:
            some += [self._excess(self.wedges, realised), self._ends(realised)]
        return Points(*(jnp.concatenate(column) for column in zip(*some, strict=True)))

    def _excess(self, wedges: Wedges, realised: Realised) -> tuple[Array, Array]:
        """What is covered twice at nodes, where, and how much less than nothing that is, mm^3."""
        corner = realised.xy[wedges.nodes]
        # Near the walls nodes are moved to them and become one.
        a, b = realised.width[wedges.edges].T / 2
        share = jnp.clip(self.walls.at(corner[:, 0], wedges.room) / (a + b) + 0.5, 0, 1)
        twice = excess(corner, a, b) * share
        return jnp.concatenate([corner[:, 0], wedges.z[:, None]], 1), -twice * wedges.height

    def _ends(self, realised: Realised) -> tuple[Array, Array]:
        """Round ends of edges that a wall cuts, less the nearer one of their nodes is to it."""
        start, end = realised.ends[:, 0], realised.ends[:, 1]
        edges = self.edges
        before, after = self.walls.at(start, edges.room), self.walls.at(end, edges.room)
        cut = (before > 0) != (after > 0)
        near, far = jnp.minimum(before, after), jnp.maximum(before, after)
        share = before / jnp.where(cut, before - after, 1.0)
        whole = jnp.clip(jnp.minimum(-near, far) / realised.width * 2, 0, 1) * cut
        xy = start + jnp.where(cut, share, 0.0)[:, None] * (end - start)
        # A rectangle's section over its width is the height.
        half_disc = jnp.pi / 8 * realised.width * realised.section
        return jnp.concatenate([xy, edges.z[:, None]], 1), half_disc * whole

    def _laid(self, length: Array, width: Array) -> Array:
        """Length of road, mm, for each edge (e,) of these lengths and widths."""
        return 2 * length - self.edges.corners * width if self.polygons else length

    def cells(self, realised: Realised) -> tuple[Array, Array, Array]:
        cells = self.triangles
        length = _length(realised.ends[:, 1] - realised.ends[:, 0])
        half = self._laid(length, realised.width) * realised.section / 2
        held = jnp.zeros(len(cells.room)).at[self.edges.cells].add(half[:, None])
        if self.wedges is not None:
            held = held.at[self.wedges.cell].add(self._excess(self.wedges, realised)[1])
        corner = realised.xy[cells.nodes]
        area = _cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2
        middle = corner.mean(1)
        volume = area * cells.height
        within = self.walls.at(middle, cells.room) > 0
        xyz = jnp.concatenate([middle, cells.z[:, None]], 1)
        return xyz, 1 - held / volume, jnp.where(within, volume, 0.0)

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        """Angles of triangles below their least, and edges shorter than roads may be apart, of a
        Voronoi diagram below none, or turned over as far as is mended; none where nodes stay.
        """
        if not self.moving:
            return {}
        corner = realised.xy[self.triangles.nodes]
        first, second = jnp.roll(corner, -1, 1) - corner, jnp.roll(corner, 1, 1) - corner
        across = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
        angle = jnp.degrees(jnp.arctan2(across, (first * second).sum(-1)))
        along = realised.ends[:, 1] - realised.ends[:, 0]
        least = jnp.minimum(limits.least_spacing or realised.width, self.least_length)
        excess = 1 - _length(along) / least
        if self.dual == "voronoi":
            # The plan contracts short edges; but the centres of two triangles that are no longer
            # Delaunay's have changed places, and roads would cross.
            side = realised.xy[self.edges.sides]
            over = side[:, 1] - side[:, 0]
            of_dual = self.edges.nodes[:, 0] >= len(self.first)
            turned = -_cross(over, along) / _length(over) / least - _TURNED * self.flips
            excess = jnp.where(of_dual, turned, excess)
        # What lies beyond a wall is not laid: only what would reach back into the room counts.
        beyond = jax.nn.relu(-self.walls.at(realised.ends.mean(1), self.edges.room))
        return {
            "angle": (1 - angle / self.least_angle[:, None]).ravel(),
            "edge": excess - 2 * beyond / least,
        }

    def roughness(self, controls: Any) -> Float[Array, " n"]:
        moved = self._split(controls)[0] - self.rest
        a, b = self.links.T
        strain = (moved[a] - moved[b]) / ((self.size[a] + self.size[b]) / 2)[:, None]
        rough = _STIFF * strain.ravel() / np.sqrt(len(self.links))
        if self.free is None:
            return rough
        strayed = controls.width - controls.width.mean()
        return jnp.concatenate([rough, strayed / np.sqrt(len(strayed))])

    def scale(self, step: Any) -> Any:
        if self.free is not None:
            return Controls(self._scaled(step.nodes), _WIDTHS * step.width)
        return self._scaled(step)

    def _scaled(self, step: Array) -> Array:
        own = step * (self.size * self._ease())[:, None]
        return sum((each.moved(step) for each in self.coarse), own)

    def _ease(self) -> Array:
        """How much of a step each node takes, (n,): of a Voronoi diagram less at blunt triangles,
        whose middles run far for a short step and would have all others wait.
        """
        if self.dual != "voronoi":
            return jnp.ones(len(self.first))
        nodes = self.triangles.nodes
        corner = self.first[nodes]
        along = jnp.roll(corner, -1, 1) - corner
        sides = jnp.sqrt((along**2).sum(2))
        area = _cross(along[:, 0], along[:, 1]) / 2
        # Radius of the circle around over twice that of the circle within: 1 for equal sides.
        blunt = sides.prod(1) * sides.sum(1) / (16 * area**2)
        worst = jnp.ones(len(self.first)).at[nodes].max(blunt[:, None])
        return worst**-_BLUNT

    @property
    def patience(self) -> float:
        return _PATIENCE["voronoi" if self.dual == "voronoi" else "centre"]

    def widths(self, realised: Realised) -> tuple[Array, Array]:
        return realised.width.min(), realised.width.max()

    def strokes(self, controls: Any) -> Iterator[Sequence[Stroke]]:
        nodes, width = self._split(controls)
        xy, width = np.asarray(self.nodes(nodes)), np.asarray(width)
        ends = np.asarray(self.edges.nodes)
        sheets = [self._sheet(xy, ends[a:b], width[a:b]) for a, b in self.sheets]
        for layer in range(self.layers):
            yield sheets[layer % len(sheets)]

    def _sheet(self, xy: np.ndarray, edges: np.ndarray, width: np.ndarray) -> list[Stroke]:
        nodes, number = np.unique(edges, return_inverse=True)
        kind = Polygons if self.polygons else Graph
        # A plan keeps half the widest road from the walls by itself.
        margin = max(self.margin - float(width.max()) / 2, 0.0)
        graph = kind(
            xy[nodes],
            number.reshape(-1, 2),
            width,
            FAMILY,
            margin=margin,
            crossing=self.crossing,
        )
        return [Rings(self.width, RING), graph] if self.ringed else [graph]

    def facts(self, controls: Any) -> dict[str, Any]:
        """Meshes, their cells, angles and the lengths of their edges inside."""
        realised = self.realise(jax.tree.map(jnp.asarray, controls))
        xy, ends = np.asarray(realised.xy), np.asarray(realised.ends)
        laid = np.asarray(self.walls.at(jnp.asarray(ends.mean(1)), self.edges.room)) > 0
        length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)[laid]
        nodes = np.asarray(self.triangles.nodes)
        middle = jnp.asarray(xy[nodes].mean(1))
        inner = np.asarray(self.walls.at(middle, self.triangles.room)) > 0
        angles = Triangulation(xy, nodes[inner]).angles.min(1)
        facts: dict[str, Any] = {"warnings": list(self.notes)} if self.notes else {}
        if self.free is not None:
            width = np.asarray(realised.width)[laid]
            facts["edge_width"] = [float(width.min()), float(np.median(width)), float(width.max())]
        return facts | {
            "kind": "mesh",
            "cells": self.kind,
            "laid": "polygons" if self.polygons else "edges",
            "count": "volume" if self.wedges is None else "coverage",
            "sheets": len(self.sheets),
            "nodes": len(self.first),
            "triangles": int(inner.sum()),
            "edges": int(laid.sum()),
            "edge_length": [float(length.min()), float(np.median(length)), float(length.max())],
            "least_angle": float(angles.min()),
            "median_angle": float(np.median(angles)),
        }


def _cross(a: Any, b: Any) -> Any:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _length(along: Array) -> Array:
    """Lengths (n,) of vectors (n, 2), with a slope where one has none."""
    return jnp.sqrt((along**2).sum(1) + _NO_LENGTH**2)


_NO_LENGTH = 1e-9
"""mm, far below any length that matters."""
