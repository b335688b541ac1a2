"""`[materials]`: which of two materials each road is laid with."""
# ruff: noqa: RUF009 - `key` gives a dataclass field

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.keys import FILE, FLAG, UNIT, Kind, Place, key, number, pair, show, whole
from fdjax.part.part import Part
from fdjax.plan.materials import ByChance, ByPlace, Rule, centres, changes
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


FORMULA = Kind("formula in x, y", _formula)

_WAYS = ("function", "image", "share")

_OFF = 0.01
"""Of the smaller share, by which it may be off before a user is told."""

_SAMPLES = 200
"""Places along each side of a part at which the share that is asked is looked at."""


@dataclass(frozen=True)
class Materials:
    """Two materials, by one of three ways; none given is one material."""

    function: str | None = key(
        Kind("formula in x, y, z", _formula),
        "the first material where it is below 0 at a road's centre, else the second",
        default=None, shown="-",
    )  # fmt: skip
    unit: str = key(UNIT, "of x, y and z in the formula", default="mm")
    image: Path | None = key(
        FILE, "picture over the part's bounding box: the first where it is dark at a road's centre",
        default=None, shown="-",
    )  # fmt: skip
    share: float | None = key(
        number(0, 1), "of the second material, by volume, in roads drawn at random", default=None,
        shown="-",
    )  # fmt: skip
    seed: int = key(whole(0, 2**32 - 1), "of the draw", default=0)
    split: bool = key(
        FLAG, "cut roads where the material changes, instead of asking at their centres; one road "
        "of a share that whole roads do not meet", default=False,
    )  # fmt: skip
    tools: tuple[int, int] = key(
        pair(whole(0, 15)), "numbers of the two materials or tools of the machine", default=[0, 1]
    )

    def __post_init__(self) -> None:
        given = [name for name in _WAYS if getattr(self, name) is not None]
        if len(given) > 1:
            raise InputError(f"exactly one of {', '.join(_WAYS)} says it; {' and '.join(given)}")
        if not given and any(getattr(self, f.name) != f.default for f in fields(self)):
            raise InputError(f"needs one of {', '.join(_WAYS)}")
        if self.tools[0] == self.tools[1]:
            raise InputError(f"tools: both are {self.tools[0]}; two are needed")
        for name, way in (("unit", "function"), ("seed", "share")):
            default = next(f.default for f in fields(self) if f.name == name)
            if getattr(self, name) != default and getattr(self, way) is None:
                raise InputError(f"{name} is for a {way}")

    @property
    def given(self) -> bool:
        """Whether there are two materials at all."""
        return any(getattr(self, name) is not None for name in _WAYS)

    def rule(self, part: Part) -> Rule:
        """Which roads of a part are of the second material. Raises `InputError` for a picture
        that cannot be used.
        """
        if self.share is not None:
            return ByChance(self.share, self.seed)
        if self.function is not None:
            formula, mm = Expression(self.function), length(f"1{self.unit}", "materials unit")
            return ByPlace(lambda x, y, z: formula(x / mm, y / mm, z / mm))
        assert self.image is not None
        samples = image(self.image, extent=part.bounds, quantity="solid", low=-1.0, high=1.0).field
        assert isinstance(samples, Raster)
        return ByPlace(_nearest(samples), "picture, which must not be transparent,")

    def check(self, machine: Machine) -> None:
        """Raise `InputError` where a machine lacks one of the two materials."""
        tools = len(machine.sml.materials) if machine.sml is not None else 0
        tools = machine.gcode.tools if machine.gcode is not None else tools
        if self.given and max(self.tools) >= tools:
            more = "" if tools > 1 else '; "marlin-0.4-dual" has two'
            raise InputError(
                f"materials: tool {max(self.tools)} is asked for, but {machine.name} has {tools}, "
                f"counted from 0{more}"
            )

    def asked(self, part: Part, target: Target) -> float:
        """Share of the second material by volume where each place has its own."""
        if self.share is not None:
            return self.share
        rule = self.rule(part)
        x0, y0, x1, y1 = part.bounds
        steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        x, y = (
            each.ravel()
            for each in np.meshgrid(x0 + (x1 - x0) * steps, y0 + (y1 - y0) * steps, indexing="ij")
        )
        above = whole_part = 0.0
        for slab, z in zip(part.slabs, part.middles, strict=True):
            inside = shapely.contains_xy(slab.region.geometry, x, y)
            at = np.column_stack([x[inside], y[inside], np.full(inside.sum(), z)])
            solid = np.asarray(target.solid(*at.T)) * slab.height
            above += float(solid[rule(at, solid)].sum())
            whole_part += float(solid.sum())
        return above / whole_part

    def laid(self, part: Part, asked: float, build: Build) -> dict[str, Any]:
        """What a file holds of the two materials.

        `volumes` by number, mm^3; `got`, `asked`: share of the second by volume, and what it was to
        be; `changes` of tool on the way; and where whole roads are asked at their
        centres, `wrong`: how many of the file's roads are not of the material of theirs. A format
        that cuts roads in two may count as wrong what is not.
        """
        places, volumes = centres(build)
        material = np.array([road.material for layer in build.layers for road in layer.roads])
        second = material == self.tools[1]
        total = float(volumes.sum())
        facts = {
            "volumes": {str(k): float(volumes[material == k].sum()) for k in np.unique(material)},
            "got": float(volumes[second].sum()) / total if total else 0.0,
            "asked": asked,
            "changes": changes(build),
        }
        if self.share is None and not self.split:
            facts["wrong"] = int((second != self.rule(part)(places, volumes)).sum())
        return facts

    def missed(self, facts: dict[str, Any]) -> list[str]:
        """In words, that the share of a material in a file, as `laid` says it, is off."""
        got, asked = facts["got"], facts["asked"]
        if self.split or abs(got - asked) <= _OFF * min(asked, 1 - asked):
            return []
        return [
            f"materials: whole roads hold {got:.4f} of the second, {asked:.4f} is asked; "
            "split = true cuts roads"
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
