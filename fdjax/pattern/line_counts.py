"""How many lines, how wide and how spaced to begin with: what the target asks, strip by strip.

All outside the gradient loop. Every line of constant eta crosses every strip of constant xi, so
what the eta lines bring to a strip is known from their number alone; what is missing the xi lines
must bring there, and the other way round.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fdjax.grid.algebraic import Transfinite
from fdjax.grid.base import Sides, Tangents, norm, tangents
from fdjax.limits import Limits
from fdjax.pattern.reach import check_reachable
from fdjax.programs import program
from fdjax.road.bead import road_width, section_area
from fdjax.road.porosity import midpoints
from fdjax.road.stacking import FAMILIES, Stacking

Floats = NDArray[np.float64]
T = TypeVar("T")

_STRIPS = 64


@dataclass(frozen=True, eq=False)
class Start:
    """Where a design begins.

    - `comb`: lines of each family in all phases together (xi, eta).
    - `width`: road width, mm.
    - `density`: of lines along the sides of their family, relative, at `_STRIPS` + 1 equally
      spaced places: for xi lines along bottom and top, for eta lines along left and right.
    """

    comb: tuple[int, int]
    width: float
    density: tuple[Floats, Floats]


@dataclass(frozen=True, eq=False)
class _Strips:
    """The layer in strips of constant xi (axis 0 of the lattice) and of constant eta.

    - `demand`: centre line per area asked for on the mean layer, less what the turn-arounds at
      its own walls bring, (strips,), 1/mm, both ways.
    - `crossing`: what one line of the other family, on every layer, would bring, 1/mm.
    - `across`: mean distance from the first strip's outer edge to the last one's, mm.
    """

    demand: tuple[Floats, Floats]
    crossing: tuple[Floats, Floats]
    across: tuple[float, float]

    def wanted(self, k: int, other: float, shares: tuple[float, ...], most: float) -> Floats:
        """Lines a mm that family k is to bring to its strips beside `other` lines of the other.

        `most`: lines a mm that those do not exceed.
        """
        brought = shares[1 - k] * np.minimum(other * self.crossing[k], most)
        return (self.demand[k] - brought) / shares[k]


@program
def _lattice(sides: Sides) -> tuple[Any, Tangents]:
    places = jnp.asarray(midpoints(_STRIPS))
    return tangents(Transfinite(sides), places[:, None], places[None])


def begin(
    sides: Sides,
    target: Any,
    *,
    height: float,
    width: float | None,
    stacking: Stacking,
    limits: Limits,
    lines: tuple[int, int] | None = None,
    window: float,
    play: float = 0.15,
    densest: float = np.inf,
) -> Start:
    """Line counts, road width and first spacings for a porosity `target(x, y)`.

    Turn-arounds are taken as spread over half a `window` (mm) from their wall.
    `play`: share of its mean that a family keeps everywhere; the more, the more freely both can
    crowd from place to place. `densest`: lines a mm that eta lines do not exceed, since some end.
    `width` and `lines` (a layer's, of each family) are kept where given. Otherwise the counts
    follow from the mean that the target asks, with cells as square as the least spacing and
    the longest span leave room for. Raises `InputError` when no count and width of
    the machine can give a porosity that the target asks for.
    """
    xy, along = jax.device_get(_lattice(sides))
    jacobian = along.jacobian
    solid = 1 - np.asarray(target(xy[..., 0], xy[..., 1]))
    shares = tuple(stacking.layer_share(family) for family in FAMILIES)
    length = np.asarray(norm(along.eta)), np.asarray(norm(along.xi))
    mean_solid = float((solid * jacobian).sum() / jacobian.sum())
    if width is None:
        width = _fitting_width(mean_solid, length, jacobian, lines, shares, height, limits)
    area = float(section_area(width, height))
    points = np.concatenate([xy, np.zeros_like(xy[..., :1])], -1).reshape(-1, 3)
    check_reachable(
        solid.ravel(), points, height=height, lengths=(sum(shares), sum(shares)),
        widths=(width, width), limits=limits,
    )  # fmt: skip
    asked = solid * height / area * jacobian
    strips = _Strips(
        _both(
            lambda k: (
                (asked.sum(1 - k) - _turnarounds(length[k], jacobian, k, shares[1 - k], window / 2))
                / jacobian.sum(1 - k)
            )
        ),
        _both(lambda k: length[1 - k].sum(1 - k) / jacobian.sum(1 - k)),
        _both(lambda k: float(jacobian.sum() / length[k].sum())),
    )
    least = limits.least_spacing or width
    span = limits.longest_span
    most = densest, np.inf
    counts = lines or _counts(strips, shares, least, span, play, most)
    density = _both(
        lambda k: np.clip(
            strips.wanted(k, counts[1 - k], shares, most[k]),
            max(1 / span, 0.2 * counts[k] / strips.across[k]),
            1 / least,
        )
    )
    places = np.linspace(0, 1, _STRIPS + 1)
    return Start(
        _both(lambda k: max(1, round(counts[k] * stacking.phases))),
        width,
        _both(lambda k: np.interp(places, midpoints(_STRIPS), density[k])),
    )


def _both(each: Callable[[int], T]) -> tuple[T, T]:
    """`each` of the xi family, number 0, and of the eta family, number 1."""
    return each(0), each(1)


def _turnarounds(length: Floats, jacobian: Floats, axis: int, share: float, reach: float) -> Floats:
    """Centre line of the turn-arounds at both ends of the strips, spread over `reach` from there.

    Half of each wall is covered on layers that turn there. In the lattice's units, (strips,).
    """
    area, along = jacobian.sum(1 - axis), length.sum(1 - axis)
    result = np.zeros(_STRIPS)
    for ends in (np.arange(_STRIPS), np.arange(_STRIPS)[::-1]):
        depth = np.cumsum((area / along)[ends]) / _STRIPS
        near = ends[: max(1, int(np.searchsorted(depth, reach)))]
        result[near] += share / 2 * along[ends[0]] * _STRIPS / len(near)
    return result


def _counts(
    strips: _Strips,
    shares: tuple[float, ...],
    least: float,
    span: float,
    play: float,
    most: tuple[float, float],
) -> tuple[float, float]:
    """Lines a layer of each family: the mean demand, cells near square, room for both families."""
    mean = [float(d.mean()) for d in strips.demand]
    square = [max(strips.across[k] * mean[k] / sum(shares), 1.0) for k in (0, 1)]
    best, choice = np.inf, (square[0], square[1])
    for tilt in np.linspace(-1.5, 1.5, 121):
        # Moves lines from one family to the other at constant mean density.
        eta = square[1] * np.exp(tilt)
        xi = (mean[0] - shares[1] * eta / strips.across[1]) * strips.across[0] / shares[0]
        if xi < 1:
            continue
        cost = 0.02 * tilt**2
        for k, other in ((0, eta), (1, xi)):
            own = strips.wanted(k, other, shares, most[k])
            # Room at both ends: these are means of strips, and the design needs some play.
            floor = max(1.2 / span, play * own.mean(), 1 / strips.across[k])
            cost += max(1 - own.min() / floor, 0) ** 2 + 4 * max(own.max() * least - 0.97, 0) ** 2
        if cost < best:
            best, choice = cost, (float(xi), float(eta))
    return choice


def _fitting_width(
    mean_solid: float,
    length: tuple[Floats, Floats],
    jacobian: Floats,
    lines: tuple[int, int] | None,
    shares: tuple[float, ...],
    height: float,
    limits: Limits,
) -> float:
    """The width that gives these lines the mean asked for, else the middle of the range."""
    low, high = limits.road_width
    if lines is None:
        return float(np.sqrt(low * high))
    per_area = sum(
        share * n * float(each.sum() / jacobian.sum())
        for share, n, each in zip(shares, lines, length, strict=True)
    )
    return float(np.clip(road_width(mean_solid * height / per_area, height), low, high))
