"""Which cells of a base grid carry a finer one: as a user says it, or as the target asks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import Any

import jax.numpy as jnp
import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.keys import Kind, Place, pair, points, show, whole
from fdjax.limits import Limits
from fdjax.part.region import Region
from fdjax.pattern.embedded import MOST, Embedded, Zone
from fdjax.pattern.embedded_net import Axis
from fdjax.pattern.grid_lines import GridLines
from fdjax.pattern.zone_choice import Asked, State, lacking, state_of
from fdjax.programs import program
from fdjax.road.stacking import FAMILIES, Scan

Floats = NDArray[np.float64]
AUTO = "auto"


@dataclass(frozen=True)
class Wanted:
    """A zone as a user gives it: an outline, cells of the base, or neither where the target says.

    - `outline`: polygons, mm; `cells`: lines of xi and of eta that it lies between, see `EMBEDDED`.
    - `refine`: parts of each side of a cell.
    """

    refine: int
    outline: Any = None
    cells: tuple[tuple[int, int], tuple[int, int]] | None = None

    @property
    def asked(self) -> bool:
        """Whether the target says where it lies."""
        return self.outline is None and self.cells is None


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
    numbered = list(enumerate(wanted, 1))
    for asked, group in groupby(numbered, key=lambda each: each[1].asked):
        some = list(group)
        if asked:
            refine = [each.refine for _, each in some]
            shapes = lacking(pattern, target, Embedded(tuple(zones)), refine, limits)
        else:
            shapes = [_given(pattern, each, number) for number, each in some]
        for (number, each), shape in zip(some, shapes, strict=False):
            zones.append(_inside(shape, each.refine, number, outline, window))
            if Embedded(tuple(zones)).parts > MOST:
                raise InputError(
                    f"embedded: with region {number} base cells fall into more than {MOST} parts "
                    "each way; refine less"
                )
    if not zones:
        return pattern
    pattern = base(_shared(target, Embedded(tuple(zones)), pattern, limits))
    state = state_of(pattern)
    least = limits.least_spacing or pattern.width
    sized: list[Zone] = []
    for number, zone in enumerate(zones, 1):
        sized.append(_sized(zone, number, state, Embedded(tuple(sized)), outline, least))
    return replace(pattern, embedded=Embedded(tuple(sized)))


def _given(pattern: GridLines, wanted: Wanted, number: int) -> Any:
    return wanted.outline if wanted.cells is None else _between(pattern, wanted.cells, number)


def _inside(shape: Any, refine: int, number: int, outline: Any, window: float) -> Zone:
    """The zone that is left of a shape in the outline, before its cells are known."""
    inside = shapely.intersection(shape, outline)
    if not inside.area > 0:
        x, y = shapely.get_coordinates(shapely.point_on_surface(shape))[0]
        raise InputError(
            f"embedded: region {number}, at ({x:.4g}, {y:.4g}), lies outside the base grid"
        )
    return Zone.of(inside, refine, base=outline, fade=window, resolution=window / 16)


def _sized(
    zone: Zone, number: int, state: State, before: Embedded, outline: Any, least: float
) -> Zone:
    """The zone with the cells that it finds; raises `InputError` where they cannot be divided."""
    x, y = shapely.get_coordinates(shapely.point_on_surface(zone.outline))[0]
    inside = shapely.contains_xy(zone.outline, state.xy[..., 0], state.xy[..., 1])
    if not inside.any():
        far = np.hypot(state.xy[..., 0] - x, state.xy[..., 1] - y)
        inside = far == far.min()
    weight = (inside * state.area)[inside]
    spacing = [(each / before.times(state.xy))[inside] for each in state.spacing]
    side = float(np.average(np.sqrt(spacing[0] * spacing[1]), weights=weight))
    if zone.outline.area < side**2:
        raise InputError(
            f"embedded: region {number}, at ({x:.4g}, {y:.4g}), is smaller than a cell of the "
            f"base, whose sides there are about {side:.3g} mm; enlarge it or lay more lines"
        )
    narrow = min(float(np.average(each, weights=weight)) for each in spacing)
    if narrow < zone.refine * least:
        most = int(narrow / least)
        can = f"refine by {most} at most" if most > 1 else "leave it out"
        raise InputError(
            f"embedded: region {number}, at ({x:.4g}, {y:.4g}): lines {narrow:.3g} mm apart, "
            f"divided by {zone.refine}, come nearer than the least spacing, {least:g} mm; {can}, "
            "or lay fewer lines"
        )
    return replace(zone, fade=side, border=_border(zone.outline, outline, side))


def _border(zone: Any, outline: Any, side: float) -> shapely.MultiLineString:
    """Pieces of a zone's border at which lines end that do not run on to a wall."""
    walls = shapely.boundary(outline)
    reach = float(np.hypot(*np.subtract(zone.bounds[2:], zone.bounds[:2])))
    kept = []
    for ring in shapely.get_rings(shapely.get_parts(zone)):
        xy = shapely.get_coordinates(shapely.segmentize(ring, side))
        for a, b in pairwise(xy):
            middle, along = (a + b) / 2, (b - a) / np.hypot(*(b - a))
            # To the inner side, if need be the other one, and to the far end of the first piece.
            for across in (np.array([-along[1], along[0]]), np.array([along[1], -along[0]])):
                ray = shapely.LineString([middle + 1e-6 * side * across, middle + reach * across])
                first = shapely.get_parts(shapely.intersection(ray, zone))[0:1]
                if len(first) and first[0].distance(shapely.Point(middle)) < 1e-3 * side:
                    ends = [middle, shapely.get_coordinates(first[0])[-1]]
                    if shapely.distance(shapely.points(ends), walls).min() > side / 2:
                        kept.append([a, b])
                    break
    return shapely.MultiLineString(kept)


def _shared(target: Asked, embedded: Embedded, pattern: GridLines, limits: Limits) -> Asked:
    """The porosity that the base is to have so that the zones make of it what is asked."""
    state = state_of(pattern)
    # As sparse as roads may span.
    floor = np.min(state.solid * np.maximum(*state.spacing)) / limits.longest_span

    def asked(x: Any, y: Any) -> Any:
        solid = 1 - np.asarray(target(x, y))
        xy = np.stack(np.broadcast_arrays(x, y), -1)
        return 1 - np.maximum(solid / embedded.times(xy), np.minimum(solid, floor))

    return asked


def _between(
    pattern: GridLines, cells: tuple[tuple[int, int], tuple[int, int]], number: int
) -> Any:
    """The outline of cells between lines of a layer, counted from 1; 0 and one more are walls.

    Lines across a ring have no walls, and are counted on beyond the last.
    """
    ranges = []
    for family, (start, stop), comb in zip(FAMILIES, cells, pattern.comb, strict=True):
        closed = pattern.closed and family == "eta"
        axis = Axis.of(Scan(family, 0, pattern.stacking.phases), int(comb), closed=closed)
        edges = axis.edges(1)
        if closed:
            # From the first line on, and once more around.
            edges = np.concatenate([[np.nan], edges, edges[1:] + 1])
            fits = 0 < start <= axis.cells and start < stop <= start + axis.cells
            rule = f"begin at 1 to {axis.cells} and go on for a turn of {axis.cells} at most"
        else:
            fits = start < stop <= axis.cells
            rule = f"rise from 0 to {axis.cells}, the walls"
        if not fits:
            raise InputError(
                f"embedded: region {number} has cells from {family} line {start} to {stop}; they "
                f"{rule}"
            )
        ranges.append(edges[[start, stop]])
    run = np.linspace(0, 1, 65)
    (a, b), (c, d) = ranges
    u, v = a + (b - a) * run, c + (d - c) * run
    lower, upper = np.full(65, c), np.full(65, d)
    xi = np.concatenate([u, np.full(65, b), u[::-1], np.full(65, a)])
    eta = np.concatenate([lower, v, upper, v[::-1]])
    return shapely.make_valid(shapely.Polygon(np.asarray(_placed(pattern, xi, eta))))


@program
def _placed(pattern: GridLines, xi: Any, eta: Any) -> Any:
    grid, _, _ = pattern.shape(pattern.first)
    # Cells of a ring may go on beyond 1.
    return grid(jnp.asarray(xi), jnp.where(eta > 1, eta - jnp.floor(eta), eta))
