"""Patterns that suit an outline, to be tried one after the other."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from shapely import Point, Polygon

from fdjax.errors import InputError
from fdjax.keys import choices, key
from fdjax.limits import Limits
from fdjax.part.annulus import Circle
from fdjax.part.part import Part
from fdjax.pattern import settings_of
from fdjax.pattern.base import (
    AbstractPattern,
    AbstractSettings,
    mode_key,
    phases_key,
    road_width_key,
)
from fdjax.target.target import Target

TRIED = ("isolines", "transfinite", "polar", "o-transfinite", "blocks")

CORNER = np.radians(35)
"""An outline turns by more than this at a clear corner."""


@dataclass(frozen=True)
class Auto(AbstractSettings):
    """What suits the outline, each designed and laid: the best is kept.

    Isolines always; lines of a map for an outline with four clear corners or with one hole;
    polar lines for a disc or a ring between circles; blocks where they are found.
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
    elif outer is None and (part.patch is not None or _clear_corners(polygon) == 4):
        found.append("transfinite")
    return tuple(found)


def _clear_corners(polygon: Polygon) -> int:
    """How many clear corners the outline has; -1 where one of them points inwards."""
    xy = np.asarray(polygon.exterior.coords)[:-1]
    step = np.roll(xy, -1, axis=0) - xy
    heading = np.arctan2(*step.T[::-1])
    turn = (heading - np.roll(heading, 1) + np.pi) % (2 * np.pi) - np.pi
    turn = turn if polygon.exterior.is_ccw else -turn
    return -1 if (turn < -CORNER).any() else int((turn > CORNER).sum())
