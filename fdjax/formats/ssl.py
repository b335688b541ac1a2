"""SSL, the slice file of Stratasys' QuickSlice: the layers' outlines, and how they are filled.

    Slice V0
    FILE(name)
    UNITS(INCH)
    SLICES()
    Z <z> <dz>      z is the layer's top
    x y             one vertex a line; the first is not repeated
    C               closes the contour
    END

A layer that falls into sub-domains has the contours of each, and before the first of each a line

    PROPERTIES(FILL=raster ANGLE=45 WIDTH=0.0157 GAP=0.04 PERIMETERS=1)

with its raster angle in degrees and its road width and air gap in the file's unit. That line is an
extension of ours, as the paper assigns "raster angles, road widths and air-gaps [...] to each
sub-domain by automatically modifying the properties of individual polygons in the slice (SSL)
file" and no public source tells how; `write(build, extended=False)` leaves sub-domains out.

SSL has no place for where the part lies on the bed, so coordinates are the part's own, in inches.
"""

import math
import re

import numpy as np
from shapely import (
    LinearRing,
    MultiPolygon,
    Polygon,
    STRtree,
    get_coordinates,
    get_parts,
    union_all,
)
from shapely.geometry.polygon import orient

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.plan.toolpath import Build, Layer, Outline
from fdjax.road.stroke import Subdomain
from fdjax.units import MM_PER_INCH

__all__ = ["read", "write"]

_DECIMALS = 8  # of an inch, 0.25 nm

_MET = 1e-6
"""Sub-domains meet where their sides are nearer than this, mm."""

_NAMES = {"FILL", "ANGLE", "WIDTH", "GAP", "PERIMETERS"}


def write(build: Build, machine: Machine | None = None, *, extended: bool = True) -> str:
    """The SSL file of the build's outlines; roads are not in it, and no machine is needed.

    With `extended` a layer's sub-domains are written with their properties instead of its outline.
    Outer contours run counter-clockwise, holes clockwise. Raises `InputError` where a layer has no
    outline.
    """
    out = ["Slice V0", f"FILE({' '.join(build.name.split())})", "UNITS(INCH)", "SLICES()"]
    for index, layer in enumerate(build.layers):
        if layer.outline is None or layer.outline.is_empty:
            raise InputError(f"SSL: layer {index + 1} has no outline, and SSL holds outlines only")
        out.append(f"Z {_inches(layer.z)} {_inches(layer.height)}")
        if extended and layer.subdomains:
            for subdomain in layer.subdomains:
                out += [_properties(subdomain), *_contours(subdomain.outline)]
        else:
            out += _contours(layer.outline)
    out += ["END", ""]
    return "\n".join(out)


def _contours(outline: Outline) -> list[str]:
    out = []
    for polygon in map(orient, get_parts(outline)):
        for ring in (polygon.exterior, *polygon.interiors):
            points = get_coordinates(ring)[:-1] / MM_PER_INCH + 0.0
            out += [f"{x:.{_DECIMALS}f} {y:.{_DECIMALS}f}" for x, y in points.tolist()]
            out.append("C")
    return out


def _properties(some: Subdomain) -> str:
    return (
        f"PROPERTIES(FILL={some.fill} ANGLE={some.angle:g} WIDTH={_inches(some.road_width)} "
        f"GAP={_inches(some.air_gap)} PERIMETERS={some.perimeters})"
    )


def _inches(length: float) -> str:
    return f"{length / MM_PER_INCH:.{_DECIMALS}f}"


def read(text: str) -> Build:
    """The layers of an SSL file, with their outlines and no roads.

    A contour inside another is a hole of it, one inside a hole an outline again. Raises
    `InputError`, with the line, for text that is no SSL, a unit other than INCH, an open or
    crossing contour, a truncated file, or a layer whose contours cross each other or touch along
    an edge.
    """
    lines = [line.strip() for line in text.splitlines()]
    if not lines or not re.fullmatch(r"slice\s+v0", lines[0], re.IGNORECASE):
        raise InputError("not SSL: the first line is not 'Slice V0'")
    name = "part"
    levels: list[tuple[float, float, int]] = []
    contours: list[list[LinearRing]] = []
    filled: list[list[tuple[dict[str, str], int, list[LinearRing]]]] = []
    points: list[tuple[float, float]] = []
    for number, line in enumerate(lines[1:], 2):
        upper = line.upper()
        if not line or upper.startswith("SLICES"):
            continue
        if upper.startswith("FILE("):
            name = line[5:].rpartition(")")[0] or name
        elif upper.startswith("UNITS("):
            if upper != "UNITS(INCH)":
                raise InputError(f"SSL line {number}: {line!r}; only UNITS(INCH) is known")
        elif upper == "END":
            if points:
                raise InputError(f"SSL line {number}: END inside a contour; C is missing")
            layers = tuple(
                _layer(*level, rings, own)
                for level, rings, own in zip(levels, contours, filled, strict=True)
            )
            return Build(layers, name=name)
        elif upper == "O":
            raise InputError(f"SSL line {number}: an open curve is no outline")
        elif upper == "C":
            if not contours:
                _no_layer(number)
            own = filled[-1][-1][2] if filled[-1] else contours[-1]
            own.append(_ring(points, number))
            points = []
        elif upper.startswith("PROPERTIES("):
            if not contours:
                _no_layer(number)
            filled[-1].append((_settings(line, number), number, []))
        elif upper.startswith("Z"):
            if points:
                raise InputError(f"SSL line {number}: a layer begins inside a contour")
            levels.append((*_pair(line[1:], number), number))
            contours.append([])
            filled.append([])
        else:
            points.append(_pair(line, number))
    raise InputError(f"SSL line {len(lines)}: the file is truncated: END is missing")


def _layer(
    z: float,
    dz: float,
    number: int,
    rings: list[LinearRing],
    filled: list[tuple[dict[str, str], int, list[LinearRing]]],
) -> Layer:
    if not filled:
        return Layer(z, dz, (), _outline(rings, number))
    subdomains = [_subdomain(*own) for own in filled]
    if rings:
        raise InputError(f"SSL line {number}: a contour stands before the first PROPERTIES")
    union = union_all([some.outline for some in subdomains], grid_size=_MET)
    assert isinstance(union, Outline)
    return Layer(z, dz, (), union, subdomains=tuple(subdomains))


def _settings(line: str, number: int) -> dict[str, str]:
    inside = re.fullmatch(r"properties\((.*)\)", line, re.IGNORECASE)
    words = inside[1].split() if inside else []
    settings = dict(word.upper().split("=", 1) for word in words if "=" in word)
    if len(settings) != len(words) or set(settings) != _NAMES:
        raise InputError(
            f"SSL line {number}: {line[:40]!r}; PROPERTIES(...) needs {', '.join(sorted(_NAMES))}"
        )
    return settings


def _subdomain(settings: dict[str, str], number: int, rings: list[LinearRing]) -> Subdomain:
    outline = _outline(rings, number)
    if outline is None:
        raise InputError(f"SSL line {number}: PROPERTIES without a contour")
    try:
        angle, width, gap = (float(settings[name]) for name in ("ANGLE", "WIDTH", "GAP"))
        perimeters = int(settings["PERIMETERS"])
    except ValueError:
        angle = width = gap = math.nan
        perimeters = 0
    if not (math.isfinite(angle) and 0 < width < math.inf and 0 <= gap < math.inf):
        raise InputError(f"SSL line {number}: ANGLE, WIDTH, GAP and PERIMETERS must be numbers")
    fill = settings["FILL"].lower()
    return Subdomain(outline, fill, angle, width * MM_PER_INCH, gap * MM_PER_INCH, perimeters)


def _pair(text: str, number: int) -> tuple[float, float]:
    try:
        a, b = (float(item) * MM_PER_INCH for item in text.split())
    except ValueError:
        a = b = math.nan
    if not (math.isfinite(a) and math.isfinite(b)):
        raise InputError(f"SSL line {number}: {text.strip()[:30]!r}; two numbers are needed")
    return a, b


def _ring(points: list[tuple[float, float]], number: int) -> LinearRing:
    ring = LinearRing(points) if len(points) >= 3 else None
    if ring is None or not ring.is_valid:
        raise InputError(f"SSL line {number}: the contour that ends here crosses itself or is flat")
    return ring


def _no_layer(number: int) -> None:
    raise InputError(f"SSL line {number}: a contour before the first layer (Z)")


def _outline(rings: list[LinearRing], number: int) -> Outline | None:
    """The rings that lie in an even number of others, each with those just inside it as holes."""
    if not rings:
        return None
    discs = np.array([Polygon(ring) for ring in rings])
    areas = np.array([disc.area for disc in discs])
    inner, outer = STRtree(discs).query(discs, predicate="covered_by")
    nested = areas[outer] > areas[inner]
    inner, outer = inner[nested], outer[nested]
    depth = np.bincount(inner, minlength=len(rings))
    around = {int(k): int(j) for k, j in zip(inner, outer, strict=True) if depth[j] == depth[k] - 1}
    polygons = [
        Polygon(rings[k], [rings[hole] for hole, owner in around.items() if owner == k])
        for k in np.flatnonzero(depth % 2 == 0)
    ]
    outline = polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)
    if not outline.is_valid:
        raise InputError(
            f"SSL line {number}: the contours of this layer cross or touch; outlines lie apart, "
            "holes inside them"
        )
    return outline
