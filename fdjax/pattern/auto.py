"""Patterns that suit an outline, to be tried one after the other."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array
from shapely import Point, Polygon

from fdjax.errors import InputError
from fdjax.grid.algebraic import Transfinite
from fdjax.grid.base import Sides, tangents
from fdjax.keys import choices, key
from fdjax.limits import Limits
from fdjax.part.annulus import Circle
from fdjax.part.part import Part
from fdjax.part.patch import from_polygon
from fdjax.pattern import settings_of
from fdjax.pattern.base import (
    AbstractPattern,
    AbstractSettings,
    mode_key,
    phases_key,
    road_width_key,
)
from fdjax.programs import program
from fdjax.road.porosity import midpoints
from fdjax.target.target import Target

TRIED = ("isolines", "transfinite", "polar", "o-transfinite", "blocks")


@dataclass(frozen=True)
class Auto(AbstractSettings):
    """What suits the outline, each designed and laid: the best is kept.

    Isolines always; polar lines for a disc or a ring between circles; lines of a map for an
    outline with one hole, and for another of which a map with four sides does not fold; blocks
    where they are found.
    """

    tried: tuple[str, ...] = key(
        choices(*TRIED), "what may be tried, where it suits the outline", default=list(TRIED)
    )
    mode: str = mode_key()
    phases: int = phases_key()
    road_width: float = road_width_key()

    @property
    def controls(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return ()

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> AbstractPattern:
        raise InputError('pattern: "auto" is several patterns; design each of its `candidates`')

    def candidates(self, part: Part) -> Iterator[tuple[str, AbstractSettings]]:
        """What is to be tried for a part, by name, the most likely first."""
        common = {"mode": self.mode, "phases": self.phases, "road_width": self.road_width}
        lines: Any = settings_of("grid-lines")
        for name in self.tried:
            if name in ("isolines", "blocks"):
                if name == "isolines" or _plain(part) is not None:
                    yield name, settings_of(name)(**common)
            elif name in _maps(part):
                yield name, lines(map=name, controls=("spacing_field",), **common)


def _plain(part: Part) -> Polygon | None:
    """The part's polygon, where it is one on all layers."""
    polygons = [polygon for region in part.regions for polygon in region.polygons]
    return polygons[0] if len(polygons) == 1 else None


def _maps(part: Part) -> tuple[str, ...]:
    """The maps that suit a part."""
    polygon = _plain(part)
    if polygon is None:
        return ()
    outer, holes = Circle.of(polygon.exterior), len(polygon.interiors)
    found: list[str] = []
    if outer is not None:
        middle = Point(outer.centre)
        about = any(Polygon(hole).contains(middle) for hole in polygon.interiors)
        if holes == 0 or about:
            found.append("polar")
    if holes == 1:
        found.append("o-transfinite")
    elif outer is None and not _folds(part, polygon):
        found.append("transfinite")
    return tuple(found)


def _folds(part: Part, polygon: Polygon) -> bool:
    """Whether lines of a transfinite map of the part would cross."""
    try:
        sides = Sides.of(part.patch or from_polygon(polygon))
    except InputError:
        return True
    return bool((_jacobian(sides) <= 0).any())


@program
def _jacobian(sides: Sides) -> Array:
    places = jnp.asarray(midpoints(_LOOKED))
    return tangents(Transfinite(sides), places[:, None], places[None])[1].jacobian


_LOOKED = 48
