"""Rasters and contours that fill a sub-domain, as they are laid: lines turned round at its sides.

Loads no JAX.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.pattern.zigzag import INSIDE, Sides, Zigzags

Floats = NDArray[np.float64]
Outline = shapely.Polygon | shapely.MultiPolygon

_LONGEST_TURN = 10.0
"""A turn along a side that is longer than so many spacings is no turn: the head lifts."""

_FINE = 2e-3
"""Points within this of a contour's straight sides are dropped, mm."""


def inset(outline: Outline, by: float) -> Outline:
    """What of an outline lies further than this, mm, from its sides; may be empty."""
    return shapely.buffer(outline, -by, join_style="mitre", mitre_limit=3)


def opened(outline: Outline, width: float) -> Outline:
    """An outline without what is narrower than a road, where it would lie on its other side."""
    deep = inset(outline, width / 2)
    wide = shapely.buffer(deep, width / 2, join_style="mitre", mitre_limit=3)
    left = shapely.intersection(wide, outline)
    return left if isinstance(left, Outline) else shapely.MultiPolygon()


def rings(outline: Outline) -> list[Floats]:
    """Closed paths (n, 2) along all sides of an outline, the first point not repeated."""
    found = []
    for polygon in shapely.get_parts(shapely.simplify(outline, _FINE)):
        if not isinstance(polygon, shapely.Polygon):
            continue
        for ring in (polygon.exterior, *polygon.interiors):
            xy = shapely.get_coordinates(ring)[:-1]
            if len(xy) > 2:
                found.append(xy)
    return found


def contours(room: Outline, width: float, spacing: float, phase: float) -> list[Floats]:
    """Closed paths at distances of (k + phase) spacings from the sides of the room."""
    found, depth = [], phase * spacing
    while not (at := inset(room, depth)).is_empty:
        found += rings(opened(at, width))
        depth += spacing
    return found


def raster(
    room: Outline, angle: float, spacing: float, phase: float, *, apart: float = 0.0
) -> list[Floats]:
    """Open paths (n, 2) of parallel lines at (k + phase) spacings, joined at the room's sides.

    - `angle`: of the lines with the x axis, degrees.
    - `apart`: what ends that face each other keep from each other, mm, where a corner or a hole
      that reaches just over a line cuts it in two; and what turns keep from other lines.

    A line goes on to the next at the same side where the straight way keeps to the room and is no
    longer than ten spacings.
    """
    turned = _turned(room, angle)
    (y,) = turned.heights(spacing, [phase])
    longest = _LONGEST_TURN * spacing
    chains: Iterable[Any]
    if (plain := turned.zigzags([y], longest)) is not None:
        chains = [plain.points()] if len(plain.y) else []
    else:
        chains = _chains(*turned.cut(y, apart), turned.reach, longest, apart)
    turn = np.exp(1j * np.radians(angle))
    paths = [np.asarray(chain) @ [1, 1j] * turn for chain in chains]
    return [np.stack([path.real, path.imag], 1) for path in paths]


def raster_lengths(
    room: Outline, angle: float, spacing: float, phases: Sequence[float], *, apart: float = 0.0
) -> Floats:
    """Length, mm, of all paths of `raster` for each of some phases, (phases,)."""
    turned = _turned(room, angle)
    heights = turned.heights(spacing, phases)
    plain = turned.zigzags(heights, _LONGEST_TURN * spacing)
    if plain is not None:
        return plain.lengths(len(phases))
    return np.array([
        sum(map(length_of, raster(room, angle, spacing, phase, apart=apart))) for phase in phases
    ])  # fmt: skip


def length_of(xy: Floats) -> float:
    """Length of a path (n, 2)."""
    return float(np.hypot(*np.diff(xy, axis=0).T).sum())


class _Turned:
    """A room turned back by an angle, degrees, so that its lines run along x."""

    def __init__(self, room: Outline, angle: float) -> None:
        self._outline = shapely.affinity.rotate(room, -angle, origin=(0, 0))
        self._bounds = self._outline.bounds
        self._sides = Sides.of(self._outline)

    @cached_property
    def reach(self) -> Outline:
        """What reaches just over the room."""
        reach = shapely.buffer(self._outline, INSIDE)
        shapely.prepare(reach)
        return reach

    def heights(self, spacing: float, phases: Sequence[float]) -> list[Floats]:
        """y of the lines that meet the room, for each phase, mm."""
        _, low, _, high = self._bounds
        return [
            (
                np.arange(np.ceil(low / spacing - phase), np.floor(high / spacing - phase) + 1)
                + phase
            )
            * spacing
            for phase in phases
        ]

    def zigzags(self, heights: Sequence[Floats], longest: float) -> Zigzags | None:
        """The paths over lines at these heights where each is known to be one, the same that
        `_chains` finds.
        """
        if self._sides is None:
            return None
        path = np.repeat(np.arange(len(heights)), [len(y) for y in heights])
        return self._sides.zigzags(np.concatenate(heights), path, longest)

    def cut(self, y: Floats, apart: float) -> tuple[Floats, NDArray[np.intp]]:
        """The pieces (x0, y, x1, y) of lines at these heights, line by line, and whose they are."""
        x0, _, x1, _ = self._bounds
        ends = np.stack([np.full_like(y, x0 - 1), np.full_like(y, x1 + 1)], 1)
        lines = shapely.linestrings(np.stack([ends, np.repeat(y[:, None], 2, 1)], -1))
        pieces = shapely.intersection(lines, self._outline)
        parts, owner = shapely.get_parts(pieces, return_index=True)
        bounds = shapely.bounds(parts)
        in_order = np.lexsort((bounds[:, 0], owner))
        bounds, owner = bounds[in_order], owner[in_order]
        short = np.where(owner[1:] == owner[:-1], apart - (bounds[1:, 0] - bounds[:-1, 2]), 0.0)
        bounds[1:, 0] += np.maximum(short, 0) / 2
        bounds[:-1, 2] -= np.maximum(short, 0) / 2
        long = bounds[:, 2] - bounds[:, 0] > INSIDE
        return bounds[long], owner[long]


@lru_cache(maxsize=8)
def _turned(room: Outline, angle: float) -> _Turned:
    """Alike for all gaps and phases."""
    return _Turned(room, angle)


def _chains(
    bounds: Floats, owner: NDArray[np.intp], reach: Outline, longest: float, apart: float
) -> Iterator[list[tuple[float, float]]]:
    """Runs over the pieces of lines, each of which is (x0, y, x1, y), line by line."""
    before: list[_Run] = []
    now: list[_Run] = []
    for line in np.unique(owner):
        pieces = bounds[owner == line]
        # A turn touches the two pieces that it joins, and is clear of all else beside it.
        beside = list(
            shapely.linestrings(
                [*(run.points[-2:] for run in before), *pieces.reshape(-1, 2, 2).tolist()]
            )
        )
        ways = [
            (float(np.hypot(run.end(left)[0] - x, run.end(left)[1] - y)), k, piece, left)
            for piece, (x0, y, x1, _) in enumerate(pieces.tolist())
            for k, run in enumerate(before)
            for left, x in ((True, x0), (False, x1))
            if left in run.sides
        ]
        first = len(before)
        onward: dict[int, tuple[int, bool]] = {}
        for length, k, piece, left in sorted(ways):
            if length > longest:
                break
            if piece in onward or k in (run for run, _ in onward.values()):
                continue
            x0, y, x1, _ = pieces[piece].tolist()
            way = shapely.linestrings([before[k].end(left), (x0 if left else x1, y)])
            others = [each for at, each in enumerate(beside) if at not in (k, first + piece)]
            if reach.covers(way) and (
                not others or shapely.distance(others, way).min() >= apart - INSIDE
            ):
                onward[piece] = k, left
                beside.append(way)
        for piece, (x0, y, x1, _) in enumerate(pieces.tolist()):
            if piece in onward:
                k, left = onward[piece]
                now.append(before[k].on(left, (x0, y), (x1, y)))
            else:
                now.append(_Run([(x0, y), (x1, y)], (True, False)))
        taken = {k for k, _ in onward.values()}
        yield from (run.points for k, run in enumerate(before) if k not in taken)
        before, now = now, []
    yield from (run.points for run in before)


class _Run(NamedTuple):
    """A path over lines; `sides`: at which ends of its last line, left or not, it may go on.

    A single line, from its left end to its right, may go on at both.
    """

    points: list[tuple[float, float]]
    sides: tuple[bool, ...]

    def end(self, left: bool) -> tuple[float, float]:
        return self.points[0] if left and len(self.sides) == 2 else self.points[-1]

    def on(self, left: bool, a: tuple[float, float], b: tuple[float, float]) -> "_Run":
        points = self.points[::-1] if left and len(self.sides) == 2 else self.points
        return _Run([*points, *((a, b) if left else (b, a))], (not left,))
