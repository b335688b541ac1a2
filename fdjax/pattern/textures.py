"""Textures as roads: what a user says of them."""
# ruff: noqa: RUF009 - `key` gives a dataclass field

from dataclasses import dataclass
from typing import Any

from fdjax.errors import InputError
from fdjax.keys import FILE, TEXT, Kind, Place, choice, key, number, pair, points, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.drawings import NAMES, drawing
from fdjax.pattern.drawn_settings import DrawnSettings
from fdjax.pattern.recursive_cell import RULES, Rule, clipped, recursive
from fdjax.pattern.svg_cell import cell_of, lines_of
from fdjax.pattern.texture_pattern import TexturePattern
from fdjax.pattern.unit_cell import UnitCell
from fdjax.target.target import Target


def _cell(value: Any, place: Place) -> UnitCell:
    if not isinstance(value, dict):
        return drawing(choice(*NAMES).read(value, place))
    recursive_too = value.keys() & {"rule", "order"}
    own = value.keys() - {"rule", "order"}
    if own not in ({"base"}, {"lines", "size"}, {"path", "size"}, {"svg"}):
        raise place.error(
            "needs lines and size, as in {size = [1, 1], lines = [[[0, 0], [1, 0]]]}, or path and "
            f"size, svg, or base; here it has {', '.join(own) or 'none of these'}"
        )
    if own == {"base"} and not recursive_too:
        raise place.error("a base needs a rule and an order, or is the name alone")
    if recursive_too == {"order"}:
        raise place.error("an order needs a rule, by which the cell grows")
    try:
        if own == {"base"}:
            base = drawing(choice(*NAMES).read(value["base"], place.at(".base")))
            lines, size = clipped(base), base.size
        elif own == {"svg"}:
            drawn, size = cell_of(FILE.read(value["svg"], place.at(".svg")))
            lines = [line.tolist() for line in drawn]
        else:
            lines, size = _lines(value, place)
        if not recursive_too:
            return UnitCell.of(lines, size)
        order = whole(1, 8).read(value.get("order", 1), place.at(".order"))
        return recursive(lines, size, _rule(value["rule"], place.at(".rule")), order)
    except InputError as fault:
        if str(fault).startswith(place.where):
            raise
        raise place.error(str(fault).removeprefix("cell: ")) from None


def _lines(value: dict[str, Any], place: Place) -> tuple[list[Any], tuple[float, float]]:
    size = pair(number(0)).read(value["size"], place.at(".size"))
    if "path" in value:
        text = TEXT.read(value["path"], place.at(".path"))
        return [line.tolist() for line in lines_of(text)], size
    if not isinstance(value["lines"], list):
        raise place.at(".lines").error("must be a list of lines")
    one = points(2)
    return [one.read(line, place.at(f".lines[{k}]")) for k, line in enumerate(value["lines"])], size


def _rule(value: Any, place: Place) -> Rule:
    if not isinstance(value, list):
        return Rule(RULES[choice(*RULES).read(value, place)])
    if not all(isinstance(row, str) for row in value):
        raise place.error('rows are text, as in ["32", "01"]')
    return Rule(tuple(value))


CELL = Kind(
    f"{', '.join(NAMES)}, or `{{size = [a, b], lines = list of points}}`, "
    "`{size = [a, b], path = SVG path}` or `{svg = file}`; with "
    f"`rule` ({', '.join(RULES)}, or rows of letters) and `order` recursive, from these lines or a "
    "`base` by name",
    _cell,
)


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
