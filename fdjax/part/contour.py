"""The outline to be filled: simple polygons with holes, from text, file or points."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely import LinearRing, Polygon
from shapely.geometry.polygon import orient

from fdjax.errors import InputError
from fdjax.part.curve import as_point
from fdjax.part.ring import MERGED, Hole, Mended, at, inside, mended_ring
from fdjax.part.source import named, polygons_in
from fdjax.units import length


def contour(
    source: Polygon | str | Path | Mapping[str, Any] | ArrayLike,
    *,
    holes: Iterable[Hole] = (),
    unit: str = "mm",
    merged: float = MERGED,
) -> Polygon:
    """A simple polygon with holes, in mm, outline counter-clockwise and holes clockwise.

    - `source`: a Shapely polygon; WKT text; GeoJSON as text or as a mapping (a geometry, Feature
      or FeatureCollection with one polygon); a file that holds either; or points, shape (n, 2),
      of which the last may repeat the first. A string that is neither WKT nor GeoJSON is taken as
      a file name.
    - `holes`: more holes, each a polygon (see `circle`), a ring or points.
    - `unit`: of all coordinates, holes included: any unit of `fdjax.units`.
    - `merged`: points nearer than this to the one before are left out, mm.

    Third coordinates are dropped. Raises
    `InputError` with the place for a ring that does not close (files, WKT and GeoJSON repeat the
    first point), crosses or touches itself, has fewer than three distinct points, a point that is
    not finite or no area; for holes that are not inside the outline or not apart; and for a file
    or text that cannot be read.

    >>> contour("POLYGON ((0 0, 2 0, 2 1, 0 1, 0 0))", unit="cm").area
    200.0
    """
    polygons, _ = contours(source, holes=holes, unit=unit, merged=merged, most=1)
    return polygons[0]


def contours(
    source: Any,
    *,
    holes: Iterable[Hole] = (),
    unit: str = "mm",
    straight: float = 0.0,
    merged: float = MERGED,
    most: int | None = None,
) -> tuple[tuple[Polygon, ...], tuple[str, ...]]:
    """The polygons of a source that may hold several, and notes of what was left out of them.

    `source`, `holes`, `unit`, `merged` and errors as for `contour`; `straight` as for
    `fdjax.part.ring.mended_ring`. A hole of `holes` goes to the polygon it lies in. Raises
    `InputError` also for polygons that overlap or touch along an edge, for none, and for more
    than `most`.
    """
    factor = length(f"1 {unit}", "unit")
    name, sources = polygons_in(source)
    count = len(sources)
    if not sources or count > (most or count):
        need = "one is needed" if most == 1 else "at least one is needed"
        raise InputError(f"{name}: holds {count} polygons; {need}")
    mending = {"merged": merged / factor, "straight": straight}
    more = list(holes)
    polygons, notes = [], []
    for k, rings in enumerate(sources, 1):
        own = [*rings[1:], *(more if count == 1 else ())]
        polygon, left_out = _polygon(rings[0], own, named(name, k, count), **mending)
        polygons.append(polygon)
        notes += left_out
    if count > 1:
        _check_apart(polygons, name)
        for k, hole in enumerate(more, 1):
            what = f"{name}, more hole {k}"
            mended = mended_ring(hole, what, **mending)
            notes.append(mended.note(what))
            owner = _owner(polygons, mended.ring, what)
            polygons[owner] = _joined(polygons[owner], mended.ring, what)
    if factor != 1:
        polygons = [shapely.transform(polygon, lambda xy: factor * xy) for polygon in polygons]
    return tuple(polygons), tuple(filter(None, notes))


def circle(centre: ArrayLike, radius: float) -> Polygon:
    """The disc of this `radius` about `centre` as a polygon of 256 sides and the disc's own area.

    The sides lie within 1e-4 of the radius of the circle. Raises `InputError` unless the radius
    is positive and all is finite.

    >>> round(circle((5, 5), 2).area / 4, 12)
    3.14159265359
    """
    middle = as_point(centre, "circle")
    if not (np.isfinite(radius) and radius > 0):
        raise InputError(f"circle: radius {radius:g}; it must be positive")
    angle = 2 * np.pi * np.arange(256) / 256
    outer = radius * np.sqrt(angle[1] / np.sin(angle[1]))
    return Polygon(middle + outer * np.stack([np.cos(angle), np.sin(angle)], 1))


def closed_ring(points: Hole, name: str) -> LinearRing:
    """A polygon's exterior, a ring or points as one simple closed ring; `name` is for errors.

    Raises `InputError` as `contour` does for a single ring.
    """
    return mended_ring(points, name).ring


def valid_polygon(outline: Hole, holes: Iterable[Hole] = (), name: str = "outline") -> Polygon:
    """The polygon of this outline and these holes, counter-clockwise, holes clockwise.

    Raises `InputError` as `contour` does.
    """
    return _polygon(outline, holes, name)[0]


def _polygon(
    outline: Hole, holes: Iterable[Hole], name: str, **mending: float
) -> tuple[Polygon, list[str]]:
    """The polygon, and notes of what was left out of its rings."""
    names = [name]
    rings: list[Mended] = [mended_ring(outline, name, **mending)]
    for k, hole in enumerate(holes, 1):
        names.append(f"{name}, hole {k}")
        rings.append(mended_ring(hole, names[-1], **mending))
    notes = [mended.note(what) for mended, what in zip(rings, names, strict=True)]
    shell, *voids = (Polygon(mended.ring) for mended in rings)
    shapely.prepare(shell)
    for void, what in zip(voids, names[1:], strict=True):
        _check_within(shell, void, what)
    for a, b in shapely.STRtree(voids).query(voids, predicate="intersects").T if voids else ():
        if a < b:
            where = inside(voids[a].intersection(voids[b]))
            raise InputError(
                f"{name}: holes {a + 1} and {b + 1} touch or overlap at {where}; "
                "draw them as one or apart"
            )
    return orient(Polygon(shell.exterior, [void.exterior for void in voids])), notes


def _check_within(shell: Polygon, void: Polygon, what: str) -> None:
    if not shell.contains_properly(void):
        outside = void.difference(shell)
        where = outside if outside.area > 0 else void.intersection(shell.boundary)
        raise InputError(
            f"{what}: touches or leaves the outline at {inside(where)}; "
            "a hole lies inside, apart from the edge"
        )


def _check_apart(polygons: Sequence[Polygon], name: str) -> None:
    """Raise `InputError` where two polygons share more than points."""
    for a, b in shapely.STRtree(polygons).query(polygons, predicate="intersects").T:
        shared = polygons[a].intersection(polygons[b]) if a < b else Polygon()
        if shared.length > 0:
            how = "overlap" if shared.area > 0 else "touch along an edge"
            raise InputError(
                f"{name}: polygons {a + 1} and {b + 1} {how} at {inside(shared)}; "
                "unite them, or draw them apart"
            )


def _owner(polygons: Sequence[Polygon], hole: LinearRing, what: str) -> int:
    """Number of the polygon that a hole lies in."""
    point = shapely.point_on_surface(Polygon(hole))
    owners = np.flatnonzero(shapely.contains(polygons, point))
    if not len(owners):
        raise InputError(f"{what}: lies in no polygon, at {at((point.x, point.y))}")
    return int(owners[0])


def _joined(polygon: Polygon, hole: LinearRing, what: str) -> Polygon:
    """The polygon with one more hole."""
    _check_within(polygon, Polygon(hole), what)
    return orient(Polygon(polygon.exterior, [*polygon.interiors, hole]))
