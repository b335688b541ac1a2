"""A family of lines as continuous roads: cut at the walls, joined along them, put in order."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon

from fdjax.errors import InputError
from fdjax.part.region import Region
from fdjax.plan.chords import Chords, stretch
from fdjax.plan.cut import Piece, cut_lines
from fdjax.plan.join import Joins, choose, ways_along
from fdjax.plan.laid import Laid, shortest_road
from fdjax.plan.relink import relinked
from fdjax.plan.room import Room
from fdjax.plan.simplify import simplify_paths, simplify_roads
from fdjax.plan.thin import thin
from fdjax.plan.toolpath import Road
from fdjax.road.stroke import LONGEST_JOIN, Lines

Floats = NDArray[np.float64]

MUCH_TRAVEL = 0.013
"""A layer's travel is much where it exceeds this share of the length of its lines."""

WORTH_OTHER_PARITY = 10.0
"""Travel, mm, that a layer of the other parity than asked must save."""


def lay_lines(
    lines: Lines,
    room: Room | Region | Polygon | MultiPolygon,
    *,
    lift_length: float,
    longest_join: float | None = None,
    least_spacing: float | None = None,
    least_road: float = 0.0,
    tolerance: float = 0.0,
    start: ArrayLike | None = None,
) -> Laid:
    """Lay a family of level sets as roads inside a room, of whatever form.

    Each line is cut where its centre would come nearer to a wall than half the largest road width
    (see `cut_lines`). Where lines come too near each other the one in the way ends early (see
    `thin`). Ends that are neighbours on a wall are then joined along it, where `ways_along` finds
    a way, in the passes of `choose`: between levels k and k + 1 at every second gap, so that half
    of each wall is covered. Where that saves travel free ends then move along their walls (see
    `relinked`), and the other parity is taken (`WORTH_OTHER_PARITY`). A join has the mean width of
    the two ends.

    - `lift_length`: a join may be so much longer than the straight way, mm.
    - `longest_join`: along the wall, mm; None: `LONGEST_JOIN`. Where that saves travel, joins
      exceed both by half.
    - `least_spacing`: of centre lines, mm; None: the mean of the two roads' widths.
    - `least_road`: shorter roads are not laid, mm; nor any of less than `SHORTEST_ROAD` widths.
    - `tolerance`: points within this of a straight road are dropped, mm.
    - `start`: where the head comes from; the roads start near it.

    Returns the roads in the order in which they are laid, and as roads what was left out.
    Raises `InputError` for lines or widths that do not fit, or no room for a road.

    >>> from shapely import box
    >>> xy = [np.array([(x, 0.0), (x, 9.0)]) for x in (3, 2, 1)]
    >>> lines = Lines("xi", 0, np.arange(3), xy, [np.array([0.4])] * 3)
    >>> [len(road.xy) for road in lay_lines(lines, box(0, 0, 4, 9), lift_length=2).roads]
    [6]
    """
    arrays, widths = _checked(lines)
    if not arrays:
        return Laid()
    walls = (
        Room.of(room)
        .parted(lines.cuts)
        .walls(max(float(width.max()) for width in widths), lines.press)
    )
    arrays, widths = simplify_paths(arrays, widths, tolerance=tolerance / 2)
    cut = cut_lines(arrays, widths, walls)
    if not cut:
        return Laid()
    chords = Chords.of([piece.xy for piece in cut], [piece.width for piece in cut])
    pieces, gone = thin(cut, chords, arrays, lines.level, least_spacing=least_spacing)
    if gone:
        chords = Chords.of([piece.xy for piece in pieces], [piece.width for piece in pieces])
    level = [int(lines.level[piece.line]) for piece in pieces]
    ways, near = ways_along(
        pieces,
        chords,
        walls,
        lift_length=lift_length,
        longest_join=LONGEST_JOIN if longest_join is None else longest_join,
    )
    points = np.concatenate([piece.xy[[0, -1]] for piece in pieces])
    much = MUCH_TRAVEL * float(chords.length.sum())
    asked, other = (
        relinked(ways, choose(ways, level, parity, near), near, points, lift_length, much)
        for parity in (lines.parity, 1 - lines.parity)
    )
    # The parity that was asked covers the walls evenly.
    joins = (other if other.travel < asked.travel - WORTH_OTHER_PARITY else asked).joins

    def road(xy: Floats, width: Floats) -> Road:
        closed = len(xy) > 3 and bool((xy[0] == xy[-1]).all())
        xy = xy[:-1] if closed else xy
        return Road(xy, width, material=lines.material, family=lines.family, closed=closed)

    roads = [road(*_deposit(pieces, joins, run)) for run in joins.runs(len(pieces))]
    roads = simplify_roads(roads, tolerance=tolerance / 2)
    shortest = [shortest_road(each.width, least_road + tolerance) for each in roads]
    left_out = [road(piece.xy, piece.width) for piece in gone]
    return Laid.of(roads, shortest, start=start, left_out=left_out)


def _checked(lines: Lines) -> tuple[list[Floats], list[Floats]]:
    count = len(lines.xy)
    if not len(lines.width) == len(lines.level) == count:
        raise InputError(
            f"lines: {count} of them, {len(lines.width)} widths and {len(lines.level)} levels; "
            "one a line is needed"
        )
    arrays = [np.asarray(line, float) for line in lines.xy]
    widths = [np.asarray(width, float) for width in lines.width]
    for k, (xy, width) in enumerate(zip(arrays, widths, strict=True)):
        if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 2 or not np.isfinite(xy).all():
            raise InputError(f"line {k}: needs at least two finite points, shape (points, 2)")
        if width.shape != (len(xy) - 1,) or not (np.isfinite(width) & (width > 0)).all():
            raise InputError(f"line {k}: needs {len(xy) - 1} positive widths, one a segment")
    return arrays, widths


def _deposit(pieces: Sequence[Piece], joins: Joins, run: list[int]) -> tuple[Floats, Floats]:
    """Centre line and segment widths of a run."""
    xy: list[Floats] = []
    width: list[Floats] = []
    last = 0.0
    for entry in run:
        course, widths = _directed(pieces[entry // 2], entry % 2)
        if xy:
            way = joins.partner[entry][1][::-1]
            xy.append(way[1:-1])
            width.append(np.full(len(way) - 1, (last + widths[0]) / 2))
        last = float(widths[-1])
        before, after = joins.cut.get(entry, 0.0), joins.cut.get(entry ^ 1, 0.0)
        if before or after:
            length = float(np.hypot(*np.diff(course, axis=0).T).sum())
            course, widths = stretch(course, widths, before, length - after)
        xy.append(course)
        width.append(widths)
    points, widths = np.concatenate(xy), np.concatenate(width)
    moved = np.hypot(*np.diff(points, axis=0).T) > 1e-9
    return points[np.concatenate([[True], moved])], widths[moved]


def _directed(piece: Piece, back: int) -> tuple[Floats, Floats]:
    return (piece.xy[::-1], piece.width[::-1]) if back else (piece.xy, piece.width)
