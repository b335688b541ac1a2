"""From a pattern's lines to a build: cut, joined, laid layer on layer."""

from collections.abc import Sequence
from typing import Protocol

from shapely import Polygon

from fdjax.plan.join import lay_family
from fdjax.plan.simplify import simplify_road
from fdjax.plan.toolpath import Build, Floats, Layer, Road


class LineFamily(Protocol):
    """One family's lines on one layer, from wall to wall: what a pattern yields.

    `xy` has shape (lines, points, 2), mm; `width` (lines, points - 1), mm; `parity` says at which
    wall the first turn-around lies; `family` names it.
    """

    @property
    def family(self) -> str: ...
    @property
    def parity(self) -> int: ...
    @property
    def xy(self) -> Floats: ...
    @property
    def width(self) -> Floats: ...


def lay(
    layers: Sequence[Sequence[LineFamily]],
    outline: Polygon,
    *,
    height: float,
    lift_length: float,
    tolerance: float = 2e-3,
    name: str = "part",
) -> Build:
    """The build that lays these families, a list for each layer, from the bed upwards.

    Beads stay inside `outline` and out of its holes; lines are joined along the walls where that
    is shorter than `lift_length` (mm) of lifting. `height` is the layers' height, mm. Points within
    `tolerance` (mm) of a straight road are dropped. Layers that repeat the same lines are laid
    alike.
    """
    laid: dict[tuple[int, ...], tuple[Road, ...]] = {}
    result = []
    for number, families in enumerate(layers, 1):
        key = tuple(id(family) for family in families)
        if key not in laid:
            laid[key] = tuple(
                simplify_road(road, tolerance=tolerance)
                for family in families
                for road in lay_family(
                    family.xy,
                    outline,
                    width=family.width,
                    lift_length=lift_length,
                    parity=family.parity,
                    family=family.family,
                )
            )
        result.append(Layer(round(number * height, 9), height, laid[key], outline))
    return Build(tuple(result), name)
