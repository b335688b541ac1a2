"""Which ends of a family's pieces are joined along the walls, and by what way."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import STRtree

from fdjax.plan.chords import Chords
from fdjax.plan.cut import Piece
from fdjax.plan.room import Walls
from fdjax.road.stroke import APART

Floats = NDArray[np.float64]

OWN_TURN = 2.0
"""So many road widths from its corner a join may lie beside the line that it joins."""

LONGEST_CUT = 10.0
"""So many road widths a line may end early for that."""

FURTHER = 1.5
"""Joins may be so many times as long as is usual where that saves travel."""


@dataclass(frozen=True, eq=False)
class Way:
    """A join that could be made between two ends that are neighbours on a wall.

    - `ends`: end `2 p` is where piece p starts, `2 p + 1` where it finishes.
    - `xy`: from the first end to the second, mm; `length` along the wall, mm.
    - `far`: longer than is usual.
    - `cut`: by how much the two pieces end early, mm.
    """

    ends: tuple[int, int]
    xy: Floats
    length: float
    far: bool = False
    cut: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Joins:
    """A choice of ways: `partner[end]` is the end beyond and the polyline that leads there."""

    partner: dict[int, tuple[int, Floats]]
    cut: dict[int, float]

    @classmethod
    def of(cls, ways: Iterable[Way]) -> "Joins":
        """All of these ways."""
        partner: dict[int, tuple[int, Floats]] = {}
        cut: dict[int, float] = {}
        for way in ways:
            i, j = way.ends
            partner[i], partner[j] = (j, way.xy), (i, way.xy[::-1])
            cut[i], cut[j] = way.cut
        return cls(partner, cut)

    def runs(self, pieces: int) -> list[list[int]]:
        """Continuous runs, each as the ends at which its pieces are entered."""
        found = []
        seen: set[int] = set()
        for free in range(2 * pieces):
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


def choose(
    ways: Sequence[Way], level: Sequence[int], parity: int, near: set[tuple[int, int]]
) -> list[int]:
    """The numbers of the joins that are made, in two passes, shortest first.

    1. Back and forth: levels k and k + 1 are joined where they finish if `k + parity` is even,
       where they start if it is odd. A run so climbs from level to level, and none is a ring.
       Where all but every second, fourth ... level was thinned out, those count as neighbours.
    2. Ends still free, of whatever levels, where that closes no ring.

    No join that is `far` is made.

    - `level`: of each piece; `near`: pairs of ways too near each other to be both made.
    """
    chosen: list[int] = []
    taken: set[int] = set()
    run = list(range(len(level)))
    barred: set[int] = set()
    against: dict[int, list[int]] = {}
    for a, b in near:
        against.setdefault(a, []).append(b)
        against.setdefault(b, []).append(a)

    def root(piece: int) -> int:
        while run[piece] != piece:
            run[piece] = run[run[piece]]
            piece = run[piece]
        return piece

    def make(numbers: Iterable[int]) -> None:
        for number in numbers:
            i, j = ways[number].ends
            if ways[number].far or i in taken or j in taken or number in barred:
                continue
            first, second = root(i // 2), root(j // 2)
            if first == second:
                continue
            run[first] = second
            barred.update(against.get(number, ()))
            taken.update((i, j))
            chosen.append(number)

    def turns(way: Way) -> bool:
        i, j = way.ends
        k, m = sorted((level[i // 2], level[j // 2]))
        step = m - k
        if step == 0 or step & (step - 1) or k % step:
            return False
        return i % 2 == j % 2 == (k // step + parity + 1) % 2

    make(number for number, way in enumerate(ways) if turns(way))
    make(range(len(ways)))
    return chosen


def ways_along(
    pieces: Sequence[Piece],
    chords: Chords,
    walls: Walls,
    *,
    lift_length: float,
    longest_join: float,
) -> tuple[list[Way], set[tuple[int, int]]]:
    """All joins that could be made, shortest first, and pairs of them that cannot be both made.

    A join runs along the wall between two ends that are neighbours on it. It is at most
    `longest_join` mm long and at most `lift_length` mm longer than the straight way, or `far` and
    not more than `FURTHER` times as much. It keeps
    `APART` widths from every other road, and from the two that it joins beyond its own turn: where
    a line meets the wall at so small an angle that it would not, the line ends early and the join
    starts across the wedge.
    """
    found = _Finder(pieces, chords, walls)
    return found.ways(lift_length, longest_join)


@dataclass(frozen=True, eq=False)
class _Finder:
    pieces: Sequence[Piece]
    chords: Chords
    walls: Walls

    @cached_property
    def courses(self) -> NDArray[np.object_]:
        count = [len(piece.xy) for piece in self.pieces]
        xy = np.concatenate([piece.xy for piece in self.pieces])
        owner = np.repeat(np.arange(len(count)), count)
        return np.asarray(shapely.linestrings(xy, indices=owner))

    def ways(
        self, lift_length: float, longest_join: float
    ) -> tuple[list[Way], set[tuple[int, int]]]:
        ways = []
        for i, j, number, a, b in self._gaps():
            length, start, end = b - a, self._xy(i), self._xy(j)
            detour = length - np.hypot(*(end - start))
            if length <= FURTHER * longest_join and detour <= FURTHER * lift_length:
                corners = self.walls.rings[number].corners(a, b)
                xy = np.concatenate([[start], corners, [end]])
                far = length > longest_join or detour > lift_length
                ways.append(Way((i, j), xy, length, far))
        if not ways:
            return [], set()
        ways.sort(key=lambda way: way.length)
        return self._clear(ways)

    def _xy(self, end: int) -> Floats:
        return self.pieces[end // 2].xy[-(end % 2)]

    def _gaps(self) -> list[tuple[int, int, int, float, float]]:
        """Between neighbouring ends on walls: (end, end, wall, from, to)."""
        on_wall: dict[int, list[tuple[float, int]]] = {}
        taken: dict[int, list[tuple[float, float]]] = {}
        for p, piece in enumerate(self.pieces):
            for side, place in enumerate(piece.ends):
                if place is not None:
                    on_wall.setdefault(place[0], []).append((place[1], 2 * p + side))
            for wall, a, b in piece.pressed:
                taken.setdefault(wall, []).append((a, b))
        gaps = []
        for number, ends in on_wall.items():
            ends.sort()
            length = self.walls.rings[number].length
            for (a, i), (b, j) in zip(ends, ends[1:] + ends[:1], strict=True):
                # From the last end on, the way goes through the wall's first vertex.
                to = b if b > a or (b == a and i != ends[-1][1]) else b + length
                if i // 2 != j // 2 and not _overlaps(taken.get(number, []), a, to, length):
                    gaps.append((i, j, number, a, to))
        return gaps

    def _clear(self, ways: list[Way]) -> tuple[list[Way], set[tuple[int, int]]]:
        """Those that keep away from roads, cut short where they must, and those in conflict."""
        width = self.walls.road_width
        lines = _lines(ways)
        apart = APART * width
        which, chord = self.chords.tree.query(lines, predicate="dwithin", distance=apart)
        own = np.array([way.ends for way in ways]) // 2
        same = own[which] == self.chords.owner[chord][:, None]
        blocked = np.zeros(len(ways), bool)
        blocked[which[~same.any(1)]] = True
        for side in (0, 1):
            mine = same[:, side]
            end = np.array([way.ends[side] for way in ways])[which[mine]]
            beyond = self._beyond(end, chord[mine])
            blocked[which[mine][shapely.distance(beyond, lines[which[mine]]) < apart]] = True
        cut = self._cuts(ways, lines)
        clear = [
            made
            for way, blocks, cuts in zip(ways, blocked.tolist(), cut.tolist(), strict=True)
            if not blocks and (made := _shortened(way, self._cut_points(way, cuts), cuts))
        ]
        if not clear:
            return [], set()
        lines = _lines(clear)
        i, j = STRtree(lines).query(lines, predicate="dwithin", distance=apart)
        pairs = zip(i[i < j].tolist(), j[i < j].tolist(), strict=True)
        near = {(a, b) for a, b in pairs if not set(clear[a].ends) & set(clear[b].ends)}
        return clear, near

    def _beyond(self, end: NDArray[np.intp], chord: NDArray[np.intp]) -> NDArray[np.object_]:
        """What of these chords lies further from these ends than a line may end early."""
        chords = self.chords
        start, at, length = chords.start[chord], chords.at[chord], chords.length[chord]
        limit = LONGEST_CUT * self.walls.road_width
        low, high = np.maximum(limit - at, 0), length
        last = shapely.length(self.courses[end // 2]) - limit - at
        low, high = np.where(end % 2, 0, low), np.where(end % 2, np.minimum(last, length), high)
        unit = chords.unit[chord]
        parts = start[:, None] + np.stack([low, high], 1)[..., None] * unit[:, None]
        beyond = np.asarray(shapely.linestrings(parts), object)
        beyond[low >= high] = None
        return beyond

    def _cuts(self, ways: list[Way], lines: NDArray[np.object_]) -> Floats:
        """By how much each way's two pieces are to end early, (n, 2); infinite where not."""
        width = self.walls.road_width
        ends = np.array([way.ends for way in ways])
        course = self.courses[ends // 2]
        length = shapely.length(course)
        steps = np.arange(OWN_TURN, LONGEST_CUT + 0.1, 0.5) * width
        cut = np.zeros(ends.shape)
        few = steps[[0, 2, 4, 6, 8, 12, 16]]
        suspect = (self._distance(course, ends, lines, few) < APART * width) & (
            few <= length[..., None]
        )
        for k, side in np.argwhere(suspect.any(-1)):
            distance = self._distance(course[k, side], ends[k, side], lines[k], steps)[0]
            close = (distance < APART * width) & (steps <= length[k, side])
            last = int(np.flatnonzero(close)[-1]) + 1
            fits = last < len(steps) and steps[last] <= 0.4 * length[k, side]
            cut[k, side] = steps[last] if fits else np.inf
        return cut

    @staticmethod
    def _distance(
        course: NDArray[np.object_], ends: NDArray[np.intp], lines: NDArray[np.object_], at: Floats
    ) -> Floats:
        """How far the way is from the points of the pieces at these places from their ends."""
        course, ends = np.atleast_1d(course)[..., None], np.atleast_1d(ends)[..., None]
        points = shapely.line_interpolate_point(course, np.where(ends % 2, -at, at))
        lines = np.reshape(lines, (-1,) + (1,) * (points.ndim - 1))
        return np.asarray(shapely.distance(points, lines))

    def _cut_points(self, way: Way, cut: list[float]) -> list[Floats | None]:
        return [
            None
            if not 0 < by < np.inf
            else shapely.get_coordinates(
                shapely.line_interpolate_point(self.courses[end // 2], -by if end % 2 else by)
            )[0]
            for end, by in zip(way.ends, cut, strict=True)
        ]


def _lines(ways: Sequence[Way]) -> NDArray[np.object_]:
    owner = np.repeat(np.arange(len(ways)), [len(way.xy) for way in ways])
    return np.asarray(shapely.linestrings(np.concatenate([way.xy for way in ways]), indices=owner))


def _shortened(way: Way, points: Sequence[Floats | None], cut: Sequence[float]) -> Way | None:
    """The way between the points where the two lines end early; None where it is too short."""
    if max(cut) == np.inf:
        return None
    if max(cut) == 0:
        return way
    line = shapely.LineString(way.xy)
    first, last = (
        end if point is None else line.project(shapely.Point(point))
        for end, point in zip((0.0, line.length), points, strict=True)
    )
    if last - first <= min(line.length, max(cut)) / 4:
        return None
    walked = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way.xy, axis=0).T))])
    inner = way.xy[(walked > first + 1e-9) & (walked < last - 1e-9)]
    reached = shapely.get_coordinates(line.interpolate([first, last]))
    begin = [] if points[0] is None else [points[0]]
    end = [] if points[1] is None else [points[1]]
    xy = np.array([*begin, reached[0], *inner, reached[1], *end])
    return replace(way, xy=xy, cut=(cut[0], cut[1]))


def _overlaps(taken: list[tuple[float, float]], a: float, b: float, length: float) -> bool:
    """Whether the way from a to b shares more than a point with a stretch of road on the wall."""
    return any(
        min(b, high + turn) - max(a, low + turn) > 1e-6
        for low, high in taken
        for turn in (-length, 0.0, length, 2 * length)
    )
