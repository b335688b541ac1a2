"""What a machine can lay, as plain numbers. Loads no array library."""

import math
from dataclasses import dataclass

from fdjax.errors import InputError

_ANY = (0.0, math.inf)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a machine, mm; each is open unless given.

    - `road_width`, `layer_height`: least and largest.
    - `least_spacing`: between centre lines of one family; None: the roads' own width, so that
      they do not overlap.
    - `longest_span`: of a road over nothing.
    - `least_road`: length from flow on to flow off.
    - `bed`: room along x, y and z; `bed_origin`: machine coordinates of its front left corner.

    Raises `InputError` for a limit that is not positive or a range that is empty.
    """

    road_width: tuple[float, float] = _ANY
    layer_height: tuple[float, float] = _ANY
    least_spacing: float | None = None
    longest_span: float = math.inf
    least_road: float = 0.0
    bed: tuple[float, float, float] = (math.inf, math.inf, math.inf)
    bed_origin: tuple[float, ...] = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("road_width", "layer_height"):
            low, high = getattr(self, name)
            if not (0 <= low <= high and high > 0):
                raise InputError(f"{name}: from {low:g} to {high:g} mm is no range")
        if not all(size > 0 for size in self.bed):
            raise InputError(f"bed: {self.bed} mm; all three must be positive")
        if not self.longest_span > 0:
            raise InputError(f"longest_span: {self.longest_span:g} mm; it must be positive")
        for name in ("least_road", "least_spacing"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < math.inf:
                raise InputError(f"{name}: {value:g} mm; it must be finite and not negative")
