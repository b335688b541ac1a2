"""Cells of higher order, each built from copies of the one before. Loads no JAX.

The paper (Figure 1): "recursively constructing higher-order unit cells that fill the plane through
periodic tiling".
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.pattern.unit_cell import UnitCell

Floats = NDArray[np.float64]

_GRID = 1e-9
"""Points of a drawing are rounded to this share of a cell's side, so that copies meet."""

_MOST = 20_000
"""Edges of a cell that can be worked with."""

BASE, EMPTY = "b", "."

RULES = {
    "mirror": ("62", "04"),
    "turn": ("32", "01"),
    "wind": ("20", "13"),
    "nest": ("b0", "0b"),
}
"""Rules by name: quarters mirrored on their common sides; turned about their common corner; each
turned another way, so that lines wind; and two that hold the base, as large as the others."""


@dataclass(frozen=True)
class Rule:
    """How a cell is built of copies of the one before.

    `rows`, the top row first: a letter for each place. `0` to `3` is the cell turned by so many
    quarters, counter-clockwise; `4` to `7` the same of the cell mirrored left to right; `b` is the
    base, drawn as large as the others; `.` is left empty.

    Raises `InputError` for rows of different lengths, other letters, or no cell at all.
    """

    rows: tuple[str, ...]

    def __post_init__(self) -> None:
        rows = self.rows
        if not rows or len({len(row) for row in rows}) != 1 or not rows[0]:
            raise InputError("rule: needs rows of one length, one letter for each place")
        for row in rows:
            for letter in row:
                if letter not in f"01234567{BASE}{EMPTY}":
                    raise InputError(
                        f'rule: "{letter}" is no letter of a rule; 0 to 7 turn and mirror, '
                        f"{BASE} is the base, {EMPTY} is empty"
                    )
        if not set("".join(rows)) - {EMPTY, BASE}:
            raise InputError("rule: no place holds the cell before, 0 to 7")

    @property
    def shape(self) -> tuple[int, int]:
        """Places along x and along y."""
        return len(self.rows[0]), len(self.rows)

    def at(self, i: int, j: int) -> str:
        """The letter of a place, counted from the lower left."""
        return self.rows[-1 - j][i]

    @property
    def turns(self) -> bool:
        """Whether a cell is turned by one quarter or three."""
        return bool(set("1357") & set("".join(self.rows)))


def recursive(
    lines: Sequence[Sequence[Sequence[float]]], size: tuple[float, float], rule: Rule, order: int
) -> UnitCell:
    """The cell of this order that a rule builds from a base, the cell of order 0.

    - `lines`: of the base, polylines inside [0, a] x [0, b]; `size`: (a, b). The base need not
      repeat by itself.

    Lines may cross and lie on one another: they meet in nodes, and each is laid once. Raises
    `InputError`, with the place, where a line ends at a side between two cells and none goes on;
    for lines beyond the base; for quarter turns of one that is not square; for more than 20,000
    edges; and what `UnitCell.of` raises.

    >>> cell = recursive([[(0, 0), (1, 1)]], (1, 1), Rule(RULES["mirror"]), 1)
    >>> cell.size, round(cell.density, 6)
    ((2.0, 2.0), 1.414214)
    """
    base = _pieces(lines, size)
    if rule.turns and abs(size[0] - size[1]) > _GRID * max(size):
        raise InputError(f"cell: {size[0]:g} x {size[1]:g} cannot turn by a quarter: not square")
    if rule.turns and order > 1 and rule.shape[0] != rule.shape[1]:
        raise InputError("rule: as many rows as columns are needed where a quarter turns")
    copies = sum(letter not in (BASE, EMPTY) for row in rule.rows for letter in row)
    if len(base) * copies**order > _MOST:
        raise InputError(
            f"cell: order {order} has {len(base) * copies**order} edges; {_MOST} can be, take a "
            "lower order"
        )
    now, side = base, np.array(size, float)
    for number in range(1, order + 1):
        grown = []
        for i in range(rule.shape[0]):
            for j in range(rule.shape[1]):
                letter = rule.at(i, j)
                if letter == EMPTY:
                    continue
                own = base * (side / size) if letter == BASE else _turned(now, side, int(letter))
                grown.append(own + np.array([i, j]) * side)
        now = _noded(np.concatenate(grown), float(side.max()))
        _check_inside(now, side, rule, number)
        side = side * rule.shape
    # What lies on the right and the upper side belongs to the next cell.
    around = [now + np.array([i, j]) * side for i in (-1, 0, 1) for j in (-1, 0, 1)]
    near = np.concatenate(around)
    beside = (near.max(1) >= -_GRID * side) & (near.min(1) <= side * (1 + _GRID))
    whole = _noded(near[beside.all(1)], float(side.max()))
    middle = whole.mean(1) + _GRID * side
    own = whole[((middle >= 0) & (middle < side)).all(1)]
    return UnitCell.of(own.tolist(), (float(side[0]), float(side[1])))


def _pieces(lines: Sequence[Sequence[Sequence[float]]], size: tuple[float, float]) -> Floats:
    """The segments of a base, shape (n, 2, 2)."""
    UnitCell.check_lines(lines, size)
    drawn = [np.asarray(line, float) for line in lines]
    for line in drawn:
        beyond = (line < -_GRID * np.array(size)) | (line > np.array(size) * (1 + _GRID))
        if beyond.any():
            x, y = line[beyond.any(1)][0]
            raise InputError(
                f"cell: ({x:g}, {y:g}) lies beyond the base, {size[0]:g} x {size[1]:g}"
            )
    pieces = np.concatenate([np.stack([line[:-1], line[1:]], 1) for line in drawn])
    return pieces[(pieces[:, 0] != pieces[:, 1]).any(1)]


def clipped(cell: UnitCell) -> list[list[list[float]]]:
    """What a cell's copies draw inside [0, a] x [0, b], both sides included: lines of a base."""
    box = shapely.box(0, 0, *cell.size)
    cut = shapely.intersection(shapely.linestrings(cell.tiled(range(-1, 2))), box)
    parts = shapely.get_parts(cut)
    parts = parts[shapely.length(parts) > _GRID * max(cell.size)]
    return [np.clip(shapely.get_coordinates(part), 0, cell.size).tolist() for part in parts]


def _turned(pieces: Floats, side: Floats, how: int) -> Floats:
    """A cell mirrored from 4 on, and turned by so many quarters, in its own place."""
    from_middle = pieces - side / 2
    if how >= 4:
        from_middle = from_middle * [-1, 1]
    for _ in range(how % 4):
        from_middle = from_middle[..., ::-1] * [-1, 1]
    # Turned by a quarter, and the last place of a rule too, it is as wide as before: it is square.
    return from_middle + side / 2


def _noded(pieces: Floats, side: float) -> Floats:
    """The segments with a point wherever they meet, each once."""
    lines = shapely.linestrings(pieces)
    parts = shapely.get_parts(shapely.union_all(lines, grid_size=_GRID * side))
    xy, owner = shapely.get_coordinates(parts, return_index=True)
    go_on = owner[1:] == owner[:-1]
    return np.stack([xy[:-1][go_on], xy[1:][go_on]], 1)


def _check_inside(pieces: Floats, side: Floats, rule: Rule, order: int) -> None:
    """Raise `InputError` for a line that ends where two cells meet, with none to go on from it."""
    unit = np.round(pieces.reshape(-1, 2) / (_GRID * 8 * side)).astype(np.int64)
    _, first, count = np.unique(unit, axis=0, return_index=True, return_counts=True)
    for x, y in pieces.reshape(-1, 2)[first[count == 1]]:
        for axis in (0, 1):
            place = np.array([x, y]) / side
            line = round(place[axis])
            if abs(place[axis] - line) > 1e-6 or not 0 < line < rule.shape[axis]:
                continue
            after = np.minimum(np.floor(place + 1e-6), np.array(rule.shape) - 1).astype(int)
            after[axis] = line
            before = after.copy()
            before[axis] -= 1
            if EMPTY not in (rule.at(*before.tolist()), rule.at(*after.tolist())):
                raise InputError(
                    f"cell: at order {order} a line ends at ({x:g}, {y:g}), on the side between "
                    "two cells, and none goes on from there"
                )
