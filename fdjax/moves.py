"""What a machine does for a line of its language, whatever the language."""

from typing import NamedTuple

Point = tuple[float, float, float]
Position = tuple[float | None, float | None, float | None, float | None]
"""x, y, z, e as a machine reports them, mm; None where it is not known."""


class Move(NamedTuple):
    """A straight motion of the head, or a wait where `seconds` is not 0.

    - `start`, `end`: on the bed, mm. `speed`: along the path, mm/s.
    - `volume`: deposited on the way, mm^3; negative where material is pulled back. Zero for travel.
    - `seconds`: of standing still.
    """

    start: Point
    end: Point
    speed: float
    volume: float = 0.0
    seconds: float = 0.0

    @property
    def length(self) -> float:
        """mm."""
        (a, b, c), (x, y, z) = self.start, self.end
        return ((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) ** 0.5
