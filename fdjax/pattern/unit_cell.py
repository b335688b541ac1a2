"""Unit cells: drawings that repeat along two axes, as graphs on a torus. Loads no JAX.

The paper's textures: "unit cells (squares, honeycombs, etc)" that fill the plane by periodic
tiling.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_SAME = 1e-6
"""Points of a drawing nearer than this share of its larger side are one."""

_SLENDER = 1000
"""Largest ratio of a cell's sides, far from where `_SAME` of the larger is much of the other."""

_LOOKS = 64
"""Places along each side of a cell, and lines across a face, at which openings are looked at."""


@dataclass(frozen=True, eq=False)
class UnitCell:
    """A drawing that repeats every `size` (a, b), in units of its own.

    - `xy`: of the nodes, each once, shape (nodes, 2), in [0, a) x [0, b).
    - `edges`: the nodes at both ends of each edge, shape (edges, 2), and `shift`: how many cells
      along both axes from the first node's cell to the second's, shape (edges, 2).
    """

    size: tuple[float, float]
    xy: Floats
    edges: Ints
    shift: Ints

    @classmethod
    def of(
        cls, lines: Sequence[Sequence[Sequence[float]]], size: tuple[float, float]
    ) -> "UnitCell":
        """The cell of polylines. What lies beyond the cell is moved into it, by whole cells.

        Raises `InputError`, with the place, where a line ends at the cell's edge and none goes on
        from the opposite edge, where lines cross without a point there or run on one another, and
        for a drawing that is empty or not finite.

        >>> UnitCell.of([[(0, 0), (1, 0)], [(0, 0), (0, 1)]], (1, 1)).edges.tolist()
        [[0, 0], [0, 0]]
        """
        cls.check_lines(lines, size)
        period = np.array(size, float)
        drawn = [np.asarray(line, float) for line in lines]
        same = _SAME * float(period.max())
        ends = np.array([step for line in drawn for step in pairwise(line)]).reshape(-1, 2)
        home = np.floor(ends / period + _SAME).astype(int)
        within = ends - home * period
        keys = np.round(within / same).astype(int)
        _, first, node = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        edges, home = node.reshape(-1, 2), home.reshape(-1, 2, 2)
        shift = home[:, 1] - home[:, 0]
        moved = (edges[:, 0] != edges[:, 1]) | shift.any(1)
        if not moved.any():
            raise InputError("cell: its lines have no length")
        cell = cls((float(period[0]), float(period[1])), within[first], edges[moved], shift[moved])
        cell._check(ends)
        return cell

    @staticmethod
    def check_lines(lines: Sequence[Sequence[Sequence[float]]], size: tuple[float, float]) -> None:
        """Raise `InputError` for a size that cannot be and lines that are none."""
        if not all(np.isfinite(side) and side > 0 for side in size):
            raise InputError(f"cell: its size is {size[0]:g} x {size[1]:g}; both must be positive")
        if max(size) > _SLENDER * min(size):
            raise InputError(
                f"cell: its size is {size[0]:g} x {size[1]:g}; one side may be {_SLENDER} times as "
                "long as the other"
            )
        drawn = [np.asarray(line, float) for line in lines]
        if not drawn or any(len(line) < 2 or line.shape[1:] != (2,) for line in drawn):
            raise InputError("cell: needs lines of two points [x, y] or more")
        if not all(np.isfinite(line).all() for line in drawn):
            raise InputError("cell: its points must be finite")

    def _check(self, ends: Floats) -> None:
        self._check_edges(ends)
        near = self.tiled(range(-1, 2))
        own = np.asarray(shapely.linestrings(np.round(self.ends, 9)))
        tree = shapely.STRtree(np.asarray(shapely.linestrings(near)))
        i, j = tree.query(own, predicate="intersects")
        both = np.stack([own[i], tree.geometries[j]], 1)
        meet = shapely.intersection(both[:, 0], both[:, 1])
        centre = len(own) * 4 + np.arange(len(own))
        for k in np.flatnonzero(j != centre[i]).tolist():
            if meet[k].length > _SAME * max(self.size):
                raise InputError(
                    f"cell: a line is drawn twice at {_place(meet[k], self.size)}; copies share "
                    "what lies on opposite edges, so one of them is enough"
                )
            gaps = [
                shapely.distance(meet[k], shapely.Point(end))
                for line in both[k]
                for end in (line.coords[0], line.coords[-1])
            ]
            if max(min(gaps[:2]), min(gaps[2:])) > 2 * _SAME * max(self.size):
                raise InputError(
                    f"cell: lines cross at {_place(meet[k], self.size)} without a point there; "
                    "with one in both they meet in a node"
                )

    def _check_edges(self, ends: Floats) -> None:
        """Raise `InputError` for a line that ends at the cell's edge with none to go on from it."""
        degree = np.bincount(self.edges.ravel(), minlength=len(self.xy))
        for node in np.flatnonzero(degree == 1).tolist():
            lone = self.xy[node]
            for axis, name in enumerate(("x", "y")):
                if abs(lone[axis]) < _SAME * self.size[axis]:
                    beside = (ends - lone) % self.size
                    beside = np.minimum(beside, self.size - beside)
                    at = ends[np.argmin(beside.sum(1))]
                    other = at.copy()
                    other[axis] = self.size[axis] if at[axis] < self.size[axis] / 2 else 0.0
                    raise InputError(
                        f"cell: a line ends at ({at[0]:g}, {at[1]:g}) on the cell's edge, and none "
                        f"goes on at ({other[0]:g}, {other[1]:g}), the same place of the opposite "
                        f"edge along {name}"
                    )

    def mirrored(self, axes: tuple[bool, bool]) -> "UnitCell":
        """The drawing that is mirrored along one axis or both."""
        flip = np.where(axes, -1, 1)
        home = np.floor(flip * self.xy / self.size + _SAME).astype(int)
        first, last = home[self.edges[:, 0]], home[self.edges[:, 1]]
        return UnitCell(
            self.size,
            flip * self.xy - home * np.array(self.size),
            self.edges,
            flip * self.shift + last - first,
        )

    @property
    def area(self) -> float:
        return self.size[0] * self.size[1]

    @cached_property
    def ends(self) -> Floats:
        """Both ends of each edge, the first in the cell itself, shape (edges, 2, 2)."""
        end = self.xy[self.edges[:, 1]] + self.shift * np.array(self.size)
        return np.stack([self.xy[self.edges[:, 0]], end], 1)

    def tiled(self, cells: range) -> Floats:
        """Both ends of all edges of a square of cells, shape (n, 2, 2)."""
        shifts = [np.array(shift) * self.size for shift in product(cells, cells)]
        # What is one point of several edges must be so to the last digit.
        return np.round(np.concatenate([self.ends + shift for shift in shifts]), 9)

    @cached_property
    def directions(self) -> Floats:
        """Edges as vectors, those along one another added up, per area of the cell: shape (d, 2).

        The centre line an area of a chart with gradients G is `|det G| sum |G^-1 d|`.
        """
        along = self.ends[:, 1] - self.ends[:, 0]
        back = (along[:, 0] < -1e-9) | ((np.abs(along[:, 0]) <= 1e-9) & (along[:, 1] < 0))
        along[back] *= -1
        unit = along / np.hypot(*along.T)[:, None]
        _, owner = np.unique(np.round(unit, 6), axis=0, return_inverse=True)
        sums = [np.bincount(owner.ravel(), along[:, axis]) for axis in (0, 1)]
        return np.stack(sums, 1) / self.area

    @property
    def density(self) -> float:
        """Length of centre line an area of the drawing, as it was drawn."""
        return float(np.hypot(*self.directions.T).sum())

    @cached_property
    def _chains(self) -> NDArray[np.object_]:
        """Edges that go on from one another alone, as one geometry each, of nine cells."""
        parts = np.asarray(shapely.linestrings(self.tiled(range(-1, 2))))
        merged = shapely.line_merge(shapely.multilinestrings(parts))
        return np.asarray(shapely.get_parts(merged))

    @cached_property
    def gap(self) -> float:
        """Least distance of lines that do not meet."""
        chains, within = self._chains, min(self.size)
        # Chains are cut off at the edge of the nine cells, maybe before a node that they share.
        inner = shapely.intersection(chains, shapely.box(0, 0, *self.size))
        own = np.flatnonzero(~shapely.is_empty(inner))
        tree = shapely.STRtree(chains)
        # Nearer and nearer, as most pairs of a large cell lie far apart.
        reach = within / 64
        while reach < 2 * within:
            near, j = tree.query(inner[own], predicate="dwithin", distance=min(reach, within))
            i = own[near]
            meet = shapely.distance(chains[i], chains[j]) <= _SAME * max(self.size)
            apart = shapely.distance(inner[i], chains[j])[~meet]
            if len(apart):
                return float(apart.min())
            reach *= 2
        return float(within)

    @cached_property
    def pore(self) -> float:
        """How far the drawing's lines run over an opening of it, where it is laid on itself moved.

        In the mean over places, of the face and the direction of lines where that is most; without
        faces, the diameter of the largest circle between the lines. Which stretches of a layer
        really lie over nothing is seen in its plan.
        """
        lines = shapely.union_all(np.asarray(shapely.linestrings(self.tiled(range(-1, 2)))))
        faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
        # Of the copies of a face one begins in the cell itself.
        low, same = shapely.bounds(faces)[:, :2], _SAME * max(self.size)
        faces = faces[((low > -same) & (low < self.size)).all(1)]
        longest = 0.0
        for x, y in self.directions / np.hypot(*self.directions.T)[:, None]:
            turned = shapely.transform(faces, lambda xy, x=x, y=y: xy @ [[x, -y], [y, x]])
            left, _, right, _ = shapely.bounds(turned).T
            for k in map(int, np.argsort(left - right)):
                if right[k] - left[k] <= longest:
                    break
                longest = max(longest, _mean_chord(turned[k]))
        if longest > 0:
            return longest
        places = (np.stack(np.meshgrid(*[np.arange(_LOOKS)] * 2), -1).reshape(-1, 2) + 0.5) / _LOOKS
        return 2 * float(shapely.distance(shapely.points(places * self.size), lines).max())


def _mean_chord(face: shapely.Polygon) -> float:
    """Length of the chord along x through a place of a face, in the mean over its area."""
    left, bottom, right, top = face.bounds
    at = bottom + (np.arange(_LOOKS) + 0.5) / _LOOKS * (top - bottom)
    rays = shapely.linestrings(
        np.stack(np.broadcast_arrays([left - 1, right + 1], at[:, None]), -1)
    )
    chords = shapely.length(shapely.get_parts(shapely.intersection(rays, face)))
    # A chord of length l passes through places in proportion to l.
    return float((chords**2).sum() / chords.sum())


def _place(geometry: shapely.Geometry, size: tuple[float, float]) -> str:
    x, y = shapely.get_coordinates(geometry)[0] % size
    return f"({x:.4g}, {y:.4g})"
