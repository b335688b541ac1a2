"""From a pattern's lines to a build: cut, joined, laid layer on layer."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from shapely import Polygon

from fdjax.errors import InputError
from fdjax.plan.join import lay_family
from fdjax.plan.simplify import simplify_road
from fdjax.plan.toolpath import Build, Floats, Layer, Road
from fdjax.road.bead import road_width, section_area


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
    clearance: float = 0.0,
    name: str = "part",
) -> Build:
    """The build that lays these families, a list for each layer, from the bed upwards.

    Beads stay inside `outline` and out of its holes; lines are joined along the walls where that
    is shorter than `lift_length` (mm) of lifting. `height` is the layers' height, mm. Points
    within `tolerance` (mm) of a straight road are dropped. Beads keep `clearance` (mm) more from
    all walls, for what dropping points and rounding to the machine's steps may take away again.
    Layers that repeat the same lines are laid alike. Raises `InputError` for an outline that is
    too narrow for the clearance.
    """
    room = outline.buffer(-clearance, join_style="mitre") if clearance > 0 else outline
    if not isinstance(room, Polygon) or room.is_empty:
        raise InputError(f"outline: falls apart when shrunk by {clearance:g} mm; it is too narrow")
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
                    room,
                    width=family.width,
                    lift_length=lift_length,
                    parity=family.parity,
                    family=family.family,
                )
            )
        result.append(Layer(round(number * height, 9), height, laid[key], outline))
    return Build(tuple(result), name)


def trim(build: Build, volume: float) -> Build:
    """The build with all roads' sections scaled alike, so that it deposits `volume` (mm^3).

    For designs whose road width is free: what a plan puts at walls, corners and holes differs by
    some tenths of a per cent from what design foresaw. Raises `InputError` for a build without
    roads.
    """
    if not build.volume > 0:
        raise InputError("trim: the build has no roads to scale")
    share = volume / build.volume

    def scaled(road: Road, height: float) -> Road:
        return replace(road, width=road_width(share * section_area(road.width, height), height))

    layers = tuple(
        replace(layer, roads=tuple(scaled(road, layer.height) for road in layer.roads))
        for layer in build.layers
    )
    return build.replace(layers=layers)
