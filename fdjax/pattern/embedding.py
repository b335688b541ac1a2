"""Which cells of a base grid carry a finer one: as a user says it, or as the target asks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import shapely
from contourpy import FillType, contour_generator
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.grid.base import norm
from fdjax.keys import Kind, Place, pair, points, show, whole
from fdjax.limits import Limits
from fdjax.part.region import Region
from fdjax.pattern.embedded import MOST, Embedded, Zone
from fdjax.pattern.embedded_lines import Axis
from fdjax.pattern.grid_lines import GridLines
from fdjax.road.stacking import FAMILIES, Scan

Floats = NDArray[np.float64]
Asked = Callable[[Any, Any], Any]

AUTO = "auto"

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


@dataclass(frozen=True)
class Wanted:
    """A zone as a user gives it: an outline, cells of the base, or neither where the target says.

    - `outline`: polygons, mm; `cells`: lines of xi and of eta that it lies between, see `EMBEDDED`.
    - `refine`: parts of each side of a cell.
    """

    refine: int
    outline: Any = None
    cells: tuple[tuple[int, int], tuple[int, int]] | None = None


def _embedded(value: Any, place: Place) -> tuple[Wanted, ...]:
    if value == AUTO:
        return Wanted(2), Wanted(2)
    if not isinstance(value, list):
        raise place.error(f'{show(value)} is neither "auto" nor a list of zones in [ ]')
    return tuple(_zone(each, place.at(f"[{k}]")) for k, each in enumerate(value))


def _zone(value: Any, place: Place) -> Wanted:
    known = {"region", "points", "cells", "refine"}
    if not isinstance(value, dict) or set(value) - known:
        raise place.error(f"{show(value)} is no zone; write {{region = ..., refine = 2}}")
    refine = whole(2, 8).read(value.get("refine", 2), place.at(".refine"))
    where = [name for name in ("region", "points", "cells") if name in value]
    if len(where) != 1:
        raise place.error("needs one of region, points and cells")
    (name,) = where
    given, place = value[name], place.at(f".{name}")
    if name == "cells":
        return Wanted(refine, cells=pair(pair(whole(0, 10000))).read(given, place))
    if given == AUTO:
        return Wanted(refine)
    if name == "points":
        given = points(3).read(given, place)
    elif not isinstance(given, str) or not given.strip():
        raise place.error(f'{show(given)} must be "auto", a polygon as text, or its file')
    elif not set(given) & set("({"):
        given = place.folder / given
    unit = "mm" if name == "points" else place.unit
    try:
        return Wanted(refine, Region.of(given, unit=unit).geometry)
    except InputError as error:
        raise place.error(error) from None


EMBEDDED = Kind(
    '`"auto"`, or list of `{region = polygon as WKT, GeoJSON or file, or "auto", refine = parts}`, '
    "or with `points` or `cells = [[from, to], [from, to]]`, lines of xi and of eta, for a region",
    _embedded,
)


def embed(
    wanted: Sequence[Wanted],
    base: Callable[[Asked], GridLines],
    target: Asked,
    outline: Any,
    limits: Limits,
    window: float,
) -> GridLines:
    """The pattern with these zones, its base such that both together are what the target asks.

    - `base`: makes the pattern without zones for a porosity; `outline`: of the layer, mm.

    Raises `InputError` for zones outside the outline, smaller than a cell, or so fine that roads
    would come nearer than the machine lays them.
    """
    pattern = base(target)
    zones: list[Zone] = []
    for number, each in enumerate(wanted, 1):
        shape = each.outline
        if each.cells is not None:
            shape = _between(pattern, each.cells, number)
        elif shape is None:
            shape = _lacking(pattern, target, Embedded(tuple(zones)), each.refine, limits)
            if shape is None:
                continue
        inside = shapely.intersection(shape, outline)
        if not inside.area > 0:
            x, y = shapely.get_coordinates(shapely.point_on_surface(shape))[0]
            raise InputError(
                f"embedded: region {number}, at ({x:.4g}, {y:.4g}), lies outside the base grid"
            )
        made = Zone.of(
            inside, each.refine, fade=window, bounds=outline.bounds, resolution=window / 16
        )
        zones.append(made)
        if Embedded(tuple(zones)).parts > MOST:
            raise InputError(
                f"embedded: with region {number} base cells fall into more than {MOST} parts each "
                "way; refine less"
            )
    if not zones:
        return pattern
    embedded = Embedded(tuple(zones))
    pattern = base(_shared(target, embedded, pattern, limits))
    state = _state(pattern)
    sized = []
    for number, zone in enumerate(zones, 1):
        side = _side(state, zone, Embedded(tuple(sized)))
        if zone.outline.area < side**2:
            x, y = shapely.get_coordinates(shapely.point_on_surface(zone.outline))[0]
            raise InputError(
                f"embedded: region {number}, at ({x:.4g}, {y:.4g}), is smaller than a cell of the "
                f"base, whose sides there are about {side:.3g} mm; enlarge it or lay more lines"
            )
        sized.append(replace(zone, fade=side))
    return replace(pattern, embedded=Embedded(tuple(sized)))


class _State(NamedTuple):
    """A pattern without zones where design looks, inside: places, areas, solid share, the spacing
    of its two families, mm, and what each brings to the solid share, to a common factor.
    """

    xy: Floats
    area: Floats
    solid: Floats
    spacing: tuple[Floats, Floats]
    brought: tuple[Floats, Floats]


def _state(pattern: GridLines) -> _State:
    xy, area, solid, xi, eta = map(np.asarray, _looked(pattern))
    of_xi, of_eta = (pattern.stacking.layer_share(family) for family in FAMILIES)
    return _State(xy, area, solid, (xi, eta), (of_xi / xi, of_eta / eta))


@eqx.filter_jit
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


def _side(state: _State, zone: Zone, before: Embedded) -> float:
    """Mean side of the cells that a zone divides, mm."""
    inside = shapely.contains_xy(zone.outline, state.xy[..., 0], state.xy[..., 1])
    at = shapely.point_on_surface(zone.outline)
    if not inside.any():
        near = np.hypot(state.xy[..., 0] - at.x, state.xy[..., 1] - at.y)
        inside = near == near.min()
    side = np.sqrt(state.spacing[0] * state.spacing[1]) / before.times(state.xy)
    return float(np.average(side[inside], weights=state.area[inside]))


def _shared(target: Asked, embedded: Embedded, pattern: GridLines, limits: Limits) -> Asked:
    """The porosity that the base is to have so that the zones make of it what is asked."""
    state = _state(pattern)
    # As sparse as roads may span.
    floor = np.min(state.solid * np.maximum(*state.spacing)) / limits.longest_span

    def asked(x: Any, y: Any) -> Any:
        solid = 1 - np.asarray(target(x, y))
        xy = np.stack(np.broadcast_arrays(x, y), -1)
        return 1 - np.maximum(solid / embedded.times(xy), np.minimum(solid, floor))

    return asked


def _between(
    pattern: GridLines, cells: tuple[tuple[int, int], tuple[int, int]], number: int
) -> shapely.Polygon:
    """The outline of cells between lines of a layer, counted from 1; 0 and one more are walls."""
    ranges = []
    for family, (start, stop), comb in zip(FAMILIES, cells, pattern.comb, strict=True):
        axis = Axis.of(Scan(family, 0, pattern.stacking.phases), int(comb))
        if not start < stop <= axis.cells:
            raise InputError(
                f"embedded: region {number} has cells from {family} line {start} to {stop}; they "
                f"rise from 0 to {axis.cells}, the walls"
            )
        ranges.append(axis.edges(1)[[start, stop]])
    run = np.linspace(0, 1, 65)
    (a, b), (c, d) = ranges
    u, v = a + (b - a) * run, c + (d - c) * run
    lower, upper = np.full(65, c), np.full(65, d)
    xi = np.concatenate([u, np.full(65, b), u[::-1], np.full(65, a)])
    eta = np.concatenate([lower, v, upper, v[::-1]])
    return shapely.make_valid(shapely.Polygon(np.asarray(_placed(pattern, xi, eta))))


@eqx.filter_jit
def _placed(pattern: GridLines, xi: Any, eta: Any) -> Any:
    grid, _, _ = pattern.shape(pattern.first)
    return grid(jnp.asarray(xi), jnp.asarray(eta))


def _lacking(
    pattern: GridLines, target: Asked, embedded: Embedded, refine: int, limits: Limits
) -> Any:
    """Where lines of the base lack most beside the target, mm; None if nowhere.

    Those cells are divided with which the base, its lines as dense along xi and along eta as is
    best then, comes nearest to the target over the part.
    """
    state = _state(pattern)
    asked = 1 - np.asarray(target(state.xy[..., 0], state.xy[..., 1]))
    times = embedded.times(state.xy)
    least = limits.least_spacing or pattern.width
    room = np.minimum(*state.spacing) / least
    fit = _Fit(state, asked, evenly=jax.tree.leaves(pattern.first) == [])
    plain, _ = fit.base(times)
    found = []
    for level in np.quantile(asked, _LEVELS):
        base = np.full_like(asked, level)
        for _ in range(_ROUNDS):
            more = np.abs(asked - refine * times * base) < np.abs(asked - times * base)
            more &= refine * times * base <= room * state.solid
            error, base = fit.base(np.where(more, refine * times, times))
            found.append((error, float(state.area[more].sum()), more, base))
    left = min(each[0] for each in found)
    if plain < FINE or left > WORTH * plain:
        return None
    # Of those about as good, the smallest.
    good = [each for each in found if each[0] <= left + SLACK * (plain - left)]
    _, _, finer, best = min(good, key=lambda each: each[1])
    share = state.solid / best
    cell = np.sqrt(np.prod(state.spacing, axis=0)) * share / times
    side = float(np.average(cell[finer]))
    # No necks or bits of less than two cells.
    shape = _outlined(state.xy, finer)
    for by in (side, -2 * side, side):
        shape = shape.buffer(by, join_style="mitre")
    return shape if shape.area > 0 else None


@dataclass(frozen=True, eq=False)
class _Fit:
    """How near a base comes to a target, cell by cell, with lines of any density along each axis.

    - `asked`: solid share, of the cells of the state.
    - `evenly`: whether all lines only change their density alike.
    """

    state: _State
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
