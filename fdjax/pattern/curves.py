"""Space-filling curves as roads: what a user says of them."""

from dataclasses import dataclass

import numpy as np

from fdjax.keys import FLAG, choice, key, number, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.base import corrections_key
from fdjax.pattern.curve_order import NAMES
from fdjax.pattern.curve_pattern import CurvePattern
from fdjax.pattern.drawn_settings import DrawnSettings
from fdjax.target.target import Target

_DIRECTIONS = np.array([(0.5, 0.0), (0.0, 0.5)])
"""Of the curve's steps, an area of one node: as many along xi as along eta, in the mean."""

_PORE = 2.0
"""Steps from one run of the curve to the next that bears a road, in the mean."""


@dataclass(frozen=True)
class Curves(DrawnSettings):
    """A space-filling curve over a part, for any outline and target.

    Lengths in mm. See the job's keys for what each value means.
    """

    curve: str = key(
        choice(*NAMES), "whose order the road goes by, round its squares", default="hilbert"
    )
    depths: int | None = key(
        whole(0, 4), "times that steps may be halved where the target is dense, on more layers the "
        "denser; 0 leaves it to the chart", default=None, shown="by target",
    )  # fmt: skip
    twist: float = key(
        number(-360, 360), "degrees by which the curve is turned in the middle, to begin with; its "
        "depth lets it crowd without", default=0.0,
    )  # fmt: skip
    turned: bool = key(
        FLAG, "every second layer turns the drawing by a quarter, in its plane", default=True
    )
    corrections: int = corrections_key(6)

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> CurvePattern:
        """The curve as `DrawnSettings.drawing` begins it, and raises."""
        fields = self.drawing(
            part,
            target,
            limits,
            window,
            directions=_DIRECTIONS,
            gap=1.0,
            pore=_PORE,
            depths=self.depths,
        )
        return CurvePattern(**fields, kind="curve", order=self.curve)
