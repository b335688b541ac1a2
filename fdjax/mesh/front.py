"""Triangulations by an advancing front: from the walls inwards, one triangle at a time.

Sides of the front are taken one after the other; each gets a triangle, with a new node at the
height that the size field asks or with a node of the front near that place, until nothing is left
(Peraire, Vahdati, Morgan, Zienkiewicz 1987). Whether a triangle fits is looked at, not assumed, so
any closed front ends. Loads no JAX.
"""

import heapq
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.mesh.size import Outline, SizeField
from fdjax.mesh.triangulation import Triangulation

Floats = NDArray[np.float64]
Side = tuple[int, int]

ORDERS = ("shortest", "oldest")
"""Which side of the front is next: the shortest, or the one that has been there longest."""

_CORNER = np.deg2rad(30.0)
"""Walls that turn by more have a node there."""

_SHIFT = 0.6
"""Share of a cell by which nodes on straight walls are moved from phase to phase, in all."""

_STRETCH = 0.55, 2.0
"""A cell is no smaller and no larger than these shares of the side that it stands on."""

_CLEAR = 0.4
"""Share of a cell that a new node keeps from the sides of the front."""

_FLAT, _ON = 1e-14, 1e-9
"""Shares of a side's square by which a triangle on it is none, and a node on one of its sides."""


@dataclass(frozen=True)
class Rules:
    """What shapes the mesh.

    - `order`: one of `ORDERS`; `height`: of a new triangle, in those of one with equal sides.
    - `reuse`: distance, in cells, from where a new node would be within which a node of the front
      is taken instead; `sweeps`: of smoothing afterwards.

    Raises `InputError` for what lies outside (0.5 to 1.5 of both, 0 to 100 sweeps).
    """

    order: str = "oldest"
    height: float = 1.0
    reuse: float = 0.75
    sweeps: int = 5

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            raise InputError(f'order: "{self.order}" is not one of {", ".join(ORDERS)}')
        for name, low, high in (("height", 0.5, 1.5), ("reuse", 0.5, 1.5), ("sweeps", 0, 100)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name}: {value:g}; it must be {low:g} to {high:g}")


def advanced(
    region: Outline, field: SizeField, rules: Rules | None = None, phase: float = 0.0
) -> Triangulation:
    """A triangulation of a region, polygons with holes, mm, with sides as the field says.

    Straight walls are met exactly, bent ones by chords.

    - `phase`: where nodes on the walls begin, a share from 0 to 1; other values give other meshes.
    """
    rules = rules or Rules()
    rings = [
        _ring(np.asarray(ring.coords)[:-1], field, phase)
        for part in shapely.get_parts(shapely.orient_polygons(region))
        for ring in (part.exterior, *part.interiors)
    ]
    front = _Front(rings, field, rules)
    front.close()
    mesh = Triangulation(front.xy, np.array(front.triangles, np.intp))
    return smoothed(mesh, field, rules.sweeps)


def smoothed(mesh: Triangulation, field: SizeField, sweeps: int) -> Triangulation:
    """The mesh with inner nodes moved to the middle of the triangles around them, weighted by
    size^-4, as far as none turns over; nodes at the rim stay.
    """
    xy, triangles = mesh.xy.copy(), mesh.triangles
    held = np.zeros(len(xy), bool)
    held[mesh.edges[~mesh.inner]] = True
    for _ in range(sweeps):
        corner = xy[triangles]
        middle = corner.mean(1)
        weight = _twice(corner) * field.at(middle) ** -4
        whole, x, y = (
            np.bincount(triangles.ravel(), np.repeat(pull, 3), len(xy))
            for pull in (weight, weight * middle[:, 0], weight * middle[:, 1])
        )
        moved = np.stack([x, y], 1) / whole[:, None]
        moved[held] = xy[held]
        while True:
            over = _twice(moved[triangles]) <= 0.1 * _twice(corner)
            back = np.unique(triangles[over])
            if not len(back) or np.array_equal(moved[back], xy[back]):
                break
            moved[back] = xy[back]
        xy = moved
    return Triangulation(xy, triangles)


def _twice(corner: Floats) -> Floats:
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def _ring(points: Floats, field: SizeField, phase: float) -> Floats:
    """Nodes on a closed wall, (n, 2), a cell apart, and at its corners."""
    before, after = points - np.roll(points, 1, 0), np.roll(points, -1, 0) - points
    across = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.abs(np.arctan2(across, (before * after).sum(1)))
    corners = np.flatnonzero(turn > _CORNER)
    if not len(corners):
        return _between(np.concatenate([points, points[:1]]), field, phase, closed=True)
    runs = zip(corners, np.append(corners[1:], corners[0] + len(points)), strict=True)
    return np.concatenate(
        [
            _between(points[np.arange(a, b + 1) % len(points)], field, phase, closed=False)
            for a, b in runs
        ]
    )


def _between(path: Floats, field: SizeField, phase: float, *, closed: bool) -> Floats:
    """Nodes along a path, a cell apart, its last point left out."""
    line = shapely.LineString(path)
    # Half the least size resolves how it changes.
    count = int(np.ceil(2 * line.length / float(field.at(path).min()))) + 2
    at = np.linspace(0, line.length, count)
    places = shapely.get_coordinates(shapely.line_interpolate_point(line, at))
    step = np.diff(at) * 2 / (field.at(places[1:]) + field.at(places[:-1]))
    cells = np.concatenate([[0.0], np.cumsum(step)])
    number = max(round(float(cells[-1])), 3 if closed else 1)
    shift = phase if closed else _SHIFT * (phase - 0.5)
    share = np.arange(number) + shift
    if not closed:
        share[0] = 0.0
    where = np.interp(share / number * cells[-1], cells, at)
    return shapely.get_coordinates(shapely.line_interpolate_point(line, where))


class _Front:
    """Sides of the front, what lies left of each being open, and the triangles behind it.

    Places are complex numbers. Sides are found by the squares of a lattice that their boxes meet.
    """

    def __init__(self, rings: list[Floats], field: SizeField, rules: Rules) -> None:
        self.field, self.rules = field, rules
        self.at: list[complex] = []
        self.triangles: list[tuple[int, int, int]] = []
        self.sides: set[Side] = set()
        self.next: list[tuple[float, int, Side]] = []
        self.count = 0
        walls = np.concatenate(rings)
        self.square = float(np.median(field.at(walls)))
        self.squares: defaultdict[tuple[int, int], set[Side]] = defaultdict(set)
        self.sizes = field.size.tolist()
        self.step = float(field.x[1] - field.x[0]), float(field.y[1] - field.y[0])
        for ring in rings:
            first = len(self.at)
            self.at += (ring[:, 0] + 1j * ring[:, 1]).tolist()
            numbers = range(first, len(self.at))
            for a, b in zip(numbers, [*numbers[1:], first], strict=True):
                self._add((a, b))

    @property
    def xy(self) -> Floats:
        return np.array([(place.real, place.imag) for place in self.at])

    def close(self) -> None:
        """Lay triangles until no side is left."""
        while self.next:
            side = heapq.heappop(self.next)[2]
            if side in self.sides:
                self._advance(side)

    def _size(self, place: complex) -> float:
        """The field at a place, bilinear."""
        u = (place.real - float(self.field.x[0])) / self.step[0]
        v = (place.imag - float(self.field.y[0])) / self.step[1]
        i = min(max(int(u), 0), len(self.sizes) - 2)
        j = min(max(int(v), 0), len(self.sizes[0]) - 2)
        u, v = u - i, v - j
        low, high = self.sizes[i], self.sizes[i + 1]
        return (1 - u) * ((1 - v) * low[j] + v * low[j + 1]) + u * (
            (1 - v) * high[j] + v * high[j + 1]
        )

    def _advance(self, side: Side) -> None:
        a, b = side
        p, q = self.at[a], self.at[b]
        along = q - p
        length = abs(along)
        normal = 1j * along / length
        middle = (p + q) / 2
        cell = self._size(middle + normal * length / 2)
        cell = min(max(cell, _STRETCH[0] * length), _STRETCH[1] * length)
        height = self.rules.height * (cell * cell - length * length / 4) ** 0.5
        new = middle + normal * height
        reach = self.rules.reuse * cell
        near = self._nodes(new - reach * (1 + 1j), new + reach * (1 + 1j))
        close = [k for k in near if k not in side and abs(self.at[k] - new) <= reach]
        for _, k in sorted((self._narrow(p, q, self.at[k]), k) for k in close):
            if self._fits(side, self.at[k]):
                return self._lay(side, k)
        if self._clear(new, _CLEAR * cell) and self._fits(side, new):
            self.at.append(new)
            return self._lay(side, len(self.at) - 1)
        # Of all nodes of the front one sees the side: the one under which it is widest is taken.
        while True:
            reach *= 2
            low, high = middle - reach * (1 + 1j), middle + reach * (1 + 1j)
            seen = [
                (self._narrow(p, q, self.at[k]), k)
                for k in self._nodes(low, high)
                if k not in side and self._fits(side, self.at[k])
            ]
            if seen:
                return self._lay(side, min(seen)[1])
            if reach > 2 * (np.ptp(self.field.x) + np.ptp(self.field.y)):
                x, y = middle.real, middle.imag
                raise InputError(f"mesh: the front does not close at ({x:.4g}, {y:.4g}) mm")

    @staticmethod
    def _narrow(p: complex, q: complex, top: complex) -> float:
        """Less the cosine of the angle under which a side is seen: the wider the less."""
        first, second = p - top, q - top
        return (first.conjugate() * second).real / (abs(first) * abs(second))

    def _lay(self, side: Side, top: int) -> None:
        a, b = side
        self.triangles.append((a, b, top))
        self._remove(side)
        for start, end in ((a, top), (top, b)):
            if (end, start) in self.sides:
                self._remove((end, start))
            else:
                self._add((start, end))

    def _add(self, side: Side) -> None:
        self.sides.add(side)
        for square in self._met(*side):
            self.squares[square].add(side)
        self.count += 1
        first = abs(self.at[side[1]] - self.at[side[0]]) if self.rules.order == "shortest" else 0.0
        heapq.heappush(self.next, (first, self.count, side))

    def _remove(self, side: Side) -> None:
        self.sides.remove(side)
        for square in self._met(*side):
            self.squares[square].discard(side)

    def _met(self, a: int, b: int) -> Iterable[tuple[int, int]]:
        return self._box(*(self._corners(self.at[a], self.at[b])))

    @staticmethod
    def _corners(*places: complex) -> tuple[complex, complex]:
        xs, ys = [p.real for p in places], [p.imag for p in places]
        return complex(min(xs), min(ys)), complex(max(xs), max(ys))

    def _box(self, low: complex, high: complex) -> list[tuple[int, int]]:
        s = self.square
        return [
            (i, j)
            for i in range(int(low.real // s), int(high.real // s) + 1)
            for j in range(int(low.imag // s), int(high.imag // s) + 1)
        ]

    def _near(self, low: complex, high: complex) -> set[Side]:
        """Sides of the front in squares that a box meets."""
        found: set[Side] = set()
        for square in self._box(low, high):
            if square in self.squares:
                found |= self.squares[square]
        return found

    def _nodes(self, low: complex, high: complex) -> set[int]:
        return {node for side in self._near(low, high) for node in side}

    def _clear(self, place: complex, away: float) -> bool:
        """Whether no side of the front is nearer to a place."""
        for a, b in self._near(place - away * (1 + 1j), place + away * (1 + 1j)):
            p, along = self.at[a], self.at[b] - self.at[a]
            share = ((place - p) * along.conjugate()).real / abs(along) ** 2
            if abs(place - p - min(max(share, 0.0), 1.0) * along) < away:
                return False
        return True

    def _fits(self, side: Side, top: complex) -> bool:
        """Whether the triangle on a side lies in what is open: no node in it, no side across."""
        p, q = self.at[side[0]], self.at[side[1]]
        square = abs(q - p) ** 2
        if _cross(q - p, top - p) <= _FLAT * square:
            return False
        ways = (q - p, p), (top - q, q), (p - top, top)
        for a, b in self._near(*self._corners(p, q, top)):
            u, v = self.at[a], self.at[b]
            for node in (u, v):
                if node not in (p, q, top) and all(
                    _cross(way, node - start) >= -_ON * square for way, start in ways
                ):
                    return False
            for start, end in ((p, top), (top, q)):
                if start in (u, v) or end in (u, v):
                    continue
                way, along = end - start, v - u
                # Where an end of one lies on the other it is a node on a side of the triangle.
                if max(
                    _cross(way, u - start) * _cross(way, v - start),
                    _cross(along, start - u) * _cross(along, end - u),
                ) < -((_ON * square) ** 2):
                    return False
        return True


def _cross(a: complex, b: complex) -> float:
    return a.real * b.imag - a.imag * b.real
