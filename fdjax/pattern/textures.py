"""Textures as roads: what a user says of them."""
# ruff: noqa: RUF009 - `key` gives a dataclass field

from dataclasses import dataclass
from typing import Any

from fdjax.errors import InputError
from fdjax.keys import Kind, Place, choice, key, number, pair, points
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.drawings import NAMES, drawing
from fdjax.pattern.drawn_settings import DrawnSettings
from fdjax.pattern.texture_pattern import TexturePattern
from fdjax.pattern.unit_cell import UnitCell
from fdjax.target.target import Target


def _cell(value: Any, place: Place) -> UnitCell:
    if not isinstance(value, dict):
        return drawing(choice(*NAMES).read(value, place))
    if value.keys() != {"lines", "size"}:
        raise place.error("needs lines and size, as in {size = [1, 1], lines = [[[0, 0], [1, 0]]]}")
    size = pair(number(0)).read(value["size"], place.at(".size"))
    lines = value["lines"]
    if not isinstance(lines, list):
        raise place.at(".lines").error("must be a list of lines")
    one = points(2)
    drawn = [one.read(line, place.at(f".lines[{k}]")) for k, line in enumerate(lines)]
    try:
        return UnitCell.of(drawn, size)
    except InputError as fault:
        raise place.error(fault) from None


CELL = Kind(f"{', '.join(NAMES)}, or `{{size = [a, b], lines = list of points}}`", _cell)


@dataclass(frozen=True)
class Textures(DrawnSettings):
    """A unit cell repeated over a part, for any outline and target.

    Lengths in mm. See the job's keys for what each value means.
    """

    cell: UnitCell = key(
        CELL, "the drawing that repeats: by name, or lines in a cell of this size, in any unit",
        default="hexagonal",
    )  # fmt: skip

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> TexturePattern:
        """The drawing as `DrawnSettings.drawing` begins it, and raises."""
        cell = self.cell
        fields = self.drawing(
            part, target, limits, window, directions=cell.directions, gap=cell.gap, pore=cell.pore
        )
        return TexturePattern(**fields, kind="texture", cell=cell)
