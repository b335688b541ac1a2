"""Triangles, their sides and centres, and triangulations whose nodes follow a size field."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from fdjax.mesh.size import SizeField

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

SWEEPS = 25
"""Sweeps of relaxation: angles get no better with more, and the density strays."""

_PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])
"""1/p and 1/p^2 of the root p of p^3 = p + 1: multiples of these fill the unit square evenly."""


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Triangles between nodes.

    - `xy`: of the nodes, shape (nodes, 2), mm.
    - `triangles`: the nodes of each, counterclockwise, shape (triangles, 3).

    >>> two = Triangulation(np.array([(0.0, 0), (1, 0), (1, 1), (0, 1)]),
    ...                     np.array([(0, 1, 2), (0, 2, 3)]))
    >>> len(two.edges), two.beside[1].tolist()
    (5, [1, 0])
    """

    xy: Floats
    triangles: Ints

    @cached_property
    def _sides(self) -> tuple[Ints, Ints]:
        """Each edge once, and of each side of each triangle the number of its edge, (t, 3)."""
        sides = self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        edges, number = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
        return edges, number.reshape(-1, 3)

    @property
    def edges(self) -> Ints:
        """The nodes of each edge, shape (edges, 2)."""
        return self._sides[0]

    @property
    def sides(self) -> Ints:
        """The number of the edge from each corner of a triangle to its next, (triangles, 3)."""
        return self._sides[1]

    @cached_property
    def beside(self) -> Ints:
        """The triangles left and right of each edge, shape (edges, 2); -1 for none."""
        edges, number = self._sides
        found = np.full((len(edges), 2), -1)
        for side in range(3):
            begins = self.triangles[:, side] == edges[number[:, side], 0]
            found[number[:, side], np.where(begins, 0, 1)] = np.arange(len(self.triangles))
        return found

    @property
    def inner(self) -> NDArray[np.bool_]:
        """Which edges have a triangle on both sides, shape (edges,)."""
        return self.beside.min(1) >= 0

    @property
    def angles(self) -> Floats:
        """Of each triangle at its three nodes, degrees, shape (triangles, 3)."""
        corner = self.xy[self.triangles]
        first, second = np.roll(corner, -1, 1) - corner, np.roll(corner, 1, 1) - corner
        across = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
        return np.degrees(np.arctan2(across, (first * second).sum(-1)))

    def part(self, kept: NDArray[np.bool_]) -> "Triangulation":
        """Some of the triangles, with the nodes that they have."""
        nodes, number = np.unique(self.triangles[kept], return_inverse=True)
        return Triangulation(self.xy[nodes], number.reshape(-1, 3))


def delaunay(xy: Floats) -> Triangulation:
    """The Delaunay triangulation of points, (n, 2), mm."""
    # Far from the origin scipy's drops points.
    triangles = Delaunay(xy - xy.mean(0)).simplices.astype(np.intp)
    a, b, c = np.moveaxis(xy[triangles], 1, 0)
    turned = _cross(b - a, c - a) < 0
    triangles[turned] = triangles[turned][:, ::-1]
    return Triangulation(xy, triangles)


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def relaxed(field: SizeField, phase: float = 0.0, *, sweeps: int = SWEEPS) -> Triangulation:
    """A triangulation of a size field's box with edges as long as the field says.

    Nodes begin where a low-discrepancy sequence, with the field's density, puts them, and are
    relaxed: each sweep moves a node to the middle of the triangles around it, weighted by
    size^-4, as a centroidal Voronoi diagram with density d needs a weight d^2 in the plane (Du,
    Faber, Gunzburger 1999; with patches of triangles for cells Chen and Holst 2011), and
    triangulates anew. Nodes on the box stay.

    - `phase`: where the sequence begins, a share from 0 to 1; other values give other meshes.
    """
    xy = _sequence(field, phase)
    for _ in range(sweeps):
        mesh = delaunay(xy)
        corner = xy[mesh.triangles]
        middle = corner.mean(1)
        area = _cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        weight = area * field.at(middle) ** -4
        pulls = (weight, weight * middle[:, 0], weight * middle[:, 1])
        whole, x, y = (
            np.bincount(mesh.triangles.ravel(), np.repeat(pull, 3), len(xy)) for pull in pulls
        )
        held = np.unique(mesh.edges[~mesh.inner])
        moved = np.stack([x, y], 1) / np.maximum(whole, 1e-300)[:, None]
        moved[held] = xy[held]
        xy = moved
    return delaunay(xy)


def _sequence(field: SizeField, phase: float) -> Floats:
    """Places with the density of a size field, (nodes, 2), mm."""
    cell = (field.x[1] - field.x[0]) * (field.y[1] - field.y[0])
    held = cell * (field.density[1:, 1:] + field.density[:-1, :-1]) / 2
    count = max(round(float(held.sum())), 4)
    share = (phase + np.outer(np.arange(count) + 0.5, _PLASTIC)) % 1
    columns = np.concatenate([[0.0], np.cumsum(held.sum(1))])
    x = np.interp(share[:, 0] * columns[-1], columns, field.x)
    column = np.clip(np.searchsorted(field.x, x, side="right") - 1, 0, len(held) - 1)
    rows = np.concatenate([np.zeros((len(held), 1)), np.cumsum(held, 1)], 1)
    rows = rows / rows[:, -1:]
    # All columns in one go: the rows of column k rise from k to k + 1.
    place = np.interp(
        column + share[:, 1],
        (rows + np.arange(len(held))[:, None]).ravel(),
        np.tile(np.arange(len(field.y)), len(held)),
    )
    y = np.interp(place, np.arange(len(field.y)), field.y)
    return np.stack([x, y], 1)
