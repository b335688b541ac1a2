"""The outline to be filled: a simple polygon with holes, from text, file or points."""

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely import LinearRing, Polygon
from shapely.geometry.polygon import orient

from fdjax.errors import InputError
from fdjax.part.curve import Floats, as_point, as_points
from fdjax.units import length

Hole = Polygon | LinearRing | ArrayLike

_WKT = re.compile(
    r"\s*(?:SRID=\d+;\s*)?(?:MULTI)?(?:POINT|LINESTRING|LINEARRING|POLYGON|GEOMETRYCOLLECTION)"
    r"\s*(?:ZM|Z|M)?\s*(?:EMPTY|\()",
    re.IGNORECASE,
)
_WKT_POLYGON = re.compile(
    r"\s*(?:SRID=\d+;\s*)?POLYGON\s*(?:ZM|Z|M)?\s*"
    r"\(\s*(\([^()]*\)(?:\s*,\s*\([^()]*\))*)\s*\)\s*",
    re.IGNORECASE,
)


def contour(
    source: Polygon | str | Path | Mapping[str, Any] | ArrayLike,
    *,
    holes: Iterable[Hole] = (),
    unit: str = "mm",
) -> Polygon:
    """A simple polygon with holes, in mm, outline counter-clockwise and holes clockwise.

    - `source`: a Shapely polygon; WKT text; GeoJSON as text or as a mapping (a geometry, Feature
      or FeatureCollection with one polygon); a file that holds either; or points, shape (n, 2),
      of which the last may repeat the first. A string that is neither WKT nor GeoJSON is taken as
      a file name.
    - `holes`: more holes, each a polygon (see `circle`), a ring or points.
    - `unit`: of all coordinates, holes included: any unit of `fdjax.units`.

    Third coordinates are dropped, and so are points that repeat the one before. Raises
    `InputError` with the place for a ring that does not close (files, WKT and GeoJSON repeat the
    first point), crosses or touches itself, has fewer than three distinct points, a point that is
    not finite or no area; for holes that are not inside the outline or not apart; and for a file
    or text that cannot be read.

    >>> contour("POLYGON ((0 0, 2 0, 2 1, 0 1, 0 0))", unit="cm").area
    200.0
    """
    name = "outline"
    if isinstance(source, Polygon):
        rings = [np.asarray(ring.coords) for ring in (source.exterior, *source.interiors)]
    elif isinstance(source, Mapping):
        rings = _from_geojson(source, name)
    elif isinstance(source, str | Path):
        text = source if isinstance(source, str) else ""
        if not _is_geometry(text):
            name = f'outline "{_short(source, 250)}"'
            text = _read(Path(source), name)
        rings = _from_text(text, name)
    else:
        rings = [source]
    polygon = valid_polygon(rings[0], [*rings[1:], *holes], name)
    factor = length(f"1 {unit}", "unit")
    return polygon if factor == 1 else shapely.transform(polygon, lambda xy: factor * xy)


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
    if isinstance(points, Polygon):
        if points.interiors:
            raise InputError(f"{name}: has holes itself; give a plain ring")
        points = points.exterior
    if isinstance(points, LinearRing):
        points = shapely.get_coordinates(points)
    xy = as_points(points, name)
    size = np.ptp(xy, axis=0).max()
    kept = xy[np.abs(np.diff(xy, axis=0, append=xy[:1])).max(1) > 1e-12 * size]
    distinct = max(1, len(np.unique(kept, axis=0)))
    if distinct < 3:
        raise InputError(f"{name}: has {distinct} distinct points; at least 3 are needed")
    result = LinearRing(kept)
    if result.convex_hull.area < 1e-12 * size**2:
        raise InputError(f"{name}: has no area, all points lie on one line by {_at(xy[0])}")
    fault = re.fullmatch(r"(.*)\[(\S+) (\S+).*\]", shapely.is_valid_reason(Polygon(result)))
    if fault:
        how = "touches" if fault[1].startswith("Ring") else "crosses"
        raise InputError(f"{name}: {how} itself at {_at((float(fault[2]), float(fault[3])))}")
    return result


def valid_polygon(outline: Hole, holes: Iterable[Hole] = (), name: str = "outline") -> Polygon:
    """The polygon of this outline and these holes, counter-clockwise, holes clockwise.

    Raises `InputError` as `contour` does.
    """
    shell = Polygon(closed_ring(outline, name))
    voids = [Polygon(closed_ring(hole, f"{name}, hole {k}")) for k, hole in enumerate(holes, 1)]
    shapely.prepare(shell)
    for k, void in enumerate(voids, 1):
        if not shell.contains_properly(void):
            outside = void.difference(shell)
            where = outside if outside.area > 0 else void.intersection(shell.exterior)
            raise InputError(f"{name}, hole {k}: touches or leaves the outline at {_inside(where)}")
    for a, b in shapely.STRtree(voids).query(voids, predicate="intersects").T if voids else ():
        if a < b:
            where = _inside(voids[a].intersection(voids[b]))
            raise InputError(f"{name}: holes {a + 1} and {b + 1} touch or overlap at {where}")
    return orient(Polygon(shell.exterior, [void.exterior for void in voids]))


def _is_geometry(text: str) -> bool:
    return text.lstrip().startswith("{") or _WKT.match(text) is not None


def _read(path: Path, name: str) -> str:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        need = "a file with WKT or GeoJSON, or such text, is needed"
        raise InputError(f"{name}: cannot be read ({error.strerror}); {need}") from None
    except ValueError:
        raise InputError(f"{name}: is no text file; WKT or GeoJSON is needed") from None
    if not _is_geometry(text):
        raise InputError(f"{name}: holds neither WKT nor GeoJSON (it begins {_short(text)!r})")
    return text


def _from_text(text: str, name: str) -> list[Floats]:
    """The rings of WKT or GeoJSON text, the outline first."""
    if not text.lstrip().startswith("{"):
        return _from_wkt(text, name)
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise InputError(f"{name}: is not JSON: {error.msg} at {where}") from None
    return _from_geojson(document, name)


def _from_wkt(text: str, name: str) -> list[Floats]:
    body = _WKT_POLYGON.fullmatch(text)
    if body is None:
        raise InputError(f"{name}: {_short(text)!r} is not a WKT POLYGON ((x y, x y, ...))")
    rings = [
        [[_number(word, name) for word in position.split()] for position in ring.split(",")]
        for ring in re.findall(r"\(([^()]*)\)", body[1])
    ]
    return _closed(rings, name)


def _from_geojson(document: Mapping[str, Any], name: str) -> list[Floats]:
    polygons = _geojson_polygons(document, name)
    if len(polygons) != 1:
        raise InputError(f"{name}: GeoJSON holds {len(polygons)} polygons; one is needed")
    return _closed(polygons[0], name)


def _geojson_polygons(node: Any, name: str) -> list[Any]:
    """The coordinates of every polygon in a GeoJSON object (RFC 7946); others are an error."""
    kind = node.get("type") if isinstance(node, Mapping) else None
    member = {
        "Polygon": "coordinates",
        "MultiPolygon": "coordinates",
        "Feature": "geometry",
        "FeatureCollection": "features",
    }.get(str(kind))
    if member is None:
        raise InputError(f"{name}: GeoJSON type {kind!r}; a Polygon is needed")
    content = node.get(member)
    if kind == "Feature":
        return _geojson_polygons(content, name)
    if not isinstance(content, list):
        raise InputError(f'{name}: GeoJSON {kind} without a list of "{member}"')
    if kind == "FeatureCollection":
        return [polygon for feature in content for polygon in _geojson_polygons(feature, name)]
    return [content] if kind == "Polygon" else content


def _closed(rings: Any, name: str) -> list[Floats]:
    """Rings as arrays (n, 2), each checked to end where it starts."""
    if not isinstance(rings, list) or not rings:
        raise InputError(f"{name}: the polygon is empty")
    arrays = []
    for k, positions in enumerate(rings):
        what = f"{name}, hole {k}" if k else name
        try:
            xy = as_points([position[:2] for position in positions], what)
        except (TypeError, KeyError):
            raise InputError(f"{what}: positions must be lists of two numbers") from None
        if not (xy[0] == xy[-1]).all():
            raise InputError(
                f"{what}: does not close: it starts at {_at(xy[0])} and ends at {_at(xy[-1])}; "
                "the last point must repeat the first"
            )
        arrays.append(xy)
    return arrays


def _number(word: str, name: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{name}: {word!r} in the WKT is no number") from None


def _at(point: Any) -> str:
    return f"({point[0]:g}, {point[1]:g})"


def _inside(place: shapely.Geometry) -> str:
    point = shapely.point_on_surface(place)
    return _at((point.x, point.y))


def _short(text: object, most: int = 60) -> str:
    line = " ".join(str(text).split())
    return line if len(line) <= most else line[: most - 3] + "..."
