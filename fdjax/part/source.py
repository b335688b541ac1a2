"""Outlines from text and files: WKT and GeoJSON as rings of points, not yet checked as polygons."""

import json
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import shapely
from shapely import MultiPolygon, Polygon

from fdjax.errors import InputError
from fdjax.part.curve import Floats, as_points
from fdjax.part.ring import at

Rings = list[Any]
"""Rings of one polygon, the outline first; each as points, shape (n, 2)."""

_KINDS = r"(?:MULTI)?(?:POINT|LINESTRING|POLYGON)|LINEARRING|GEOMETRYCOLLECTION"
_TAG = r"\s*(?:ZM|Z|M)?\s*"
_SRID = r"\s*(?:SRID=\d+;\s*)?"
_WKT = re.compile(rf"{_SRID}(?:{_KINDS}){_TAG}(?:EMPTY|\()", re.IGNORECASE)
_RING = r"\([^()]*\)"
_ONE = rf"\(\s*{_RING}(?:\s*,\s*{_RING})*\s*\)"
_SHAPE = (
    rf"(?:POLYGON{_TAG}(?P<one>{_ONE})"
    rf"|MULTIPOLYGON{_TAG}\(\s*(?P<many>{_ONE}(?:\s*,\s*{_ONE})*)\s*\))"
)
_ALONE = re.compile(rf"{_SRID}{_SHAPE}\s*", re.IGNORECASE)
_SHAPES = re.compile(_SHAPE, re.IGNORECASE)
_COLLECTION = re.compile(rf"{_SRID}GEOMETRYCOLLECTION{_TAG}\((.*)\)\s*", re.IGNORECASE | re.DOTALL)
_OTHERS = re.compile(rf"({_KINDS}){_TAG}(?:EMPTY|\([-+.\deE\s,()]*?\)+)", re.IGNORECASE)


def polygons_in(source: Any) -> tuple[str, list[Rings]]:
    """How errors name the source, and the rings of each of its polygons.

    `source` is what `fdjax.part.contour.contour` takes, or holds several such polygons. Raises
    `InputError` for a file or text that cannot be read, a geometry that is no polygon, and a ring
    of WKT, GeoJSON or a file that does not close.
    """
    name = "outline"
    if isinstance(source, shapely.Geometry):
        return name, _from_geometry(source, name)
    if isinstance(source, Mapping):
        return name, _from_geojson(source, name)
    if not isinstance(source, str | Path):
        return name, [[source]]
    text = source.removeprefix(_MARK) if isinstance(source, str) else ""
    if not _is_geometry(text):
        name = f'outline "{_short(source, 250)}"'
        text = _read(Path(source), name)
    return name, _from_text(text, name)


def named(name: str, number: int, count: int) -> str:
    """How errors name one of several polygons."""
    return name if count == 1 else f"{name}, polygon {number}"


def _from_geometry(geometry: shapely.Geometry, name: str) -> list[Rings]:
    if not isinstance(geometry, Polygon | MultiPolygon):
        raise InputError(
            f"{name}: a {type(geometry).__name__}; a Polygon or MultiPolygon is needed"
        )
    if geometry.is_empty:
        raise InputError(f"{name}: the polygon is empty")
    # Coordinates alone: a precision grid of the geometry stays behind.
    return [
        [shapely.get_coordinates(ring) for ring in (part.exterior, *part.interiors)]
        for part in shapely.get_parts(geometry)
    ]


_MARK = "\ufeff"
"""Byte-order mark, which editors put before a text."""


def _is_geometry(text: str) -> bool:
    return text.lstrip().startswith(("{", "[")) or _WKT.match(text) is not None


def _read(path: Path, name: str) -> str:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        need = "a file with WKT or GeoJSON, or such text, is needed"
        raise InputError(f"{name}: cannot be read ({error.strerror}); {need}") from None
    except ValueError:
        raise InputError(f"{name}: is no text file; WKT or GeoJSON is needed") from None
    if not _is_geometry(text):
        raise InputError(f"{name}: holds neither WKT nor GeoJSON (it begins {_short(text)!r})")
    return text


def _from_text(text: str, name: str) -> list[Rings]:
    if not text.lstrip().startswith(("{", "[")):
        return _from_wkt(text, name)
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise InputError(f"{name}: is not JSON: {error.msg} at {where}") from None
    return _from_geojson(document, name)


def _from_wkt(text: str, name: str) -> list[Rings]:
    collection = _COLLECTION.fullmatch(text)
    alone = _ALONE.fullmatch(text)
    found = [alone] if alone else list(_SHAPES.finditer(collection[1])) if collection else []
    if not found:
        held = [kind[1].upper() for kind in _OTHERS.finditer(collection[1] if collection else text)]
        what = _counted(held) if held else repr(_short(text))
        raise InputError(
            f"{name}: {what} is not a WKT POLYGON ((x y, x y, ...)) or MULTIPOLYGON, nor holds one"
        )
    if collection and not set(_SHAPES.sub("", _OTHERS.sub("", collection[1]))) <= set(", ()\r\n\t"):
        raise InputError(f"{name}: {_short(text)!r} is not a WKT GEOMETRYCOLLECTION")
    polygons = [
        [
            [[_number(word, name) for word in position.split()] for position in ring.split(",")]
            for ring in re.findall(r"\(([^()]*)\)", polygon)
        ]
        for shape in found
        for polygon in re.findall(_ONE, shape["one"] or shape["many"])
    ]
    return _all_closed(polygons, name)


def _from_geojson(document: Any, name: str) -> list[Rings]:
    others: list[str] = []
    polygons = _geojson_polygons(document, name, others)
    if not polygons and others:
        what = f"type {others[0]!r}" if len(others) == 1 else f"holds {_counted(others)}"
        raise InputError(f"{name}: GeoJSON {what}; a Polygon is needed")
    return _all_closed(polygons, name)


_MEMBERS = {
    "Polygon": "coordinates",
    "MultiPolygon": "coordinates",
    "Feature": "geometry",
    "FeatureCollection": "features",
    "GeometryCollection": "geometries",
}
_OTHER_KINDS = ("Point", "MultiPoint", "LineString", "MultiLineString")


def _geojson_polygons(node: Any, name: str, others: list[str]) -> list[Any]:
    """The coordinates of every polygon in GeoJSON (RFC 7946), or in a list of it.

    The kinds of what is no polygon, as labels and lines, go to `others`.
    """
    if isinstance(node, list):
        return [polygon for each in node for polygon in _geojson_polygons(each, name, others)]
    kind = node.get("type") if isinstance(node, Mapping) else None
    if kind in _OTHER_KINDS:
        others.append(str(kind))
        return []
    member = _MEMBERS.get(str(kind))
    if not isinstance(node, Mapping) or member is None:
        what = "is no object" if not isinstance(node, Mapping) else f"has type {kind!r}"
        what = "has no type" if isinstance(node, Mapping) and "type" not in node else what
        raise InputError(f"{name}: GeoJSON {what}; a Polygon is needed")
    content = node.get(member)
    if kind == "Feature":
        if content is None:
            others.append("Feature without geometry")
            return []
        return _geojson_polygons(content, name, others)
    if not isinstance(content, list):
        raise InputError(f'{name}: GeoJSON {kind} without a list of "{member}"')
    if kind in ("Polygon", "MultiPolygon"):
        return [content] if kind == "Polygon" else content
    return _geojson_polygons(content, name, others)


def _counted(kinds: list[str]) -> str:
    """Kinds of geometry with their numbers, in words."""
    counts = Counter(kinds)
    return ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "nothing"


def _all_closed(polygons: list[Any], name: str) -> list[Rings]:
    count = len(polygons)
    return [_closed(rings, named(name, k, count)) for k, rings in enumerate(polygons, 1)]


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
                f"{what}: does not close: it starts at {at(xy[0])} and ends at {at(xy[-1])}; "
                "the last point must repeat the first"
            )
        arrays.append(xy)
    return arrays


def _number(word: str, name: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{name}: {word!r} in the WKT is no number") from None


def _short(text: object, most: int = 60) -> str:
    line = " ".join(str(text).split())
    return line if len(line) <= most else line[: most - 3] + "..."
