"""From a pattern's strokes to a build: cut, joined, laid layer on layer."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fdjax.beside import Beside
from fdjax.errors import InputError
from fdjax.part.part import Part, Slab
from fdjax.part.region import Region
from fdjax.plan.counted import total
from fdjax.plan.drawing import lay_drawing
from fdjax.plan.laid import Laid
from fdjax.plan.lines import lay_lines
from fdjax.plan.paths import lay_paths
from fdjax.plan.polygons import lay_polygons
from fdjax.plan.rings import lay_rings
from fdjax.plan.room import Room
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.plan.tour import lay_curve
from fdjax.plan.trail import lay_graph
from fdjax.road.bead import road_width
from fdjax.road.stroke import Curve, Drawing, Graph, Lines, Paths, Polygons, Rings, Subdomain

LAYING: dict[type, Callable[..., Laid]] = {
    Lines: lay_lines,
    Graph: lay_graph,
    Drawing: lay_drawing,
    Polygons: lay_polygons,
    Rings: lay_rings,
    Curve: lay_curve,
    Paths: lay_paths,
}
"""How each kind of stroke is laid: its class and the function, which is called with the stroke and
a `Room`, and by keyword `lift_length`, `longest_join`, `least_spacing`, `least_road`, `tolerance`,
`start`."""


_TRIMMED, _TRIMS = 1e-6, 40
"""Share by which a trimmed build may cover more or less than asked, and trials until it does."""


def lay(
    layers: Iterable[Sequence[Any]],
    part: Part,
    *,
    lift_length: float,
    tolerance: float = 2e-3,
    clearance: float = 0.0,
    name: str = "part",
    least_spacing: float | None = None,
    longest_join: float | None = None,
    least_road: float = 0.0,
    beside: Beside | None = None,
) -> Build:
    """The build that lays these strokes, a sequence for each layer of the part, from the bed up.

    Beads stay inside each layer's region. Lines are joined along the walls where that is no more
    than `lift_length` mm longer than the straight way and no more than `longest_join` mm long, and
    thinned where they come nearer than `least_spacing` mm, and roads shorter than `least_road` mm
    are not laid (see `lay_lines`); what that leaves out is `thinned` of each layer. Points within
    `tolerance` (mm) of a straight road are dropped. Beads keep `clearance` (mm) more from all
    walls, for what dropping points and rounding to the machine's steps may take away again. Layers
    that repeat the same strokes (the same objects) over the same region are laid alike. Half of the
    layers are laid by a process `beside`, where there is one.

    Raises `InputError` for a region with no room for a road, strokes of a kind that is not known,
    and layers that are not as many as the part's.
    """
    given: list[tuple[Slab, Sequence[Any]]] = []
    rest = iter(layers)
    for number, slab in enumerate(part.slabs):
        strokes = next(rest, None)
        if strokes is None:
            raise InputError(f"strokes for {number} layers; the part has {len(part.slabs)}")
        given.append((slab, strokes))
    if next(rest, None) is not None:
        raise InputError(f"strokes for more layers than the part's {len(part.slabs)}")
    keys = [(id(slab.region), *map(id, strokes)) for slab, strokes in given]
    different = {
        key: (slab.region, strokes) for key, (slab, strokes) in zip(keys, given, strict=True)
    }
    options = {
        "lift_length": lift_length,
        "longest_join": longest_join,
        "least_spacing": least_spacing,
        "least_road": least_road,
        "tolerance": tolerance,
    }
    work = list(different.values())
    if beside is not None and beside.shares:
        half = len(work) // 2
        others = beside.ask(f"{__name__}:lay_over", work[:half], clearance, options)
        done = lay_over(work[half:], clearance, options)
        done = [*others(), *done]
    else:
        done = lay_over(work, clearance, options)
    laid = dict(zip(different, done, strict=True))
    result = []
    for key, (slab, strokes) in zip(keys, given, strict=True):
        filled = tuple(each.subdomain for each in strokes if isinstance(each, Paths))
        result.append(_layer(slab, laid[key], filled))
    return Build(tuple(result), name)


def lay_over(
    layers: Sequence[tuple[Region, Sequence[Any]]], clearance: float, options: dict[str, Any]
) -> list[Laid]:
    """Each layer's strokes laid over its region; `options` as of every kind's function."""
    tolerance = options["tolerance"] / 2
    rooms = {
        region: Room.of(region, clearance=clearance, tolerance=tolerance)
        for region in dict.fromkeys(region for region, _ in layers)
    }
    return [_laid(strokes, rooms[region], **options) for region, strokes in layers]


def _laid(strokes: Sequence[Any], room: Room, **options: Any) -> Laid:
    """All strokes of a layer, one after the other."""
    roads: list[Road] = []
    left_out: list[Road] = []
    for stroke in strokes:
        if type(stroke) not in LAYING:
            known = ", ".join(kind.__name__ for kind in LAYING)
            raise InputError(f"strokes: {type(stroke).__name__} is not one of {known}")
        start = roads[-1].path[-1] if roads else None
        made = LAYING[type(stroke)](stroke, room, start=start, **options)
        roads += made.roads
        left_out += made.left_out
    return Laid(tuple(roads), tuple(left_out))


def _layer(slab: Slab, laid: Laid, subdomains: tuple[Subdomain, ...]) -> Layer:
    thinned = sum(float(road.segment_volumes(slab.height).sum()) for road in laid.left_out)
    outline = slab.region.geometry
    return Layer(slab.z, slab.height, laid.roads, outline, thinned, subdomains)


def trim(build: Build, volume: float, *, count: str = "volume") -> Build:
    """The build with all roads' sections scaled alike, so that it deposits `volume` (mm^3), or
    covers as much with `count` "coverage".

    What a plan puts at walls, corners and holes differs by some tenths of a per cent from what
    design foresaw. Raises `InputError` for a build without roads, and for more than can be covered.
    """
    if not build.volume > 0:
        raise InputError("trim: the build has no roads to scale")
    # What roads cover is not quite in proportion to their sections.
    for _ in range(1 if count == "volume" else _TRIMS):
        share = volume / total(build, count)
        if abs(share - 1) < _TRIMMED:
            return build
        build = _scaled(build, [np.full(len(layer.roads), share) for layer in build.layers])
    if count != "volume" and abs(volume / total(build, count) - 1) > _TRIMMED:
        raise InputError(f"trim: no width of the roads covers {volume:.4g} mm^3")
    return build


def trim_subdomains(build: Build, volumes: ArrayLike, *, most: float) -> Build:
    """The build with the sections of each sub-domain scaled, so that it deposits its own volume.

    - `volumes`: of the sub-domains in the order of the layers' `subdomains`, (d,), mm^3.
    - `most`: share by which the sections of a sub-domain may change; where it takes more they
      change by this much.
    """
    owners = [layer.owners for layer in build.layers]
    held = np.zeros(len(np.atleast_1d(volumes)))
    for layer, owner in zip(build.layers, owners, strict=True):
        np.add.at(held, owner, layer.road_volumes)
    share = np.divide(volumes, held, out=np.ones_like(held), where=held > 0)
    share = np.clip(share, 1 - most, 1 + most)
    return _scaled(build, [share[owner] for owner in owners])


def _scaled(build: Build, shares: Sequence[NDArray[np.float64]]) -> Build:
    """The build with each road's sections scaled by its own share, layer by layer."""

    def scaled(road: Road, height: float, share: float) -> Road:
        section = share * road.areas(height)
        own = None if road.section is None else section
        return replace(road, width=road_width(section, height), section=own)

    layers = tuple(
        replace(
            layer,
            roads=tuple(
                scaled(road, layer.height, float(each))
                for road, each in zip(layer.roads, own, strict=True)
            ),
        )
        for layer, own in zip(build.layers, shares, strict=True)
    )
    return build.replace(layers=layers)
