"""Whether a porosity can be had at all from roads between a least spacing and a longest span."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.limits import Limits
from fdjax.road.bead import section_area

Floats = NDArray[np.float64]


def check_reachable(
    solid: Floats,
    xyz: Floats,
    *,
    height: float,
    lengths: tuple[float, float],
    widths: tuple[float, float],
    limits: Limits,
) -> None:
    """Raise `InputError`, with the place, where the solid share asked is beyond what roads give.

    - `solid`: asked at the points `xyz` (n, 3), mm.
    - `lengths`: of centre line an area, where roads span the longest way times that span, and where
      they are closest times their spacing: for lines both are the sum of the families' shares of
      the layers. `widths`: least and largest, mm.
    """
    narrow, wide = widths
    sparse, dense = lengths
    highest = float(section_area(wide, height)) / height * dense / (limits.least_spacing or wide)
    lowest = float(section_area(narrow, height)) / height * sparse / limits.longest_span
    for at in (int(np.argmax(solid)), int(np.argmin(solid))):
        value = float(solid[at])
        if not lowest <= value <= highest:
            least = limits.least_spacing or wide
            step = least * highest / value if value > 0 else np.inf
            close = f" ({step:.3g} mm apart is less than {least:.3g})" if step < least else ""
            raise InputError(
                f"target: porosity {1 - value:.3f} is asked at {_place(xyz[at])}, but roads "
                f"{_range(widths)} mm wide can give {1 - highest:.3f} to {1 - lowest:.3f} on this "
                f"machine{close}; change the target, the road width or the layer height"
            )


def _place(xyz: Any) -> str:
    return f"({xyz[0]:.4g}, {xyz[1]:.4g}, {xyz[2]:.4g}) mm"


def _range(widths: tuple[float, float]) -> str:
    low, high = widths
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
