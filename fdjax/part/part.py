"""The layers of a part from the bed upwards. A plate is a part whose layers are alike."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.part.patch import Patch
from fdjax.part.region import Region


@dataclass(frozen=True, eq=False)
class Slab:
    """One layer: `z` of its top and its `height`, mm, and the `region` that its pattern fills."""

    z: float
    height: float
    region: Region


@dataclass(frozen=True, eq=False)
class Part:
    """Layers from the bed upwards.

    - `slabs`: at least one.
    - `patch`: the four sides of its region where they are known, for patterns that need them.

    >>> part = Part.plate([(0, 0), (8, 0), (8, 8), (0, 8)], layers=10, height=0.2)
    >>> len(part.slabs), part.height, round(part.volume, 9)
    (10, 2.0, 128.0)
    """

    slabs: tuple[Slab, ...]
    patch: Patch | None = None

    def __post_init__(self) -> None:
        if not self.slabs:
            raise InputError("part: it has no layers; at least one is needed")

    @classmethod
    def plate(cls, region: Any, *, layers: int = 10, height: float = 0.2) -> "Part":
        """`layers` alike of this `height` (mm).

        `region` is a `Region`, a `Patch`, or what `Region.of` takes.
        """
        if not isinstance(layers, int | np.integer):
            raise InputError(f"layers: {layers!r} is no whole number")
        if layers < 1:
            raise InputError(f"layers: {layers}; at least 1")
        patch = region if isinstance(region, Patch) else None
        own = Region.of(region.outline if isinstance(region, Patch) else region)
        return replace(cls.stack([own] * layers, height), patch=patch)

    @classmethod
    def stack(cls, regions: Sequence[Any], heights: float | Sequence[float]) -> "Part":
        """A layer for each of the regions, from the bed upwards, all or each of this height (mm).

        A region that is given for several layers is best given as the same object.
        """
        if isinstance(regions, str) or not hasattr(regions, "__len__"):
            raise InputError(f"regions: {regions!r:.60} is no list of regions, one for each layer")
        each = _heights(heights)
        each = np.repeat(each, len(regions)) if each.ndim == 0 else each
        if each.shape != (len(regions),):
            raise InputError(f"heights: {len(each)} given for {len(regions)} layers")
        made: dict[int, Region] = {}
        own = [made.setdefault(id(region), Region.of(region)) for region in regions]
        return cls(_stacked(own, each))

    def noted(self, notes: tuple[str, ...]) -> "Part":
        """The part with more notes on its first region."""
        first = self.slabs[0].region
        own = replace(first, notes=(*notes, *first.notes))
        slabs = (replace(s, region=own if s.region is first else s.region) for s in self.slabs)
        return replace(self, slabs=tuple(slabs))

    @property
    def height(self) -> float:
        """Of all layers together, mm."""
        return self.slabs[-1].z

    @property
    def volume(self) -> float:
        """Of the regions times their layers' heights, mm^3."""
        return sum(slab.region.area * slab.height for slab in self.slabs)

    @property
    def regions(self) -> tuple[Region, ...]:
        """Each region once, from the bed upwards."""
        found = {id(slab.region): slab.region for slab in self.slabs}
        return tuple(found.values())

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least x and y, largest x and y of all layers, mm."""
        boxes = np.array([region.bounds for region in self.regions])
        low, high = boxes[:, :2].min(0), boxes[:, 2:].max(0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @property
    def middles(self) -> NDArray[np.float64]:
        """Height of the middle of each layer, mm."""
        return np.array([slab.z - slab.height / 2 for slab in self.slabs])


def _heights(given: Any) -> NDArray[np.float64]:
    """Heights as numbers, mm, as many as there are."""
    try:
        return np.asarray(given, float)
    except (TypeError, ValueError):
        raise InputError(f"height: {given!r:.60} is no number of mm") from None


def _stacked(regions: Sequence[Region], heights: NDArray[np.float64]) -> tuple[Slab, ...]:
    for number, height in enumerate(heights, 1):
        if not (np.isfinite(height) and height > 0):
            raise InputError(f"layer {number}: height {height:g} mm; it must be positive")
    tops = np.round(np.cumsum(heights), 9).tolist()
    return tuple(map(Slab, tops, heights.tolist(), regions))
