"""What a user says of any drawing in a chart, and how it begins.

A drawing begins at the scale that the mean of the target asks for, undistorted but for a twist in
the middle, the more the target varies: twisted, it can crowd inside without crowding at the walls.
"""

from dataclasses import dataclass
from math import gcd
from typing import Any

import jax.numpy as jnp
import numpy as np

from fdjax.keys import FLAG, choice, key, number, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.base import corrections_key
from fdjax.pattern.chart_settings import ChartSettings, spline_of, twisted
from fdjax.pattern.depth import depths_of, free_spline, times_of, varies
from fdjax.pattern.drawn_pattern import Placing
from fdjax.target.target import Target

_PLAIN, _XI, _ETA, _BOTH = (False, False), (True, False), (False, True), (True, True)

MIRRORS = {
    "no": (_PLAIN,),
    "xi": (_PLAIN, _XI),
    "eta": (_PLAIN, _ETA),
    "both": (_PLAIN, _XI, _BOTH, _ETA),
}
"""Axes along which layers are mirrored, one after the other."""


@dataclass(frozen=True)
class DrawnSettings(ChartSettings):
    """Keys of the drawings. Lengths in mm."""

    angle: float = key(
        number(-360, 360), "degrees by which the drawing is turned, to begin with; rows that run "
        "along a wall would lie in the part or beyond it as a whole", default=15.0,
    )  # fmt: skip
    twist: float = key(
        number(-360, 360), "degrees by which the drawing is turned in the middle, to begin with "
        "where the target doubles, and less where it varies less", default=90.0,
    )  # fmt: skip
    phases: int = key(
        whole(1, 100), "layers over which the drawing is moved; 1 lays all alike", default=5
    )
    turned: bool = key(
        FLAG, "every second layer turns the drawing by a quarter, in its plane", default=False
    )
    mirrored: str = key(
        choice(*MIRRORS), "along which axis of its plane every second layer, every second pair of "
        "layers where it is turned, mirrors the drawing; both: along xi, both and eta, in turn",
        default="no",
    )  # fmt: skip
    corrections: int = corrections_key(2)
    mode = "both"

    def drawing(
        self,
        part: Part,
        target: Target,
        limits: Limits,
        window: float,
        *,
        directions: np.ndarray,
        gap: float,
        pore: float,
        depths: int | None = 0,
    ) -> dict[str, Any]:
        """The fields of a `DrawnPattern` that is turned by `angle` and as dense as the target asks
        in the mean; see there for what is given. `depths`: how often its steps may be halved; None
        for as often as the target asks.

        Raises `InputError` for a target beyond what gaps and pores allow, and for a region with no
        room for a road.
        """
        if self.mirrored != "no":
            # Along xi or along eta, and of both: an edge has no sense.
            directions = np.concatenate([directions, directions * [-1, 1]]) / 2
        if self.turned:
            directions = np.concatenate([directions, directions[:, ::-1] * [-1, 1]]) / 2
        density = float(np.hypot(*directions.T).sum())
        start = self.start(part, target, limits, window, lengths=(density * pore, density * gap))
        finest = 2.0 ** (depths_of(start) if depths is None else depths)
        more = times_of(start, finest) if finest > 1 else np.ones(1)
        scale = float(np.average(start.demand / more, weights=start.weight)) / density
        places = [np.linspace(axis.low, axis.high, 2 * axis.count) for axis in start.axes[:2]]
        x, y = np.meshgrid(*places, indexing="ij")
        times = free_spline(start, places, more, finest) if finest > 1 else None
        x, y = twisted(x, y, np.radians(self.twist * varies(start)))
        turn = scale * np.exp(1j * np.radians(self.angle))
        xi, eta = (
            spline_of(start.axes, places, each)
            for each in (turn.real * x + turn.imag * y, turn.real * y - turn.imag * x)
        )
        return {
            **self.chart(start, xi, eta, times=times, finest=finest),
            "directions": jnp.asarray(directions),
            "gap": gap,
            "pore": pore,
            "placing": _placing(self.phases, len(part.slabs), self.mirrored, turned=self.turned),
        }


def _placing(phases: int, layers: int, mirrored: str, *, turned: bool) -> tuple[Placing, ...]:
    """How the drawing lies on each layer.

    Phases by a rule of good lattice points: together they are about as even in both directions as
    those of lines are in one (Korobov 1959).
    """
    step = _jump(phases)
    mirrors = MIRRORS[mirrored]
    turns = (False, True) if turned else (False,)
    # Layers that lie on each other are divided as differently as may be.
    period = min(layers, phases * len(turns) * len(mirrors))
    jump = _jump(period)
    made = []
    for layer in range(layers):
        pair, turn = divmod(layer, len(turns))
        k, mirror = divmod(pair, len(mirrors))
        places = (k % phases + 0.5) / phases, (k * step % phases + 0.5) / phases
        finer = (layer * jump % period + 0.5) / period
        made.append(Placing(*places, turns[turn], finer, mirrors[mirror]))
    return tuple(made)


def _jump(count: int) -> int:
    """The number without common divisor with `count` nearest to .382 of it."""
    return min(
        (k for k in range(1, count + 1) if gcd(k, count) == 1), key=lambda k: abs(k - 0.382 * count)
    )
