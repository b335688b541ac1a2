"""The `[part]` table of a job: the outline, its holes and its layers."""
# ruff: noqa: RUF009 - `key` gives a dataclass field

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from fdjax.errors import InputError
from fdjax.keys import (
    COORDINATE,
    FILE,
    FLAG,
    LENGTH,
    POINT,
    TEXT,
    UNIT,
    Kind,
    Place,
    choice,
    key,
    one_of,
    pair,
    points,
    show,
    whole,
)

Point = tuple[float, float]
Points = tuple[Point, ...]


@dataclass(frozen=True)
class Circle:
    """A round hole, mm."""

    centre: Point
    radius: float


@dataclass(frozen=True)
class Ring:
    """A hole with straight sides, mm; the last point runs on to the first."""

    points: Points


@dataclass(frozen=True)
class Side:
    """One side of a four-sided outline: `shape` is polyline, arc or spline; points in mm."""

    shape: str
    points: Points


def _side(value: Any, place: Place) -> Side:
    shapes = {"polyline": points(2), "arc": points(3, 3), "spline": points(2)}
    if not isinstance(value, dict) or len(value) != 1 or next(iter(value)) not in shapes:
        raise place.error(
            f"{show(value)} is no side; write {{polyline = [[x, y], ...]}}, {{spline = ...}} or "
            "{arc = [start, through, end]}"
        )
    (shape, value), *_ = value.items()
    return Side(shape, shapes[shape].read(value, place.at(f".{shape}")))


def _holes(value: Any, place: Place) -> tuple[Circle | Ring, ...]:
    if not isinstance(value, list):
        raise place.error(f"{show(value)} must be a list in [ ]")
    return tuple(_hole(item, place.at(f"[{k}]")) for k, item in enumerate(value))


def _hole(value: Any, place: Place) -> Circle | Ring:
    if isinstance(value, dict) and value.keys() == {"circle", "radius"}:
        centre = POINT.read(value["circle"], place.at(".circle"))
        radius = COORDINATE.read(value["radius"], place.at(".radius"))
        if not radius > 0:
            raise place.error(f"radius {show(value['radius'])} must be more than 0")
        return Circle(centre, radius)
    if isinstance(value, dict) and value.keys() == {"points"}:
        return Ring(points(3).read(value["points"], place.at(".points")))
    raise place.error(
        f"{show(value)} is no hole; write {{circle = [x, y], radius = r}} or "
        "{points = [[x, y], ...]}"
    )


SIDE = Kind("`{polyline = points}`, `{spline = points}` or `{arc = 3 points}`", _side)
HOLES = Kind("list of `{circle = [x, y], radius = r}`, `{points = points}`", _holes)
OUTLINE, CORNERS = points(3), points(4, 4)


@dataclass(frozen=True)
class Part:
    """`[part]`: what is to be filled. All lengths and coordinates in mm once read."""

    shape: str = key(
        choice("rectangle", "cosine_top", "polygon", "curves"),
        "outline: a rectangle from (0, 0), the paper's eq. (8) domain, any simple polygon, "
        "or four curves that close on each other",
    )
    size: tuple[float, float] | None = key(
        pair(LENGTH), "rectangle: its width and height", default=None, shown="-"
    )
    file: Path | None = key(FILE, "polygon: GeoJSON or WKT file", default=None, shown="-")
    wkt: str | None = key(TEXT, "polygon: as WKT", default=None, shown="-")
    points: Points | None = key(OUTLINE, "polygon: its points in order", default=None, shown="-")
    corners: Points | None = key(
        CORNERS,
        "polygon: the points of its edge that become the corners (xi, eta) = "
        "(0,0), (1,0), (1,1), (0,1)",
        default=None,
        shown="chosen",
    )
    smooth: bool = key(FLAG, "polygon: sides are splines through its points", default=False)
    bottom: Side | None = key(SIDE, "curves: eta = 0, with rising xi", default=None, shown="-")
    right: Side | None = key(SIDE, "curves: xi = 1, with rising eta", default=None, shown="-")
    top: Side | None = key(SIDE, "curves: eta = 1, with rising xi", default=None, shown="-")
    left: Side | None = key(SIDE, "curves: xi = 0, with rising eta", default=None, shown="-")
    unit: str = key(UNIT, "of bare coordinates, here and in `file` and `wkt`", default="mm")
    holes: tuple[Circle | Ring, ...] = key(HOLES, "cut out of the roads", default=[])
    narrow: str = key(
        choice("refuse", "skip"), "where the part is narrower than a road", default="refuse"
    )
    layers: int = key(whole(1, 10000), "number of layers", default=10)
    layer_height: float = key(LENGTH, "height of each layer", default="0.2mm")

    _BELONGS: ClassVar[dict[str, str]] = {
        "size": "rectangle",
        **dict.fromkeys(("file", "wkt", "points", "corners"), "polygon"),
        **dict.fromkeys(("bottom", "right", "top", "left"), "curves"),
    }

    def __post_init__(self) -> None:
        for name, shape in self._BELONGS.items():
            if shape != self.shape and getattr(self, name) is not None:
                raise InputError(f'{name} is for shape "{shape}", and shape is "{self.shape}"')
        if self.smooth and self.shape != "polygon":
            raise InputError(f'smooth is for shape "polygon", and shape is "{self.shape}"')
        if self.shape == "polygon":
            one_of(self, ("file", "wkt", "points"), 'shape "polygon"')
        needed = {"rectangle": ("size",), "curves": ("bottom", "right", "top", "left")}
        for name in needed.get(self.shape, ()):
            if getattr(self, name) is None:
                raise InputError(f'{name} is missing; shape "{self.shape}" needs it')
