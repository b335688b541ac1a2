"""What beads of a graph hold more at its nodes than they cover, from the angles of its edges.

Beads are strips with round ends, seen from above. Two edges that follow each other around a node at
an angle t, with half widths a and b, share a kite of area `a b cot(t / 2)` if t is below 180
degrees; above it the round ends cover a sector of `a b (t - pi) / 2` that no strip does. Both are
(pi - t) / 2 near 180 degrees, so the sum over all angles at a node, strips less their union, is
smooth in the nodes. It is exact for equal widths as long as edges are longer than their kites: in
a triangle as long as some of it stays open.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fdjax.mesh.triangulation import Triangulation
from fdjax.part.region import Region
from fdjax.pattern.mesh_sheets import Sheet, offsets

_NARROW = 0.1
"""Edges that meet at a smaller angle, radians, are taken to meet at this one."""


class Wedges(NamedTuple):
    """Angles between edges that follow each other around a node, counterclockwise.

    - `nodes`: of the graph: the one in the middle and those at the other ends, shape (k, 3).
    - `edges`: numbers of the two edges, shape (k, 2).
    - `cell`: the triangle that it lies in; `room`: number of the room; `z`: mm; `height`: of the
      layers that it is laid on, together, mm; of shape (k,).
    """

    nodes: Any
    edges: Any
    cell: Any
    room: Any
    z: Any
    height: Any


def excess(xy: Float[Array, "k 3 2"], a: Any, b: Any) -> Float[Array, " k"]:
    """Area that strips of half widths a and b, mm, hold more than they cover, (k,), mm^2.

    - `xy`: of wedges, the node in the middle first, mm. Below 0 where an angle is over 180 degrees.

    >>> corner = jnp.array([[(0.0, 0), (1, 0), (0, 1)]])
    >>> round(float(excess(corner, 0.2, 0.2)[0]), 9)
    0.04
    """
    first, second = xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]
    across = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    angle = jnp.arctan2(across, (first * second).sum(1)) % (2 * jnp.pi)
    kite = 1 / jnp.tan(jnp.clip(angle, _NARROW, jnp.pi) / 2)
    return a * b * jnp.where(angle < jnp.pi, kite, (jnp.pi - angle) / 2)


def wedges_of(
    sheets: list[Sheet], meshes: list[Triangulation], nodes: int, places: list[Region]
) -> Wedges:
    """The angles at the nodes of all sheets, in the triangles with a neighbour on each side."""
    first_node = offsets([len(mesh.xy) for mesh in meshes])
    first_cell = offsets([len(mesh.triangles) for mesh in meshes])
    first_edge, pieces = 0, []
    for sheet in sheets:
        mesh, node, cell = meshes[sheet.mesh], first_node[sheet.mesh], first_cell[sheet.mesh]
        number = first_edge + np.cumsum(mesh.inner) - 1
        first_edge += int(mesh.inner.sum())
        own = np.flatnonzero(np.all(mesh.inner[mesh.sides], axis=1))
        # Side k leads from corner k to the next: it follows side k - 1 around both kinds of node.
        side = mesh.sides[own]
        if sheet.kind == "triangles":
            corner = mesh.triangles[own] + node
            around = [(corner[:, k], corner[:, k - 2], corner[:, k - 1]) for k in range(3)]
            edges = [(side[:, k], side[:, k - 1]) for k in range(3)]
        else:
            beyond = mesh.beside[side].sum(2) - own[:, None] + nodes + cell
            middle = own + nodes + cell
            around = [(middle, beyond[:, k - 1], beyond[:, k]) for k in range(3)]
            edges = [(side[:, k - 1], side[:, k]) for k in range(3)]
        height = sum(slab.height for slab in sheet.slabs)
        alike = (places.index(sheet.slabs[0].region), sheet.z, height)
        for ends, two in zip(around, edges, strict=True):
            pieces.append((
                np.stack(ends, 1), number[np.stack(two, 1)], own + cell,
                *(np.full(len(own), each) for each in alike),
            ))  # fmt: skip
    return Wedges(*(np.concatenate(column) for column in zip(*pieces, strict=True)))
