"""What one layer fills: polygons with holes, in mm."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from shapely import MultiPolygon, Polygon, get_precision, set_precision

from fdjax.errors import InputError
from fdjax.part import neck
from fdjax.part.contour import contours
from fdjax.part.neck import Neck
from fdjax.part.ring import MERGED, STRAIGHT, Hole


@dataclass(frozen=True, eq=False)
class Region:
    """What one layer fills: one or more polygons with holes, apart from each other, mm.

    - `polygons`: outlines counter-clockwise, holes clockwise.
    - `notes`: what was left out of them when they were read, a line for each ring.

    >>> Region.of([(0, 0), (4, 0), (4, 3), (0, 3)]).area
    12.0
    """

    polygons: tuple[Polygon, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # The grid of one geometry would rule whatever is done with another.
        free = (p if get_precision(p) == 0 else set_precision(p, 0) for p in self.polygons)
        object.__setattr__(self, "polygons", tuple(free))

    @classmethod
    def of(
        cls,
        source: Any,
        *,
        holes: Iterable[Hole] = (),
        unit: str = "mm",
        merged: float = MERGED,
    ) -> "Region":
        """The region of one or more polygons.

        - `source`: a Shapely polygon or multipolygon; WKT text of one; GeoJSON as text or as a
          mapping (Polygon, MultiPolygon, Feature, FeatureCollection); a file that holds either;
          points of one outline, shape (n, 2); or a region. A string that is neither WKT nor
          GeoJSON is a file name.
        - `holes`: more holes, each a polygon, a ring or points, in the polygon they lie in.
        - `unit`: of all coordinates, holes included: any unit of `fdjax.units`.
        - `merged`: points nearer than this to the one before are left out, mm.

        So are those from which the outline without them is nowhere further than 1e-9 of its size;
        `notes` says how many. Third coordinates and precision grids are dropped.

        Raises `InputError`, with the place, for what `fdjax.part.contour.contour` refuses, and for
        polygons that overlap or touch along an edge; they may touch in points.

        >>> strip = Region.of([(0, 0), (1, 0), (2, 0), (2, 0), (2, 1), (0, 1)])
        >>> strip.notes
        ('outline: 1 repeated and 1 collinear points left out',)
        """
        more = list(holes)
        if isinstance(source, Region):
            if not more and unit == "mm":
                return source
            source = source.geometry
        return cls(*contours(source, holes=more, unit=unit, straight=STRAIGHT, merged=merged))

    @cached_property
    def geometry(self) -> Polygon | MultiPolygon:
        """The region as one geometry: a polygon where there is only one."""
        return self.polygons[0] if len(self.polygons) == 1 else MultiPolygon(self.polygons)

    @property
    def area(self) -> float:
        """mm^2, holes taken off."""
        return self.geometry.area

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least x and y, largest x and y, mm."""
        return self.geometry.bounds

    def inset(self, margin: float) -> Polygon | MultiPolygon:
        """What of the region is at least `margin` mm away from its walls; may fall apart.

        Offset with mitred joins, so that straight sides keep their corners; where a notch is
        sharper than 84 degrees the corner is cut off 1.5 margins from its tip. Raises `InputError`
        when nothing is left, and for a margin that is negative.

        >>> Region.of([(0, 0), (4, 0), (4, 3), (0, 3)]).inset(1).area
        2.0
        """
        if not (np.isfinite(margin) and margin >= 0):
            raise InputError(f"margin: {margin:g} mm; it must not be negative")
        if margin == 0:
            return self.geometry
        parts = neck.inset(self.geometry, margin)
        if not parts:
            x, y, width, _ = neck.widest(self.geometry)
            raise InputError(
                f"outline: nowhere wide enough for a road {2 * margin:g} mm wide; "
                f"its widest place, near ({x:.4g}, {y:.4g}), is {width:.4g} mm wide"
            )
        return parts[0] if len(parts) == 1 else MultiPolygon(parts)

    def necks(self, width: float) -> list[Neck]:
        """The places, (x, y, local width, depth) in mm, too thin for a road of this width.

        They are passages on which the inset by half the width comes apart, or a loop opens, at
        their narrowest; and polygons that vanish and arms that are lost for more than a width's
        length, at their widest. A corner of 39 degrees or blunter is no arm. Beside the tips of
        sharp notches, where `inset` cuts off more than half the width, a passage may be named that
        is wider, by 80 % at most.

        >>> [place] = Region.of([(0, 0), (9, 0), (9, 0.3), (3, 0.3), (3, 3), (0, 3)]).necks(0.5)
        >>> round(place.width, 2)
        0.3
        """
        if not (np.isfinite(width) and width > 0):
            raise InputError(f"width: {width:g} mm; it must be positive")
        return [place for polygon in self.polygons for place in neck.necks(polygon, width)]
