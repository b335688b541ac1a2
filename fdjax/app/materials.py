"""`[materials]`: which of several materials each road is laid with."""
# ruff: noqa: RUF009 - `key` gives a dataclass field

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.keys import FILE, FLAG, UNIT, Kind, Place, key, number, several, show, whole
from fdjax.part.part import Part
from fdjax.plan.materials import ByChance, ByPlace, Rule, centres, changes, numbered
from fdjax.plan.toolpath import Build
from fdjax.target.expression import Expression
from fdjax.target.image import image
from fdjax.target.raster import Raster
from fdjax.target.target import Target
from fdjax.units import length

Floats = NDArray[np.float64]


def _formula(value: Any, place: Place) -> str:
    try:
        return Expression(value if isinstance(value, str) else show(value)).text
    except InputError as fault:
        raise place.error(fault) from None


FORMULA = Kind("formula in x, y, z", _formula)

_WAYS = ("function", "image", "share")

_SHARE = number(0, 1)


def _shares(value: Any, place: Place) -> tuple[float, ...]:
    if isinstance(value, list | tuple):
        return several(_SHARE).read(value, place)
    return (_SHARE.read(value, place),)


_OFF = 0.01
"""By this part of what is asked of a material it may be off before a user is told."""

_SAMPLES = 200
"""Places along each side of a part at which the share that is asked is looked at."""


@dataclass(frozen=True)
class Materials:
    """Two or more materials, by one of three ways; none given is one material."""

    function: str | None = key(
        FORMULA,
        "the first material where it is below 0 at a road's centre, else the second",
        default=None, shown="-",
    )  # fmt: skip
    unit: str = key(UNIT, "of x, y and z in the formula", default="mm")
    image: Path | None = key(
        FILE, "picture over the part's bounding box: the first where it is dark at a road's centre",
        default=None, shown="-",
    )  # fmt: skip
    levels: tuple[float, ...] | None = key(
        several(number(-math.inf)), "rising values of the formula, or shades of the picture from "
        "0, black, to 1, where the next material begins", default=None,
        shown="`[0]`, of a picture `[0.5]`",
    )  # fmt: skip
    share: tuple[float, ...] | None = key(
        Kind("0 to 1, or a list of such", _shares),
        "of the second material, by volume, in roads drawn at random; a list is of the second, the "
        "third and so on", default=None, shown="-",
    )  # fmt: skip
    seed: int = key(whole(0, 2**32 - 1), "of the draw", default=0)
    split: bool = key(
        FLAG, "cut roads where the material changes, instead of asking at their centres; one road "
        "of a share that whole roads do not meet", default=False,
    )  # fmt: skip
    tools: tuple[int, ...] | None = key(
        several(whole(0, 15)), "numbers of the materials or tools of the machine, one each",
        default=None, shown="`[0, 1, ...]`",
    )  # fmt: skip

    def __post_init__(self) -> None:
        given = [name for name in _WAYS if getattr(self, name) is not None]
        if len(given) > 1:
            raise InputError(f"exactly one of {', '.join(_WAYS)} says it; {' and '.join(given)}")
        if not given and any(getattr(self, f.name) != f.default for f in fields(self)):
            raise InputError(f"needs one of {', '.join(_WAYS)}")
        for name, ways in (
            ("unit", ("function",)), ("levels", ("function", "image")), ("seed", ("share",)),
        ):  # fmt: skip
            default = next(f.default for f in fields(self) if f.name == name)
            if getattr(self, name) != default and given[0] not in ways:
                raise InputError(f"{name} is for {' or '.join(ways)}")
        if self.levels and list(self.levels) != sorted(set(self.levels)):
            raise InputError(f"levels: {show(self.levels)}; each must be above the one before")
        if self.share and sum(self.share) > 1 + 1e-9:
            raise InputError(f"share: {show(self.share)} are more than 1 together")
        tools = self.tools or ()
        if self.tools and (len(tools) != self._count or len(set(tools)) < len(tools)):
            raise InputError(f"tools: {show(tools)}; {self._count} different ones are needed")

    @property
    def given(self) -> bool:
        """Whether there are several materials at all."""
        return any(getattr(self, name) is not None for name in _WAYS)

    @property
    def _count(self) -> int:
        return 1 + len(self.share if self.share is not None else self._levels)

    @property
    def _levels(self) -> tuple[float, ...]:
        return self.levels or ((0.0,) if self.image is None else (0.5,))

    @property
    def numbers(self) -> tuple[int, ...]:
        """Of the machine's tools, one a material."""
        return self.tools or tuple(range(self._count))

    def rules(self, part: Part) -> list[Rule]:
        """Which roads of a part are beyond the first material, which of these beyond the second,
        and so on. Raises `InputError` for a picture that cannot be used.
        """
        if self.share is not None:
            left = [1.0, *(1 - np.cumsum([1 - sum(self.share), *self.share[:-1]]))]
            return [
                ByChance(min(after / before, 1.0) if before > 0 else 0.0, self.seed + k)
                for k, (before, after) in enumerate(pairwise(left))
            ]
        if self.function is not None:
            formula, mm = Expression(self.function), length(f"1{self.unit}", "materials unit")
            return [
                ByPlace(lambda x, y, z, level=level: formula(x / mm, y / mm, z / mm) - level)
                for level in self._levels
            ]
        assert self.image is not None
        samples = image(self.image, extent=part.bounds, quantity="solid").field
        assert isinstance(samples, Raster)
        shade, name = _nearest(samples), "picture, which must not be transparent,"
        return [
            ByPlace(lambda x, y, z, level=level: shade(x, y, z) - level, name)
            for level in self._levels
        ]

    def check(self, machine: Machine) -> None:
        """Raise `InputError` where a machine lacks one of the materials."""
        tools = len(machine.sml.materials) if machine.sml is not None else 0
        tools = machine.gcode.tools if machine.gcode is not None else tools
        if self.given and max(self.numbers) >= tools:
            more = "" if tools > 1 else '; "marlin-0.4-dual" has two'
            raise InputError(
                f"materials: tool {max(self.numbers)} is asked for, but {machine.name} has "
                f"{tools}, counted from 0{more}"
            )

    def asked(self, part: Part, target: Target) -> list[float]:
        """Share of each material by volume where each place has its own."""
        if self.share is not None:
            return [1 - sum(self.share), *self.share]
        rules = self.rules(part)
        x0, y0, x1, y1 = part.bounds
        steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        x, y = (
            each.ravel()
            for each in np.meshgrid(x0 + (x1 - x0) * steps, y0 + (y1 - y0) * steps, indexing="ij")
        )
        volumes = np.zeros(self._count)
        for slab, z in zip(part.slabs, part.middles, strict=True):
            inside = shapely.contains_xy(slab.region.geometry, x, y)
            at = np.column_stack([x[inside], y[inside], np.full(inside.sum(), z)])
            solid = np.asarray(target.solid(*at.T)) * slab.height
            volumes += np.bincount(numbered(rules, at, solid), solid, self._count)
        return [float(share) for share in volumes / volumes.sum()]

    def laid(self, part: Part, asked: Sequence[float], build: Build) -> dict[str, Any]:
        """What a file holds of the materials.

        `volumes` by number, mm^3; `got`, `asked`: share of each by volume, and what it was to
        be; `changes` of tool on the way; and where whole roads are asked at their
        centres, `wrong`: how many of the file's roads are not of the material of theirs. A format
        that cuts roads in two may count as wrong what is not.
        """
        places, volumes = centres(build)
        material = np.array([road.material for layer in build.layers for road in layer.roads])
        own = [float(volumes[material == number].sum()) for number in self.numbers]
        total = float(volumes.sum()) or 1.0
        facts = {
            "volumes": dict(zip(map(str, self.numbers), own, strict=True)),
            "got": [volume / total for volume in own],
            "asked": list(asked),
            "changes": changes(build),
        }
        if self.share is None and not self.split:
            right = np.array(self.numbers)[numbered(self.rules(part), places, volumes)]
            facts["wrong"] = int((material != right).sum())
        return facts

    def missed(self, facts: dict[str, Any]) -> list[str]:
        """In words, that the share of a material in a file, as `laid` says it, is off."""
        got, asked = np.array(facts["got"]), np.array(facts["asked"])
        off = np.abs(got - asked) - _OFF * asked
        worst = int(np.argmax(off))
        if off[worst] <= 0:
            return []
        more = "" if self.split else "; split = true cuts roads"
        return [
            f"materials: roads hold {got[worst]:.4f} of material {self.numbers[worst]}, "
            f"{asked[worst]:.4f} is asked{more}"
        ]


def _nearest(samples: Raster) -> Any:
    """The pixel over a place; a picture's first and last pixels reach to the box's sides."""

    def at(x: Floats, y: Floats, z: Floats) -> Floats:
        x0, y0, x1, y1 = samples.extent
        i, j = (
            np.clip(np.floor(share * count), 0, count - 1).astype(int)
            for share, count in zip(
                ((x - x0) / (x1 - x0), (y - y0) / (y1 - y0)), samples.values.shape, strict=True
            )
        )
        return samples.values[i, j]

    return at
