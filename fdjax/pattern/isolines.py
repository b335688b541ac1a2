"""Isolines as roads: what a user says of them, and how they begin.

Straight lines, as dense across as the target asks, twisted about the middle: how many lines end a
mm of wall follows from their number alone, but lines that run obliquely inside are dense there.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fdjax.field.spline import Axis
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.base import corrections_key, mode_key, phases_key
from fdjax.pattern.chart_settings import ChartSettings, spline_of, twisted
from fdjax.pattern.isoline_pattern import IsolinePattern
from fdjax.pattern.straight import profiles
from fdjax.road.stacking import FAMILIES
from fdjax.target.target import Target


@dataclass(frozen=True)
class Isolines(ChartSettings):
    """Isolines of two splines over a part, for any outline and target.

    Lengths in mm. See the job's keys for what each value means.
    """

    mode: str = mode_key()
    phases: int = phases_key()
    corrections: int = corrections_key(3)
    enough: ClassVar[float] = 0.03

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> IsolinePattern:
        """Straight lines, those of xi across `angle`, as dense across as the target asks.

        Raises `InputError` for a target beyond what spacing and span allow, and for a region with
        no room for a road.
        """
        stacking = self.stacking(len(part.slabs))
        shares = stacking.layer_share(FAMILIES[0]), stacking.layer_share(FAMILIES[1])
        start = self.start(part, target, limits, window, lengths=(sum(shares), sum(shares)))
        least = limits.least_spacing or self.road_width
        x, y, _ = start.xyz.T
        first = _straight(
            start.axes,
            profiles(
                x, y, start.weight, start.demand, angle=np.radians(self.angle), shares=shares,
                bounds=(1 / start.reach, 1 / least),
            ),
            self.twist,
        )  # fmt: skip
        return IsolinePattern(**self.chart(start, *first), stacking=stacking)


def _straight(axes: tuple[Axis, Axis, Axis], both: Any, twist: float) -> list[np.ndarray]:
    """Coefficients (K, L, M) of straight lines, twisted (degrees), alike at all heights."""
    places = [np.linspace(axis.low, axis.high, 4 * axis.count) for axis in axes[:2]]
    x, y = np.meshgrid(*places, indexing="ij")
    x, y = twisted(x, y, np.radians(twist))
    return [spline_of(axes, places, each.count(x, y)) for each in both]
