"""Cutting lines that run from wall to wall to what a road's centre line may use."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray
from shapely import Point, contains_xy, linestrings

from fdjax.plan.room import Walls
from fdjax.plan.wall import Wall

Floats = NDArray[np.float64]

SHORTEST = 0.5
"""Pieces shorter than this share of the road width are dropped."""

_OUTSIDE, _BETWEEN, _FREE = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Piece:
    """What one cut leaves of a line, the way the line runs.

    - `line`: index of the line in its family.
    - `xy`: shape (points, 2), mm; `width`: shape (points - 1,), mm.
    - `ends`: (wall, position) of where it starts and of where it finishes; None where a line ends
      in the open.
    - `pressed`: (wall, from, to) of each stretch that runs along a wall.
    """

    line: int
    xy: Floats
    width: Floats
    ends: tuple[tuple[int, float] | None, tuple[int, float] | None]
    pressed: tuple[tuple[int, float, float], ...]


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A part of a piece under construction, with what is known of its two ends."""

    xy: Floats
    width: Floats
    ends: tuple[tuple[int, float] | None, tuple[int, float] | None]
    pressed: tuple[tuple[int, float, float], ...] = ()


def cut_lines(lines: Sequence[Floats], widths: Sequence[Floats], walls: Walls) -> list[Piece]:
    """Cut lines to the free region that the walls enclose.

    `lines[k]` has shape (points, 2), `widths[k]` shape (points - 1,), mm. Returns the pieces, line
    by line, each the way its line runs. A line whose last point is its first is closed: no piece
    ends there.

    A stretch that leaves the free region by less than `walls.press` road widths and runs along the
    wall (the first and last lines of a map do, give or take rounding) is replaced by the wall
    itself, so that it neither breaks into fragments nor comes closer to the outline than half a
    road; a stretch that crosses the wall ends there.
    """
    slack = walls.press * walls.road_width
    family = _Family.of(lines, widths)
    breaks = _Breaks.of(family, walls)
    middle = family.point((breaks.at[1:] + breaks.at[:-1]) / 2)
    state = np.where(contains_xy(walls.near, middle), _BETWEEN, _OUTSIDE)
    state[contains_xy(walls.free, middle)] = _FREE
    state[breaks.line[1:] != breaks.line[:-1]] = _OUTSIDE

    pieces: list[Piece] = []
    for first, last in _groups(state):
        stretches = [
            family.stretch(breaks, a, b)
            if state[a] == _FREE
            else _press(family, breaks, walls.rings, a, b, slack, at_end=a == first or b == last)
            for a, b in _merged(state, first, last)
        ]
        line = int(breaks.line[first])
        pieces += [_joined(line, chain) for chain in _chains(stretches)]
    shortest = SHORTEST * walls.road_width
    return [piece for piece in closed_up(pieces, lines) if _length(piece.xy) >= shortest]


@dataclass(frozen=True, eq=False)
class _Family:
    """All lines of a family in one array; a place on them is a vertex index plus a share."""

    xy: Floats
    width: Floats
    first: NDArray[np.intp]

    @classmethod
    def of(cls, lines: Sequence[Floats], widths: Sequence[Floats]) -> "_Family":
        first = np.concatenate([[0], np.cumsum([len(line) for line in lines])])
        # One width a vertex, the last of each line unused, so that both share their index.
        padded = [np.append(width, width[-1]) for width in widths]
        return cls(np.concatenate(lines), np.concatenate(padded), first)

    def point(self, at: Floats) -> Floats:
        index = np.floor(at).astype(int)
        share = (at - index)[..., None]
        return (1 - share) * self.xy[index] + share * self.xy[
            np.minimum(index + 1, len(self.xy) - 1)
        ]

    def vertices(self, breaks: "_Breaks", a: int, b: int) -> tuple[Floats, Floats]:
        """Points and widths from break `a` to break `b`."""
        first = int(breaks.at[a])
        inner = self.xy[first + 1 : ceil(breaks.at[b])]
        xy = np.concatenate([breaks.xy[a : a + 1], inner, breaks.xy[b : b + 1]])
        return xy, self.width[first : first + len(xy) - 1]

    def stretch(self, breaks: "_Breaks", a: int, b: int) -> _Stretch:
        xy, width = self.vertices(breaks, a, b)
        return _Stretch(xy, width, (breaks.end(a), breaks.end(b)))


@dataclass(frozen=True, eq=False)
class _Breaks:
    """Places where a line begins, ends or meets a ring: sorted; `wall` is -1 for no wall."""

    at: Floats
    xy: Floats
    line: NDArray[np.intp]
    wall: NDArray[np.intp]
    position: Floats

    @classmethod
    def of(cls, family: _Family, walls: Walls) -> "_Breaks":
        """Where the family meets the walls' sides."""
        sides = walls.sides
        segment = np.ones(len(family.xy), bool)
        segment[family.first[1:] - 1] = False
        index = np.flatnonzero(segment)
        # Most segments lie too deep in the room to reach a wall.
        longest = float(np.hypot(*(family.xy[index + 1] - family.xy[index]).T).max(initial=0.0))
        index = index[~contains_xy(walls.deep(longest), family.xy[index])]
        ends = np.stack([family.xy[index], family.xy[index + 1]], 1)
        found, side = sides.tree.query(linestrings(ends))
        p, r = ends[found, 0], ends[found, 1] - ends[found, 0]
        q, s = sides.a[side], sides.b[side] - sides.a[side]
        across = _cross(r, s)
        size = np.hypot(*r.T) * np.hypot(*s.T)
        with np.errstate(divide="ignore", invalid="ignore"):
            t, u = _cross(q - p, s) / across, _cross(q - p, r) / across
        edge = 1e-12
        hit = (np.abs(across) > edge * size) & (t >= -edge) & (t <= 1 + edge)
        hit &= (u >= -edge) & (u <= 1 + edge)
        t, u, side = np.clip(t[hit], 0, 1), np.clip(u[hit], 0, 1), side[hit]
        ring = sides.ring[side]

        limits = np.concatenate([family.first[:-1], family.first[1:] - 1]).astype(float)
        at = np.concatenate([index[found[hit]] + t, limits])
        none = np.full(len(limits), -1)
        wall = np.concatenate([np.where(ring < len(walls.rings), ring, -1), none])
        along = sides.at[side] + u * np.hypot(*s[hit].T)
        along = np.concatenate([along, np.zeros(len(limits))])
        order = np.argsort(at, kind="stable")
        order = order[np.diff(at[order], prepend=-1.0) > 1e-10]
        at = at[order]
        line = np.searchsorted(family.first, at, side="right") - 1
        return cls(at, family.point(at), line, wall[order], along[order])

    def end(self, index: int) -> tuple[int, float] | None:
        wall = int(self.wall[index])
        return None if wall < 0 else (wall, float(self.position[index]))


def closed_up(pieces: list[Piece], lines: Sequence[Floats]) -> list[Piece]:
    """The pieces, with those that meet where a closed line begins and ends made into one."""
    whole: list[Piece] = []
    for number, group in groupby(pieces, key=lambda piece: piece.line):
        parts, line = list(group), lines[number]
        first, last = parts[0], parts[-1]
        meets = (first.xy[0] == last.xy[-1]) & (line[0] == line[-1]) & (first.xy[0] == line[0])
        if len(parts) > 1 and meets.all():
            xy = np.concatenate([last.xy, first.xy[1:]])
            width = np.concatenate([last.width, first.width])
            ends = (last.ends[0], first.ends[1])
            parts = [Piece(number, xy, width, ends, last.pressed + first.pressed), *parts[1:-1]]
        whole += parts
    return whole


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _length(xy: Floats) -> float:
    step = xy[1:] - xy[:-1]
    return float(np.hypot(step[:, 0], step[:, 1]).sum())


def _groups(state: NDArray[np.intp]) -> list[tuple[int, int]]:
    """First and last break of each row of spans that are not outside."""
    inside = np.concatenate([[False], state != _OUTSIDE, [False]]).astype(int)
    change = np.diff(inside)
    return list(zip(*(np.flatnonzero(change == sign).tolist() for sign in (1, -1)), strict=True))


def _merged(state: NDArray[np.intp], first: int, last: int) -> list[tuple[int, int]]:
    """The breaks between which the state does not change."""
    inner = first + 1 + np.flatnonzero(np.diff(state[first:last]))
    edges = [first, *inner.tolist(), last]
    return list(pairwise(edges))


def _press(
    family: _Family,
    breaks: _Breaks,
    walls: Sequence[Wall],
    a: int,
    b: int,
    slack: float,
    *,
    at_end: bool,
) -> _Stretch | None:
    """The stretch moved onto the wall beside it, or None where the line is to end instead."""
    xy, width = family.vertices(breaks, a, b)
    length = _length(xy)
    # A line that meets the wall at more than about 4 degrees does not run along it.
    if at_end and length <= 16 * slack:
        return None
    known = {int(wall) for wall in breaks.wall[[a, b]] if wall >= 0}
    if len(known) == 2:
        return None
    number = known.pop() if known else _nearest(walls, xy[len(xy) // 2])
    wall = walls[number]
    at = np.unwrap(wall.locate(xy), period=wall.length)
    way = abs(at[-1] - at[0])
    if not length / 2 - 4 * slack <= way <= 1.5 * length + 4 * slack:
        return None
    sign = 1.0 if at[-1] >= at[0] else -1.0
    rising = np.minimum(np.maximum.accumulate(sign * at), sign * at[-1])
    stops = np.union1d(rising, sign * wall.corner_positions(at[0], at[-1]))
    if len(stops) < 2:
        return None
    middle = (stops[1:] + stops[:-1]) / 2
    index = np.clip(np.searchsorted(rising, middle, side="right") - 1, 0, len(width) - 1)
    ends = ((number, float(at[0] % wall.length)), (number, float(at[-1] % wall.length)))
    pressed = (number, float(min(at[0], at[-1])), float(max(at[0], at[-1])))
    return _Stretch(wall.point(sign * stops), width[index], ends, (pressed,))


def _nearest(walls: Sequence[Wall], xy: Floats) -> int:
    return int(np.argmin([wall.course.distance(Point(xy)) for wall in walls]))


def _chains(stretches: list[_Stretch | None]) -> list[list[_Stretch]]:
    """Stretches that follow on each other, parted where a line ends."""
    chains: list[list[_Stretch]] = [[]]
    for stretch in stretches:
        if stretch is None:
            chains.append([])
        else:
            chains[-1].append(stretch)
    return [chain for chain in chains if chain]


def _joined(line: int, chain: list[_Stretch]) -> Piece:
    xy = np.concatenate([chain[0].xy[:1], *(stretch.xy[1:] for stretch in chain)])
    width = np.concatenate([stretch.width for stretch in chain])
    step = xy[1:] - xy[:-1]
    moved = np.hypot(step[:, 0], step[:, 1]) > 1e-9
    keep = np.concatenate([[True], moved])
    ends = (chain[0].ends[0], chain[-1].ends[1])
    pressed = tuple(run for stretch in chain for run in stretch.pressed)
    return Piece(line, xy[keep], width[moved], ends, pressed)
