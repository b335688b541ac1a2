"""Straight lines to begin with: two families, each as dense across as the target asks there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_STRIPS = 24


@dataclass(frozen=True, eq=False)
class Profile:
    """Density of straight lines across their direction.

    - `normal`: unit vector across the lines, shape (2,).
    - `edges`: of strips, measured along it, shape (n + 1,), mm; `density`: lines a mm, (n,).
    """

    normal: Floats
    edges: Floats
    density: Floats

    def count(self, x: Floats, y: Floats) -> Floats:
        """Number of lines passed on the way to (x, y), from the first strip's edge on."""
        at = x * self.normal[0] + y * self.normal[1]
        passed = np.concatenate([[0.0], np.cumsum(self.density * np.diff(self.edges))])
        beyond_low = np.minimum(at - self.edges[0], 0.0) * self.density[0]
        beyond_high = np.maximum(at - self.edges[-1], 0.0) * self.density[-1]
        return np.interp(at, self.edges, passed) + beyond_low + beyond_high


def profiles(
    x: Floats,
    y: Floats,
    weight: Floats,
    demand: Floats,
    *,
    angle: float,
    shares: tuple[float, float],
    bounds: tuple[float, float],
) -> tuple[Profile, Profile]:
    """Two families of straight lines whose summed density comes near `demand`.

    - `x`, `y`, `weight`, `demand`: of places in the layer, shape (n,): mm, any unit, and centre
      line an area asked on the mean layer, 1/mm.
    - `angle`: from the x axis to the direction across the first family, radians.
    - `shares`: of the layers that hold each family.
    - `bounds`: least and largest density of a family on a layer, 1/mm.

    Strip by strip each family gets what the mean of the strip asks beyond what the other brings;
    how much the other brings in the mean is chosen so that both keep within bounds with room.
    """
    mean = float(np.average(demand, weights=weight))
    low, high = bounds
    strips = []
    for turn in (angle, angle + np.pi / 2):
        normal = np.array([np.cos(turn), np.sin(turn)])
        at = x * normal[0] + y * normal[1]
        edges = np.linspace(at.min(), at.max() + 1e-9, _STRIPS + 1)
        strip = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, _STRIPS - 1)
        area = np.bincount(strip, weight, _STRIPS)
        asked = np.bincount(strip, weight * demand, _STRIPS)
        middle = (edges[1:] + edges[:-1]) / 2
        filled = area > 0
        strips.append((
            normal, edges, np.interp(middle, middle[filled], asked[filled] / area[filled]),
            area / area.sum(),
        ))  # fmt: skip

    def density(family: int, own: float) -> Floats:
        asked = strips[family][2]
        return (asked - (1 - own) * mean) / (shares[family] or 1.0)

    def cost(first: float) -> float:
        total = 0.02 * float(np.log(first / (1 - first))) ** 2
        for family, own in ((0, first), (1, 1 - first)):
            found, area = density(family, own), strips[family][3]
            # Room on both sides: these are means of strips, and the design needs some play.
            total += 3 * float((area * np.maximum(1 - found / (2 * low), 0) ** 2).sum())
            total += 10 * float((area * np.maximum(found / (0.9 * high) - 1, 0) ** 2).sum())
        return total

    # Of one layer the first family is all there is.
    first = min(np.linspace(0.1, 0.9, 81), key=cost) if shares[1] > 0 else 1.0
    made = []
    for family, own in ((0, first), (1, 1 - first)):
        smooth = np.convolve(np.pad(density(family, own), 1, mode="edge"), np.ones(3) / 3, "valid")
        kept = np.clip(smooth, min(1.5 * low, high), max(0.9 * high, low))
        made.append(Profile(strips[family][0], strips[family][1], kept))
    return made[0], made[1]
