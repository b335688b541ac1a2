"""A family of lines as continuous roads: cut at the walls, joined along them, put in order."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import LineString, Polygon, buffer, dwithin, intersection

from fdjax.errors import InputError
from fdjax.plan.cut import Piece, cut_lines
from fdjax.plan.order import order_roads
from fdjax.plan.toolpath import Road
from fdjax.plan.wall import Wall

Floats = NDArray[np.float64]
_LOW, _HIGH = 0, 1

_BESIDE = 8.0
"""So many half road widths a join may lie beside a line that it joins: a corner of 14 degrees."""


def lay_family(
    lines: Sequence[ArrayLike] | Floats,
    outline: Polygon,
    *,
    width: float | Sequence[ArrayLike] | Floats,
    lift_length: float,
    parity: int = 0,
    start: ArrayLike | None = None,
    family: str = "",
    material: int = 0,
) -> list[Road]:
    """Lay an ordered family of lines as roads inside an outline.

    Each line is cut to the free region (the outline with its holes less half the largest road
    width, see `cut_lines`). Ends that are neighbours on a wall are then joined along it, in two
    passes, so that no join crosses a road:

    1. back and forth: lines k and k + 1 at their high ends (towards eta = 1) where `k + parity`
       is even, at their low ends where it is odd;
    2. ends still free (at a hole, mostly), shortest first, where that closes no ring.

    A join is made only where it is shorter than lifting: the way along the wall is at most
    `lift_length` mm longer than the straight one; and where, unless it runs straight, it keeps
    half a road away from other roads. It has the mean width of the two ends.

    - `lines`: polylines from wall to wall in their order across, each (points, 2), mm.
    - `width`: road width, mm: one value, or for each line one value or one a segment.
    - `parity`: 0 or 1, which side turns first.
    - `start`: where the head comes from; the roads start near it.

    Returns the roads in the order in which they are laid; without holes this is one road, as
    a rule. Raises `InputError` for lines or widths that do not fit, or no room for a road.

    >>> lines = [[(x, 0), (x, 9)] for x in (1, 2, 3)]
    >>> square = Polygon([(0, 0), (4, 0), (4, 9), (0, 9)])
    >>> [len(road.xy) for road in lay_family(lines, square, width=0.4, lift_length=2)]
    [6]
    """
    arrays, widths = _checked(lines, width)
    road_width = max(float(w.max()) for w in widths)
    walls, pieces = cut_lines(arrays, widths, outline, road_width=road_width)
    joins = _Joins(walls, pieces, lift_length, road_width / 2)
    joins.back_and_forth(parity)
    joins.what_is_left()
    roads = [Road(*joins.deposit(run), material=material, family=family) for run in joins.runs()]
    return order_roads(roads, start=start)


def _checked(
    lines: Sequence[ArrayLike] | Floats, width: float | Sequence[ArrayLike] | Floats
) -> tuple[list[Floats], list[Floats]]:
    arrays = [np.asarray(line, float) for line in lines]
    if not arrays:
        raise InputError("lines: none given; a family needs at least one")
    each = list(width) if isinstance(width, Sequence | np.ndarray) else [width] * len(arrays)
    if len(each) != len(arrays):
        raise InputError(f"width: {len(each)} given for {len(arrays)} lines; one a line is needed")
    widths = []
    for k, (xy, given) in enumerate(zip(arrays, each, strict=True)):
        if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 2 or not np.isfinite(xy).all():
            raise InputError(f"line {k}: needs at least two finite points, shape (points, 2)")
        value = np.asarray(given, float)
        if value.shape not in ((), (len(xy) - 1,)) or not (np.isfinite(value) & (value > 0)).all():
            raise InputError(f"line {k}: needs one positive width or {len(xy) - 1}, one a segment")
        widths.append(np.broadcast_to(value, (len(xy) - 1,)))
    return arrays, widths


class _Joins:
    """Which ends are joined; end `2 p` is the low one of piece p, `2 p + 1` the high one."""

    def __init__(
        self, walls: list[Wall], pieces: list[Piece], lift_length: float, clearance: float
    ) -> None:
        self.walls = walls
        self.clearance = clearance
        self.pieces = pieces
        self.partner: dict[int, tuple[int, Floats]] = {}
        self._run = list(range(len(pieces)))
        ways = self._ways()
        short = [
            (length, i, j, wall, a, b)
            for i, j, wall, a, b in ways
            if (length := b - a) <= lift_length + np.hypot(*(self._xy(i) - self._xy(j)))
        ]
        self._candidates = sorted(short)

    def _xy(self, end: int) -> Floats:
        return self.pieces[end // 2].xy[-(end % 2)]

    def _width(self, end: int) -> float:
        return float(self.pieces[end // 2].width[-(end % 2)])

    def _ways(self) -> list[tuple[int, int, int, float, float]]:
        """Ways along walls between neighbouring ends: (end, end, wall, from, to)."""
        on_wall: list[list[tuple[float, int]]] = [[] for _ in self.walls]
        taken: list[list[tuple[float, float]]] = [[] for _ in self.walls]
        for p, piece in enumerate(self.pieces):
            for side, place in enumerate(piece.ends):
                if place is not None:
                    on_wall[place[0]].append((place[1], 2 * p + side))
            for wall, a, b in piece.pressed:
                taken[wall].append((a, b))
        ways = []
        for number, ends in enumerate(on_wall):
            ends.sort()
            length = self.walls[number].length
            for (a, i), (b, j) in zip(ends, ends[1:] + ends[:1], strict=True):
                # From the last end on, the way goes through the wall's first vertex.
                to = b if b > a or (b == a and i != ends[-1][1]) else b + length
                if i != j and not _overlaps(taken[number], a, to, length):
                    ways.append((i, j, number, a, to))
        return ways

    def _root(self, piece: int) -> int:
        while self._run[piece] != piece:
            self._run[piece] = self._run[self._run[piece]]
            piece = self._run[piece]
        return piece

    def _open(self, i: int, j: int) -> bool:
        """Both ends free and of different runs, so that no ring closes."""
        if i in self.partner or j in self.partner:
            return False
        return self._root(i // 2) != self._root(j // 2)

    @cached_property
    def _courses(self) -> NDArray[np.object_]:
        return np.array([LineString(piece.xy) for piece in self.pieces])

    def _join_if_clear(self, i: int, j: int, way: Floats) -> None:
        """Join unless the way lies on other roads, or for long on the two that it joins."""
        wall = LineString(way)
        straight = np.hypot(*(way[-1] - way[0]))
        # A way this direct has no room to run back along a line.
        if wall.length > straight + self.clearance:
            own = [i // 2, j // 2]
            close = dwithin(self._courses, wall, self.clearance)
            close[own] = False
            beside = intersection(wall, buffer(self._courses[own], self.clearance))
            if close.any() or max(part.length for part in beside) > _BESIDE * self.clearance:
                return
        self.partner[i], self.partner[j] = (j, way), (i, way[::-1])
        self._run[self._root(i // 2)] = self._root(j // 2)

    def back_and_forth(self, parity: int) -> None:
        for _, i, j, wall, a, b in self._candidates:
            lines = self.pieces[i // 2].line, self.pieces[j // 2].line
            side = _HIGH if (min(lines) + parity) % 2 == 0 else _LOW
            neighbours = abs(lines[0] - lines[1]) == 1
            if neighbours and i % 2 == j % 2 == side and self._open(i, j):
                self._join_if_clear(i, j, self.walls[wall].way(a, b))

    def what_is_left(self) -> None:
        for _, i, j, wall, a, b in self._candidates:
            if self._open(i, j):
                self._join_if_clear(i, j, self.walls[wall].way(a, b))

    def runs(self) -> list[list[int]]:
        """Continuous runs, each as the ends at which its pieces are entered."""
        found = []
        seen: set[int] = set()
        for free in range(2 * len(self.pieces)):
            if free in self.partner or free // 2 in seen:
                continue
            run = []
            entry: int | None = free
            while entry is not None:
                run.append(entry)
                seen.add(entry // 2)
                beyond = self.partner.get(entry ^ 1)
                entry = None if beyond is None else beyond[0]
            found.append(run)
        return found

    def deposit(self, run: list[int]) -> tuple[Floats, Floats]:
        """Centre line and segment widths of a run."""
        xy: list[Floats] = []
        width: list[Floats] = []
        for entry in run:
            piece = self.pieces[entry // 2]
            step = -1 if entry % 2 else 1
            if xy:
                way = self.partner[entry][1][::-1]
                mean = (self._width(entry) + self._width(self.partner[entry][0])) / 2
                xy.append(way[1:-1])
                width.append(np.full(len(way) - 1, mean))
            xy.append(piece.xy[::step])
            width.append(piece.width[::step])
        points, widths = np.concatenate(xy), np.concatenate(width)
        moved = np.hypot(*np.diff(points, axis=0).T) > 1e-9
        return points[np.concatenate([[True], moved])], widths[moved]


def _overlaps(taken: list[tuple[float, float]], a: float, b: float, length: float) -> bool:
    """Whether the way from a to b shares more than a point with a stretch of road on the wall."""
    return any(
        min(b, high + turn) - max(a, low + turn) > 1e-6
        for low, high in taken
        for turn in (-length, 0.0, length, 2 * length)
    )
