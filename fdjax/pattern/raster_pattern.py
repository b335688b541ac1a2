"""Rasters of sub-domains as roads: each with its own angle, road width and air gap."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Array, Bool, Float

from fdjax.limits import Limits
from fdjax.pattern.base import AbstractPattern, Penalties
from fdjax.pattern.raster_paths import (
    Floats,
    Outline,
    contours,
    inset,
    opened,
    raster,
    rings,
)
from fdjax.pattern.subdomains import places_in
from fdjax.road.bead import section_area
from fdjax.road.deposit import Points
from fdjax.road.stroke import Paths, Subdomain

_CLEAR = 0.012
"""Beads keep so far from the sides, mm, for what rounding to a machine's steps may take."""

_APART = 2e-3
"""Roads that touch keep so much more than their width apart, mm, likewise."""

_CELLS = 24
"""Places along the longer side of a sub-domain at which design sees its material."""


class Way(NamedTuple):
    """How a layer is filled: turned by degrees, lines shifted by a share of their spacing."""

    turn: float
    phase: float


@dataclass(frozen=True, eq=False)
class Fill:
    """One sub-domain and how it is filled.

    - `outline`; `kind`: "raster" or "contour"; `angle`: degrees with the x axis.
    - `width`: of roads, by which they keep apart; `laid`: that they are laid with; `gap`: between
      them; mm. `perimeters`: closed roads along its sides.
    - `asked`: mean solid share; `by_target`: whether the gap follows from it.
    """

    outline: Outline
    kind: str
    angle: float
    width: float
    laid: float
    gap: float
    perimeters: int
    asked: float
    by_target: bool = True

    def at(self, gap: float) -> "Fill":
        return replace(self, gap=gap)

    def laid_at(self, width: float) -> "Fill":
        return replace(self, laid=width)

    def paths(self, way: Way) -> tuple[list[Floats], list[Floats]]:
        """Closed and open centre lines, (n, 2), mm, on a layer."""
        step = self.width + _APART
        closed, room = _inside(self.outline, self.width, self.perimeters)
        if room.is_empty:
            return closed, []
        spacing = step + self.gap
        if self.kind == "contour":
            # The first keeps an air gap from the perimeters, as the others do.
            return closed + contours(room, self.width, spacing, way.phase * self.gap / spacing), []
        return closed, raster(room, self.angle + way.turn, spacing, way.phase, apart=step)

    def length(self, way: Way) -> float:
        """Length of centre line on a layer, mm."""
        closed, open_ = self.paths(way)
        return sum(map(_length, [*(np.vstack([xy, xy[:1]]) for xy in closed), *open_]))

    @property
    def subdomain(self) -> Subdomain:
        return Subdomain(self.outline, self.kind, self.angle, self.laid, self.gap, self.perimeters)


@lru_cache(maxsize=4)
def _inside(outline: Outline, width: float, perimeters: int) -> tuple[list[Floats], Outline]:
    """The perimeters of a sub-domain, and what is left to fill: the same for all air gaps."""
    step, margin = width + _APART, width / 2 + _CLEAR
    closed = []
    for k in range(perimeters):
        closed += rings(opened(inset(outline, margin + k * step), width))
    return closed, opened(inset(outline, margin + perimeters * step), width)


class Realised(NamedTuple):
    """Air gap, mm, and density of centre line, 1/mm, in each sub-domain, shape (d,)."""

    gaps: Array
    density: Array
    made: Bool[Array, ""]


class RasterPattern(AbstractPattern):
    """Sub-domains filled with rasters or contours. The controls are their air gaps, (d,), mm.

    - `fills`: of the sub-domains, at the gaps that were found for them; `ways`, `heights`,
      `middles`: of each layer, mm.
    """

    gaps: Array
    fills: tuple[Fill, ...] = eqx.field(static=True)
    ways: tuple[Way, ...] = eqx.field(static=True)
    heights: tuple[float, ...] = eqx.field(static=True)
    middles: tuple[float, ...] = eqx.field(static=True)

    def controls(self) -> Array:
        return self.gaps

    def at(self, controls: Array) -> "RasterPattern":
        return eqx.tree_at(lambda p: p.gaps, self, controls)

    def realise(self, controls: Array) -> Realised:
        first = np.array([self._density(fill) for fill in self.fills])
        spacing = np.array([fill.width + fill.gap for fill in self.fills])
        width = np.array([fill.width for fill in self.fills])
        density = jnp.asarray(first * spacing) / (width + controls)
        return Realised(controls, density, jnp.isfinite(density).all())

    def _density(self, fill: Fill) -> float:
        """Centre line an area, a mean of the layers, 1/mm."""
        kinds = {way: self.ways.count(way) for way in set(self.ways)}
        total = sum(count * fill.length(way) for way, count in kinds.items())
        return total / len(self.ways) / fill.outline.area

    def deposit(self, realised: Realised) -> Points:
        places, volumes = [], []
        for number, fill in enumerate(self.fills):
            xy = places_in(fill.outline, _CELLS)
            share = fill.outline.area / len(xy)
            sections = np.array([float(section_area(fill.laid, h)) for h in self.heights])
            for middle, section in zip(self.middles, sections, strict=True):
                places.append(np.column_stack([xy, np.full(len(xy), middle)]))
                volumes.append(realised.density[number] * np.full(len(xy), section * share))
        return Points(jnp.asarray(np.concatenate(places)), jnp.concatenate(volumes))

    def cells(self, realised: Realised) -> tuple[Array, Array, Array]:
        centres = [shapely.get_coordinates(shapely.centroid(f.outline))[0] for f in self.fills]
        height = float(sum(self.heights))
        section = np.array([
            sum(float(section_area(fill.laid, h)) for h in self.heights) for fill in self.fills
        ])  # fmt: skip
        xyz = np.column_stack([np.array(centres), np.full(len(centres), height / 2)])
        volume = np.array([fill.outline.area for fill in self.fills]) * height
        return jnp.asarray(xyz), 1 - realised.density * section / height, jnp.asarray(volume)

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        """Air gaps below 0, as shares of the road width."""
        return {"gap": -realised.gaps / np.array([fill.width for fill in self.fills])}

    def roughness(self, controls: Array) -> Float[Array, " n"]:
        return jnp.zeros(1)

    def widths(self, realised: Realised) -> tuple[Array, Array]:
        width = jnp.asarray([fill.laid for fill in self.fills])
        return width.min(), width.max()

    def strokes(self, controls: Array) -> Iterator[Sequence[Paths]]:
        fills = [fill.at(float(gap)) for fill, gap in zip(self.fills, controls, strict=True)]
        made: dict[Way, list[Paths]] = {}
        for way in self.ways:
            if way not in made:
                made[way] = [
                    Paths(*fill.paths(way), fill.laid, fill.subdomain, fill.kind) for fill in fills
                ]
            yield made[way]

    def facts(self, controls: Array) -> dict[str, Any]:
        """Of each sub-domain: how it is filled, its gap and width, mm, and area, mm^2."""
        return {
            "kind": "rasters",
            "subdomains": [
                {
                    "fill": fill.kind,
                    "angle": fill.angle,
                    "road_width": fill.laid,
                    "air_gap": float(gap),
                    "perimeters": fill.perimeters,
                    "area": fill.outline.area,
                    "solid_asked": fill.asked,
                    "by_target": fill.by_target,
                }
                for fill, gap in zip(self.fills, controls, strict=True)
            ],
        }


def _length(xy: Floats) -> float:
    return float(np.hypot(*np.diff(xy, axis=0).T).sum())
