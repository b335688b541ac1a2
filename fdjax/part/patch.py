"""A layer domain as four matched sides, ready to be the image of the unit square."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from shapely import LinearRing, Polygon

from fdjax.errors import InputError
from fdjax.part.contour import Hole, closed_ring, valid_polygon
from fdjax.part.corners import four_sides
from fdjax.part.curve import Curve, Floats, polyline, spline
from fdjax.part.curve import smooth as smooth_curve
from fdjax.units import MICROSTEP

_CLOSING = 1e-6
"""How far apart the ends of two sides may lie, as a share of the outline's size."""


@dataclass(frozen=True, eq=False)
class Patch:
    """Four curves that close on each other, and the holes inside.

    `bottom` (eta = 0) and `top` (eta = 1) run with rising xi, `left` (xi = 0) and `right` (xi = 1)
    with rising eta, counter-clockwise as bottom, right, top backwards, left backwards. `holes`
    are closed rings. Raises `InputError` when the sides do not meet, cross themselves or each
    other, run clockwise, or when a hole is not inside.
    """

    bottom: Curve
    right: Curve
    top: Curve
    left: Curve
    holes: tuple[LinearRing, ...] = ()

    def __post_init__(self) -> None:
        ring = self._ring()
        size = np.ptp(ring, axis=0).max()
        for what, (p, q) in _meetings(self.bottom, self.right, self.top, self.left).items():
            gap = float(np.hypot(*(p - q)))
            if gap > _CLOSING * size:
                first, second = what.split(", ")
                raise InputError(
                    f"outline: does not close: {first} at ({p[0]:g}, {p[1]:g}), but {second} at "
                    f"({q[0]:g}, {q[1]:g}), {gap:.3g} mm apart"
                )
        valid = self.outline
        if not LinearRing(ring).is_ccw:
            x, y = valid.exterior.coords[0]
            raise InputError(
                f"outline: bottom, right, top, left run clockwise from ({x:g}, {y:g}); they must "
                "run counter-clockwise (are left and right exchanged?)"
            )

    def _ring(self) -> Floats:
        sides = (self.bottom, self.right, self.top.reversed(), self.left.reversed())
        return np.vstack([side.polyline()[:-1] for side in sides])

    @cached_property
    def outline(self) -> Polygon:
        """The domain as a polygon with holes, counter-clockwise; curved sides as fine polylines.

        Their chords leave a side by at most 3e-7 of its size.
        """
        return valid_polygon(self._ring(), self.holes)

    @property
    def corners(self) -> Floats:
        """The four corners at (xi, eta) = (0,0), (1,0), (1,1), (0,1), shape (4, 2), mm."""
        return np.stack([self.bottom.start, self.bottom.end, self.top.end, self.top.start])


def from_curves(
    bottom: Curve, right: Curve, top: Curve, left: Curve, *, holes: Iterable[Hole] = ()
) -> Patch:
    """The patch between four curves that close on each other, each run in either direction.

    A side is reversed where that makes it chain with its neighbours. `holes` are polygons, rings
    or points. Raises `InputError` as `Patch` does.

    >>> from fdjax.part.curve import arc
    >>> a, b, c, d = (0, 0), (4, 0), (4, 3), (0, 3)
    >>> patch = from_curves(polyline([a, b]), polyline([c, b]), arc(c, (2, 4), d), polyline([d, a]))
    >>> patch.right.start.tolist(), patch.right.end.tolist()
    ([4.0, 0.0], [4.0, 3.0])
    """

    def openness(sides: Sequence[Curve]) -> float:
        return sum(float(np.hypot(*(p - q))) for p, q in _meetings(*sides).values())

    ways = product(*((side, side.reversed()) for side in (bottom, right, top, left)))
    return Patch(*min(ways, key=openness), holes=_rings(holes))


def from_polygon(
    polygon: Polygon, *, corners: ArrayLike | None = None, smooth: bool = False
) -> Patch:
    """The patch of a polygon (mm, see `fdjax.part.contour`) cut at four corners; holes stay.

    - `corners`: four points on the outline, shape (4, 2), mm, counter-clockwise; the first is
      (xi, eta) = (0, 0), the second (1, 0). They may lie in the middle of an edge, and off the
      outline by up to 1e-4 of its size. By default they are chosen by the rule of
      `fdjax.part.corners.four_sides`: the outline's points nearest to the corners of its
      smallest rectangle, from the lower left one on.
    - `smooth`: run each side through a cubic spline of its points instead of a polyline.

    Polylines are parametrised by arc length, splines by the chord length of their points. Raises
    `InputError` for a polygon or corners that cannot be used, and for splines that cross.

    >>> from_polygon(Polygon([(0, 0), (3, 0), (3, 2), (0, 2)])).top.start.tolist()
    [0.0, 2.0]
    """
    valid = valid_polygon(polygon.exterior, polygon.interiors)
    curve = smooth_curve if smooth else polyline
    bottom, right, top, left = (curve(side) for side in four_sides(valid.exterior, corners))
    return Patch(bottom, right, top.reversed(), left.reversed(), holes=tuple(valid.interiors))


def _meetings(
    bottom: Curve, right: Curve, top: Curve, left: Curve
) -> dict[str, tuple[Floats, Floats]]:
    """The pairs of ends that must be the same point."""
    return {
        "bottom ends, right starts": (bottom.end, right.start),
        "right ends, top ends": (right.end, top.end),
        "left ends, top starts": (left.end, top.start),
        "bottom starts, left starts": (bottom.start, left.start),
    }


def _rings(holes: Iterable[Hole]) -> tuple[LinearRing, ...]:
    return tuple(closed_ring(hole, f"hole {k}") for k, hole in enumerate(holes, 1))


def rectangle(
    width: float,
    height: float,
    *,
    origin: tuple[float, float] = (0.0, 0.0),
    holes: Iterable[Hole] = (),
) -> Patch:
    """The rectangle of this width and height (mm) with its lower left corner at `origin`.

    `holes` are polygons, rings or points, in mm. Raises `InputError` for sizes that are not
    positive and for holes that are not inside and apart.

    >>> rectangle(80, 60).outline.area
    4800.0
    """
    if not (width > 0 and height > 0 and np.isfinite([width, height]).all()):
        raise InputError(f"rectangle: {width:g} x {height:g} mm; both must be positive")
    (x0, y0), (x1, y1) = origin, (origin[0] + width, origin[1] + height)
    return Patch(
        bottom=polyline([(x0, y0), (x1, y0)]),
        right=polyline([(x1, y0), (x1, y1)]),
        top=polyline([(x0, y1), (x1, y1)]),
        left=polyline([(x0, y0), (x0, y1)]),
        holes=_rings(holes),
    )


def cosine_top() -> Patch:
    """The domain of the paper's eq. (8) and Figure 6, in mm (the paper: microsteps of 0.001 in).

    x in [100, 3100], bottom y = 0, straight sides 2000 high, top
    `y = -1000 cos(2 pi (x - 100) / 3000) + 3000`, parametrised uniformly in x.
    """
    s = np.linspace(0, 1, 257)
    top = np.stack([100 + 3000 * s, 3000 - 1000 * np.cos(2 * np.pi * s)], 1)
    return Patch(
        bottom=polyline(MICROSTEP * np.array([(100, 0), (3100, 0)])),
        right=polyline(MICROSTEP * np.array([(3100, 0), (3100, 2000)])),
        top=spline(MICROSTEP * top, s),
        left=polyline(MICROSTEP * np.array([(100, 0), (100, 2000)])),
    )
