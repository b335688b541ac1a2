"""Rasters of sub-domains as roads: each with its own angle, road width and air gap."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
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
    length_of,
    opened,
    raster,
    raster_lengths,
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

    @property
    def around(self) -> float:
        """Length of its perimeters on a layer, mm."""
        return float(sum(map(_around, _inside(self.outline, self.width, self.perimeters)[0])))

    def lengths(self, ways: Sequence[Way]) -> Floats:
        """Length of centre line on each of some layers, (layers,), mm."""
        _, room = _inside(self.outline, self.width, self.perimeters)
        found = np.full(len(ways), self.around)
        if room.is_empty:
            return found
        if self.kind == "contour":
            return np.array([sum(map(_around, self.paths(way)[0])) for way in ways])
        step = self.width + _APART
        turns = np.array([way.turn for way in ways])
        phases = np.array([way.phase for way in ways])
        for turn in set(turns.tolist()):
            own = turns == turn
            found[own] += raster_lengths(
                room, self.angle + turn, step + self.gap, phases[own].tolist(), apart=step
            )
        return found

    def density(self, ways: Sequence[Way]) -> float:
        """Centre line an area, a mean of the layers, 1/mm."""
        counts = Counter(ways)
        total = np.dot(self.lengths([*counts]), [*counts.values()])
        return float(total) / len(ways) / self.outline.area

    @cached_property
    def places(self) -> Floats:
        """Where design sees its material, (n, 2), mm: no finer than roads are wide."""
        return places_in(self.outline, _CELLS, least=self.width)

    @cached_property
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

    - `density`: of centre line at the gaps that were found, a mean of the layers, (d,), 1/mm.
    - `fills`: of the sub-domains, at these gaps; `ways`, `heights`, `middles`: of each layer, mm.
    """

    gaps: Array
    density: Array
    fills: tuple[Fill, ...] = eqx.field(static=True)
    ways: tuple[Way, ...] = eqx.field(static=True)
    heights: tuple[float, ...] = eqx.field(static=True)
    middles: tuple[float, ...] = eqx.field(static=True)

    def controls(self) -> Array:
        return self.gaps

    def at(self, controls: Array) -> "RasterPattern":
        return eqx.tree_at(lambda p: p.gaps, self, controls)

    def realise(self, controls: Array) -> Realised:
        spacing = np.array([fill.width + fill.gap for fill in self.fills])
        width = np.array([fill.width for fill in self.fills])
        density = self.density * spacing / (width + controls)
        return Realised(controls, density, jnp.isfinite(density).all())

    def _sections(self) -> Floats:
        """Of the roads of each sub-domain on each layer, (d, layers), mm^2."""
        widths = np.array([fill.laid for fill in self.fills])
        return np.asarray(section_area(widths[:, None], np.array(self.heights)))

    def deposit(self, realised: Realised) -> Points:
        layers = len(self.middles)
        many = np.array([len(fill.places) for fill in self.fills])
        owner = np.repeat(np.arange(len(many)), many)
        area = np.array([fill.outline.area for fill in self.fills])
        sections = self._sections() * (area / many)[:, None]
        xy = np.concatenate([fill.places for fill in self.fills])
        xyz = np.column_stack([np.tile(xy, (layers, 1)), np.repeat(self.middles, len(xy))])
        return Points(jnp.asarray(xyz), (realised.density[:, None] * sections)[owner].T.ravel())

    def cells(self, realised: Realised) -> tuple[Array, Array, Array]:
        outlines = np.array([fill.outline for fill in self.fills])
        height = float(sum(self.heights))
        centres = shapely.get_coordinates(shapely.centroid(outlines))
        xyz = np.column_stack([centres, np.full(len(centres), height / 2)])
        solid = realised.density * self._sections().sum(1) / height
        return jnp.asarray(xyz), 1 - solid, jnp.asarray(shapely.area(outlines) * height)

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        """Air gaps below 0, as shares of the road width."""
        return {"gap": -realised.gaps / np.array([fill.width for fill in self.fills])}

    def roughness(self, controls: Array) -> Float[Array, " n"]:
        return jnp.zeros(1)

    def widths(self, realised: Realised) -> tuple[Array, Array]:
        width = jnp.asarray([fill.laid for fill in self.fills])
        return width.min(), width.max()

    def strokes(self, controls: Array) -> Iterator[Sequence[Paths]]:
        made: dict[Way, list[Paths]] = {way: [] for way in self.ways}
        for first, gap in zip(self.fills, np.asarray(controls).tolist(), strict=True):
            fill = first.at(gap)
            for way, paths in made.items():
                paths.append(Paths(*fill.paths(way), fill.laid, fill.subdomain, fill.kind))
        return (made[way] for way in self.ways)

    def facts(self, controls: Array) -> dict[str, Any]:
        """Of each sub-domain: how it is filled, its gap and width, mm, and area, mm^2."""
        return {
            "kind": "rasters",
            "subdomains": [
                {
                    "fill": fill.kind,
                    "angle": fill.angle,
                    "road_width": fill.laid,
                    "air_gap": gap,
                    "perimeters": fill.perimeters,
                    "area": fill.outline.area,
                    "solid_asked": fill.asked,
                    "by_target": fill.by_target,
                }
                for fill, gap in zip(self.fills, np.asarray(controls).tolist(), strict=True)
            ],
        }


def _around(xy: Floats) -> float:
    """Length of a closed path (n, 2), mm."""
    return length_of(np.vstack([xy, xy[:1]]))
