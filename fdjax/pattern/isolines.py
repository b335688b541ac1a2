"""Isolines as roads: what a user says of them, and how they begin.

Straight lines, as dense across as the target asks, twisted about the middle: how many lines end a
mm of wall follows from their number alone, but lines that run obliquely inside are dense there.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fdjax.errors import InputError
from fdjax.field.spline import Axis
from fdjax.keys import key, number
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.base import mode_key, phases_key
from fdjax.pattern.chart_settings import ChartSettings, spline_of
from fdjax.pattern.isoline_pattern import IsolinePattern
from fdjax.pattern.straight import profiles
from fdjax.road.stacking import FAMILIES
from fdjax.target.target import Target


@dataclass(frozen=True)
class Isolines(ChartSettings):
    """Isolines of two splines over a part, for any outline and target.

    Lengths in mm. See the job's keys for what each value means.
    """

    twist: float = key(
        number(-360, 360), "degrees by which the lines are turned in the middle, to begin with; "
        "twisted lines can crowd inside without crowding at the walls", default=90.0,
    )  # fmt: skip
    mode: str = mode_key()
    phases: int = phases_key()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.isfinite(self.twist):
            raise InputError(f"twist: {self.twist} is not finite")

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
    x, y = _twisted(x, y, np.radians(twist))
    return [spline_of(axes, places, each.count(x, y)) for each in both]


def _twisted(x: np.ndarray, y: np.ndarray, twist: float) -> tuple[np.ndarray, np.ndarray]:
    """Places on a lattice turned about its middle, by `twist` radians there and less outwards."""
    middle_x, middle_y = (x[0, 0] + x[-1, -1]) / 2, (y[0, 0] + y[-1, -1]) / 2
    reach = max(np.ptp(x), np.ptp(y)) / 4
    right, up = x - middle_x, y - middle_y
    turn = twist * np.exp(-(right**2 + up**2) / reach**2)
    cosine, sine = np.cos(turn), np.sin(turn)
    return middle_x + cosine * right - sine * up, middle_y + sine * right + cosine * up
