"""Which cells of a base grid to divide: those where it lacks most beside the target."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
import shapely
from contourpy import FillType, contour_generator
from numpy.typing import NDArray

from fdjax.grid.base import norm
from fdjax.limits import Limits
from fdjax.pattern.embedded import Embedded
from fdjax.pattern.grid_lines import GridLines
from fdjax.programs import program
from fdjax.road.stacking import FAMILIES

Floats = NDArray[np.float64]
Asked = Callable[[Any, Any], Any]

WORTH = 0.85
"""Zones are chosen where that brings the error that is left to this share of what it was."""

FINE = 0.004
"""RMS error of the solid share, cell by cell, with which a base needs no zones."""

SLACK = 0.1
"""Share of the gain that zones may forgo to be smaller."""

_LEVELS = np.linspace(0, 0.9, 13)
"""Quantiles of the target: solid shares of an even base from which zones are looked for."""

_ROUNDS = 6
_SWEEPS = 4
"""How often zones and base, and lines along xi and along eta, are fitted in turn."""

_SPARSEST = 0.25
"""Lines become no sparser than this share of what they are without zones."""


class State(NamedTuple):
    """A pattern without zones where design looks, inside: places, areas, solid share, the spacing
    of its two families, mm, and what each brings to the solid share, to a common factor.
    """

    xy: Floats
    area: Floats
    solid: Floats
    spacing: tuple[Floats, Floats]
    brought: tuple[Floats, Floats]


def state_of(pattern: GridLines) -> State:
    xy, area, solid, xi, eta = map(np.asarray, _looked(pattern))
    of_xi, of_eta = (pattern.stacking.layer_share(family) for family in FAMILIES)
    return State(xy, area, solid, (xi, eta), (of_xi / xi, of_eta / eta))


@program
def _looked(pattern: GridLines) -> tuple[Any, ...]:
    realised = pattern.realise(pattern.first)
    _, porosity, volume = pattern.cells(realised)
    xy, along = realised.lattice.xy[1:-1, 1:-1], realised.lattice.along
    shape = xy.shape[:2]
    lines = pattern.lines_per_layer
    jacobian = along.jacobian
    spacing = [jacobian / (n * norm(t)) for n, t in zip(lines, (along.eta, along.xi), strict=True)]
    inner = (each[1:-1, 1:-1] for each in spacing)
    return xy, volume.reshape(shape), 1 - porosity.reshape(shape), *inner


def lacking(
    pattern: GridLines, target: Asked, embedded: Embedded, refine: Sequence[int], limits: Limits
) -> list[Any]:
    """Where lines of the base lack most beside the target: outlines, mm, each within the last.

    - `embedded`: zones there already; `refine`: parts of cells in each zone that is looked for.

    Those cells are divided with which the base, its lines as dense along xi and along eta as is
    best then, comes nearest to the target over the part; as few times as are worth it.
    """
    state = state_of(pattern)
    asked = 1 - np.asarray(target(state.xy[..., 0], state.xy[..., 1]))
    times = embedded.times(state.xy)
    most = np.minimum(*state.spacing) / (limits.least_spacing or pattern.width) * state.solid
    fit = _Fit(state, asked, evenly=jax.tree.leaves(pattern.first) == [])
    error, base = fit.base(times)
    finer, depth = np.ones_like(times), 0
    for count in range(1, len(refine) + 1):
        if error < FINE:
            break
        found = _divided(fit, times, np.cumprod([1, *refine[:count]]), most)
        if found[0] <= WORTH * error:
            error, finer, base = found
            depth = count
    cell = np.sqrt(np.prod(state.spacing, axis=0)) * state.solid / (base * times)
    shapes = []
    for factor in np.cumprod(refine[:depth]):
        inside = finer >= factor
        side = float(np.average(cell[inside])) / (factor / refine[len(shapes)])
        # No necks or bits of less than two cells.
        shape = _outlined(state.xy, inside)
        for by in (side, -2 * side, side):
            shape = shape.buffer(by, join_style="mitre")
        if not shape.area > 0:
            break
        shapes.append(shape)
    return shapes


def _divided(
    fit: "_Fit", times: Floats, factors: NDArray[np.intp], most: Floats
) -> tuple[float, Floats, Floats]:
    """The error left, which of these factors divides each cell, and the base's solid share.

    - `most`: that the base could have, lines as near as they may be.
    """
    found: list[tuple[float, float, Floats, Floats]] = []
    for level in np.quantile(fit.asked, _LEVELS):
        base = np.full_like(times, level)
        for _ in range(_ROUNDS):
            made = factors[:, None, None] * (times * base)
            off = np.where(made <= most, np.abs(fit.asked - made), np.inf)
            off[0] = np.abs(fit.asked - made[0])
            finer = factors[np.argmin(off, 0)].astype(float)
            error, base = fit.base(finer * times)
            found.append((error, float((fit.state.area * np.log(finer)).sum()), finer, base))
    left, plain = min(each[0] for each in found), fit.base(times)[0]
    # Of those about as good, the smallest.
    good = [each for each in found if each[0] <= left + SLACK * (plain - left)]
    error, _, finer, base = min(good, key=lambda each: each[1])
    return error, finer, base


@dataclass(frozen=True, eq=False)
class _Fit:
    """How near a base comes to a target, cell by cell, with lines of any density along each axis.

    - `asked`: solid share, of the cells of the state.
    - `evenly`: whether all lines only change their density alike.
    """

    state: State
    asked: Floats
    evenly: bool

    def base(self, times: Floats) -> tuple[float, Floats]:
        """RMS error, and the base's solid share where there are `times` as many lines."""
        weight = self.state.area / self.state.area.sum()
        own = [self.state.solid * each for each in self._shares]
        factors = [np.ones((len(weight), 1)), np.ones((1, weight.shape[1]))]
        if self.evenly:
            whole = times * self.state.solid
            scale = (weight * whole * self.asked).sum() / (weight * whole**2).sum()
            base = scale * self.state.solid
        else:
            for _ in range(_SWEEPS):
                for k in (0, 1):
                    mine, rest = times * own[k], times * own[1 - k] * factors[1 - k]
                    top = (weight * mine * (self.asked - rest)).sum(1 - k, keepdims=True)
                    bottom = (weight * mine**2).sum(1 - k, keepdims=True)
                    factors[k] = np.maximum(top / bottom, _SPARSEST)
            base = own[0] * factors[0] + own[1] * factors[1]
        return float(np.sqrt((weight * (times * base - self.asked) ** 2).sum())), base

    @property
    def _shares(self) -> tuple[Floats, Floats]:
        """Of the base's solid share, what lines of xi and what lines of eta bring."""
        xi, eta = self.state.brought
        return xi / (xi + eta), eta / (xi + eta)


def _outlined(xy: Floats, inside: NDArray[np.bool_]) -> Any:
    """Polygons around places of a lattice (n, m, 2)."""
    n, m = inside.shape
    values = np.pad(inside.astype(float), 1)
    rows = contour_generator(
        np.arange(-1, m + 1), np.arange(-1, n + 1), values, fill_type=FillType.OuterOffset
    )
    polygons = []
    for points_, offsets in zip(*rows.filled(0.5, 2.0), strict=True):
        loops = [_at(xy, loop) for loop in np.split(points_, offsets[1:-1])]
        polygons.append(shapely.make_valid(shapely.Polygon(loops[0], loops[1:])))
    return shapely.union_all(polygons)


def _at(xy: Floats, loop: Floats) -> Floats:
    """Places of a lattice at fractional indices (second, first), beyond its rim on from it."""
    n, m = xy.shape[:2]
    j, i = loop.T
    a, b = np.clip(np.floor(i), 0, n - 2).astype(int), np.clip(np.floor(j), 0, m - 2).astype(int)
    s, t = (i - a)[:, None], (j - b)[:, None]
    low = (1 - s) * xy[a, b] + s * xy[a + 1, b]
    return (1 - t) * low + t * ((1 - s) * xy[a, b + 1] + s * xy[a + 1, b + 1])
