"""What the layers of a build fill, where its file does not say: told from its roads."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from contourpy import FillType, contour_generator
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from fdjax.errors import InputError
from fdjax.part.corners import smallest_rectangle
from fdjax.plan.segments import Segments
from fdjax.plan.toolpath import Build, Layer, Outline, Roads

Floats = NDArray[np.float64]

_OUTER, _WALLS = "outer perimeter", ("outer perimeter", "overhang")
_ALIKE = 1e-3
"""Share of an outline by which the next layer's may differ and still be taken for the same."""
_REACH = 0.6
"""Half of the widest gap between roads that is filled, as a share of their mean spacing."""


def outlined(build: Build) -> tuple[Build, str]:
    """The build with outlines in all layers, and where they are from, in words.

    They are those of the outermost perimeters, widened by half a road, where a slicer has named
    these; else one for all layers, what the roads cover from above with the gaps between them.
    Layers that have an outline keep it. Raises `InputError` for a build without roads.
    """
    found: list[Outline | None] = []
    for layer in build.layers:
        own = layer.outline if layer.outline is not None else _within_perimeters(layer)
        last = next((each for each in reversed(found) if each is not None), None)
        if own is not None and last is not None and own is not last and _alike(own, last):
            own = last
        found.append(own)
    said = "the outermost perimeters"
    if all(each is None for each in found):
        footprint, gap = _footprint(build)
        found = [footprint] * len(found)
        said = f"the roads' footprint, with gaps of up to {gap:.2g} mm closed"
    layers = []
    below = next(each for each in found if each is not None)
    for layer, own in zip(build.layers, found, strict=True):
        below = own if own is not None else below
        layers.append(replace(layer, outline=below))
    return build.replace(layers=tuple(layers)), said


def with_outlines_of(whole: Build, build: Build) -> Build:
    """The build with the outlines that another has in its layers nearest in z."""
    tops = np.array([layer.z for layer in whole.layers])
    layers = (
        replace(layer, outline=whole.layers[int(np.abs(tops - layer.z).argmin())].outline)
        for layer in build.layers
    )
    return build.replace(layers=tuple(layers))


def _alike(a: Outline, b: Outline) -> bool:
    return a.symmetric_difference(b).area <= _ALIKE * b.area


def _within_perimeters(layer: Layer) -> Outline | None:
    """What lies within the layer's outermost perimeters, beads included."""
    roads = layer.roads
    if isinstance(roads, Roads):
        codes = [code for code, name in enumerate(roads.names) if name in _WALLS]
        walls = np.flatnonzero(np.isin(roads.role, codes)).tolist()
    else:
        walls = [k for k, road in enumerate(roads) if road.role in _WALLS]
    rings: list[tuple[Polygon, float]] = []
    chain: list[Floats] = []
    widths: list[float] = []
    outer = False
    for k in [*walls, None]:
        road = None if k is None else roads[k]
        if chain and (road is None or np.abs(road.path[0] - chain[-1][-1]).max() > 1e-3):
            path, wide = np.concatenate(chain), float(np.median(widths))
            if outer and len(path) > 3 and np.hypot(*(path[0] - path[-1])) < 2 * wide:
                rings.append((Polygon(path), wide))
            chain, widths, outer = [], [], False
        if road is not None:
            chain.append(road.path)
            widths.append(float(np.median(road.width)))
            outer = outer or road.role == _OUTER
    return _even_odd(rings)


def _even_odd(rings: list[tuple[Polygon, float]]) -> Outline | None:
    """Shells widened and holes narrowed by half a road; a ring inside one ring is a hole."""
    if not rings:
        return None
    shapes = [shapely.make_valid(ring) for ring, _ in rings]
    places = shapely.point_on_surface(shapes)
    whole: list[shapely.Geometry] = []
    holes: list[shapely.Geometry] = []
    for number, (shape, (_, wide)) in enumerate(zip(shapes, rings, strict=True)):
        around = [
            k != number and shapes[k].area > shape.area and shapes[k].contains(places[number])
            for k in range(len(shapes))
        ]
        if sum(around) % 2:
            holes.append(shape.buffer(-wide / 2, join_style="mitre"))
        else:
            whole.append(shape.buffer(wide / 2, join_style="mitre"))
    return _polygons(shapely.union_all(whole).difference(shapely.union_all(holes)))


def _polygons(geometry: shapely.Geometry) -> Outline | None:
    parts = [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]
    parts = [part for part in parts if part.area > 0]
    if not parts:
        return None
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _footprint(build: Build) -> tuple[Outline, float]:
    """What all roads cover from above, gaps between them closed, and the widest gap so closed."""
    each = [segments for segments in _segments(build) if len(segments.length)]
    if not each:
        raise InputError("the build has no roads, so there is nothing that they fill")
    width = float(np.median(np.concatenate([segments.width for segments in each])))
    low = np.min([np.minimum(s.start, s.end).min(0) for s in each], axis=0)
    high = np.max([np.maximum(s.start, s.end).max(0) for s in each], axis=0)
    cell = max(width / 4, float((high - low).max()) / 1500)
    shape = tuple(np.ceil((high - low) / cell).astype(int) + 3)
    mask = np.zeros(shape, bool)
    spacings = []
    for segments in each:
        count = np.ceil(segments.length / cell * 2).astype(int) + 1
        owner = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)) / count[owner]
        along = (share * segments.length[owner])[:, None] * segments.unit[owner]
        places = np.concatenate([segments.start[owner] + along, segments.end])
        mask[tuple(np.rint((places - low) / cell).astype(int).T + 1)] = True
        ends = shapely.MultiPoint(np.concatenate([segments.start, segments.end]))
        # Roads have a strip of their spacing each; the hull lacks half of one all round.
        hull, length = ends.convex_hull, float(segments.length.sum())
        spacings.append(max(hull.area / max(length - hull.length / 2, length / 4), width))
    reach = _REACH * float(np.median(spacings))
    x, y = (low[axis] + cell * (np.arange(shape[axis]) - 1) for axis in (0, 1))
    lines = contour_generator(x, y, mask.T.astype(float), fill_type=FillType.OuterOffset)
    covered = [
        Polygon(points[offsets[0] : offsets[1]], _holes(points, offsets))
        for points, offsets in zip(*lines.filled(0.5, np.inf), strict=True)
    ]
    closed = shapely.buffer(shapely.union_all(shapely.buffer(covered, reach)), -reach)
    if reach > 2 * width:
        closed = _squared(closed, reach)
    filled = _polygons(shapely.buffer(closed, width / 2 - cell / 2, join_style="mitre"))
    if filled is None:
        raise InputError("the roads lie too far apart to tell what they fill; name the outline")
    parts = [
        Polygon(part.exterior, [h for h in part.interiors if Polygon(h).area > (4 * reach) ** 2])
        for part in shapely.get_parts(filled)
    ]
    return _polygons(MultiPolygon(parts)) or filled, 2 * reach


def _squared(closed: shapely.Geometry, reach: float) -> shapely.Geometry:
    """What sparse roads cover, or the rectangle round it where no more than its corners lack."""
    rectangle = Polygon(smallest_rectangle(shapely.get_coordinates(closed)))
    return rectangle if shapely.hausdorff_distance(closed, rectangle) < 1.5 * reach else closed


def _segments(build: Build) -> Iterable[Segments]:
    return (Segments.of(layer.roads) for layer in build.layers if len(layer.roads))


def _holes(points: Floats, offsets: NDArray[np.integer]) -> list[Floats]:
    return [points[a:b] for a, b in pairwise(offsets[1:])]
