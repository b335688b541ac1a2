"""Rasters of sub-domains: what a user says of them, and the air gaps that a target asks for."""
# ruff: noqa: RUF009 - `key` gives a dataclass field

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from math import gcd
from typing import Any

import jax.numpy as jnp
import numpy as np

from fdjax.errors import InputError
from fdjax.keys import LENGTH, Kind, Place, choice, key, number, pair, points, several, show, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.part.region import Region
from fdjax.pattern import subdomains
from fdjax.pattern.base import AbstractSettings, road_width_key
from fdjax.pattern.raster_pattern import Fill, RasterPattern, Way
from fdjax.road.bead import road_width, section_area
from fdjax.target.target import Target

FILLS = ("raster", "contour")

_LOOKS = 40
"""How many air gaps are looked at, at most."""

_NEAR, _CLOSE = 1e-3, 1e-3
"""Of the volume that is asked, and of a road's width, what need not be looked for: sections make up
for it."""

_MOST = 0.05
"""Largest share by which a sub-domain's sections change so that its mean is met exactly."""

_SAMPLES = 160
"""Places along the longer side of a sub-domain at which its target is looked at."""


def _domains(value: Any, place: Place) -> dict[str, Any]:
    if not isinstance(value, dict) or len(value) != 1:
        raise place.error(f"{show(value)}; one of grid, sites, levels or polygons is needed")
    ((way, what),) = value.items()
    readers = {
        "grid": pair(whole(1, 100)),
        "sites": points(1),
        "levels": several(number(0, 1)),
        "polygons": several(points(3)),
    }
    if way not in readers:
        choice(*readers).read(way, place)
    return {way: readers[way].read(what, place.at(f".{way}"))}


DOMAINS = Kind(
    "`{grid = [columns, rows]}`, `{sites = points}`, `{levels = solid shares}` or "
    "`{polygons = list of points}`",
    _domains,
)


@dataclass(frozen=True)
class Rasters(AbstractSettings):
    """Sub-domains that are filled each in its own way, for any outline.

    Lengths in mm. What has several values goes round the sub-domains in their order.
    """

    domains: dict[str, Any] | None = key(
        DOMAINS, "sub-domains: cells of a grid or around sites, where the target lies between "
        "levels, or as given; by default the region is one", default=None, shown="-",
    )  # fmt: skip
    fills: tuple[str, ...] = key(
        several(choice(*FILLS)), "of each sub-domain in turn", default=["raster"]
    )
    angles: tuple[float, ...] = key(
        several(number(-360, 360)), "of the rasters with the x axis, degrees, likewise",
        default=[45.0],
    )  # fmt: skip
    turn: float = key(
        number(-360, 360), "degrees by which every second layer turns them", default=90.0
    )
    road_width: float = road_width_key()
    road_widths: tuple[float, ...] | None = key(
        several(LENGTH), "of each sub-domain in turn, instead of one", default=None, shown="-"
    )
    perimeters: int = key(whole(0, 20), "closed roads along the sides of each", default=1)
    phases: int = key(
        whole(1, 100), "layers of one angle over which the lines are shifted", default=5
    )
    air_gaps: tuple[float, ...] | None = key(
        several(number(0)), "between roads, mm, of each in turn; by default what the target asks",
        default=None, shown="by target",
    )  # fmt: skip
    controls = ()

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> RasterPattern:
        """The fills of all sub-domains, with the air gaps that meet the mean of each.

        A gap is looked for at which the roads of all layers hold what the target asks; what whole
        lines leave over is met by the sections, up to 5 %. Raises `InputError` for sub-domains that
        do not cover the region once, and for one whose perimeters hold more, or whose densest fill
        holds less, than is asked.
        """
        regions = {slab.region for slab in part.slabs}
        if len(regions) > 1:
            raise InputError("rasters: all layers must have one outline")
        (region,) = regions
        narrowest, widest = limits.road_width
        for width in self.road_widths or ():
            if not narrowest <= width <= widest:
                raise InputError(
                    f"road_widths: {width:g} mm; the machine lays {narrowest:g} to {widest:g} mm"
                )
        outlines = self._outlines(region, target, part)
        ways = self._ways(len(part.slabs))
        fills = []
        for number_, outline in enumerate(outlines):
            width = self._width(number_)
            own = Fill(
                outline,
                _of(self.fills, number_),
                _of(self.angles, number_),
                width,
                width,
                0.0,
                self.perimeters,
                _asked(outline, target, part),
                self.air_gaps is None,
            )
            fills.append(self._gapped(own, number_, part, ways, limits))
        return RasterPattern(
            gaps=jnp.asarray([fill.gap for fill in fills]),
            density=jnp.asarray([fill.density(ways) for fill in fills]),
            fills=tuple(fills),
            ways=ways,
            heights=tuple(slab.height for slab in part.slabs),
            middles=tuple(part.middles.tolist()),
        )

    def _outlines(self, region: Region, target: Target, part: Part) -> list[subdomains.Outline]:
        if self.domains is None:
            return subdomains.whole(region)
        ((way, what),) = self.domains.items()
        if way == "grid":
            return subdomains.grid(region, *what)
        if way == "sites":
            return subdomains.voronoi(region, what)
        if way == "levels":
            return subdomains.levels(region, target, what, part.height / 2)
        return subdomains.given(region, what)

    def _width(self, number_: int) -> float:
        return self.road_width if self.road_widths is None else _of(self.road_widths, number_)

    def _ways(self, layers: int) -> tuple[Way, ...]:
        # A step near two fifths lets layers support each other, and their ends spread.
        step = min(
            (k for k in range(1, self.phases + 1) if gcd(k, self.phases) == 1),
            key=lambda k: abs(k - 0.382 * self.phases),
        )
        turns = 1 if self.turn % 180 == 0 else 2
        made = []
        for layer in range(layers):
            phase = (layer // turns * step % self.phases + 0.5) / self.phases
            made.append(Way(layer % turns * self.turn, phase))
        return tuple(made)

    def _gapped(
        self, fill: Fill, number_: int, part: Part, ways: tuple[Way, ...], limits: Limits
    ) -> Fill:
        """A fill with the air gap that its mean asks for, and sections that meet it exactly."""
        counts = Counter(zip(ways, (slab.height for slab in part.slabs), strict=True))
        volume = fill.asked * fill.outline.area * part.height
        own = [way for way, _ in counts]
        sections = [
            count * float(section_area(fill.width, height)) for (_, height), count in counts.items()
        ]

        def held(gap: float) -> float:
            return float(np.dot(fill.at(gap).lengths(own), sections))

        name = f"sub-domain {number_ + 1}"
        if self.air_gaps is not None:
            return fill.at(_of(self.air_gaps, number_))
        alone = fill.around * float(np.sum(sections))
        if alone * (1 - _MOST) > volume:
            raise InputError(
                f"{name}: a solid share of {fill.asked:.3f} is asked, and its perimeters alone "
                f"hold {alone / fill.outline.area / part.height:.3f}; ask for more, for larger "
                "sub-domains or for fewer perimeters"
            )
        least = max(0.0, (limits.least_spacing or 0.0) - fill.width)
        size = float(max(np.ptp(np.reshape(fill.outline.bounds, (2, 2)), axis=0)))
        gap, found = _gap_for(held, volume, fill.width, least, 2 * size)
        if not found > 0:
            raise InputError(
                f"{name}: has no room for roads {fill.width:g} mm wide; take fewer or larger "
                "sub-domains, or narrower roads"
            )
        if found < volume * (1 - _MOST) and gap <= least:
            raise InputError(
                f"{name}: a solid share of {fill.asked:.3f} is asked, and roads {fill.width:g} mm "
                f"wide that touch hold {found / fill.outline.area / part.height:.3f}"
            )
        return self._sized(fill.at(gap), volume / found, part)

    def _sized(self, fill: Fill, share: float, part: Part) -> Fill:
        """A fill whose sections are larger by a share, up to `_MOST`."""
        share = float(np.clip(share, 1 - _MOST, 1 + _MOST))
        height = float(np.mean([slab.height for slab in part.slabs]))
        section = share * float(section_area(fill.width, height))
        return fill.laid_at(float(road_width(np.array(section), height)))


def _gap_for(
    held: Callable[[float], float], volume: float, width: float, least: float, most: float
) -> tuple[float, float]:
    """The air gap, mm, at which roads `width` wide hold a volume, or the nearest to it that was
    found, and what they hold there.

    `held(gap)` falls in steps, as lines leave. The ends are `least`, and the first beyond `most`.
    """
    dense, sparse = -np.inf, np.inf
    best = least, held(least)
    if best[1] <= volume:
        return best
    gap, dense = least, least
    at = best[1]
    for _ in range(_LOOKS):
        # As if what is held went with one over the spacing.
        gap = (width + gap) * at / volume - width
        if sparse == np.inf:
            gap = max(gap, dense + width / 4)
            if dense > most:
                break
        elif not dense < gap < sparse:
            gap = (dense + sparse) / 2
        at = held(gap)
        if abs(at - volume) < abs(best[1] - volume):
            best = gap, at
        dense, sparse = (gap, sparse) if at > volume else (dense, gap)
        if abs(at / volume - 1) < _NEAR or sparse - dense < _CLOSE * width:
            break
    return best


def _of(values: tuple[Any, ...], number_: int) -> Any:
    return values[number_ % len(values)]


def _asked(outline: subdomains.Outline, target: Target, part: Part) -> float:
    """Mean solid share that is asked in an outline over all layers."""
    x, y = subdomains.places_in(outline, _SAMPLES).T
    heights = part.middles if target.varies_in_z else np.array([part.height / 2])
    return float(np.mean([target.solid(x, y, z) for z in heights]))
