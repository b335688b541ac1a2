"""What one layer fills: polygons with holes, in mm."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import shapely
from shapely import MultiPolygon, Polygon

from fdjax.errors import InputError
from fdjax.part.contour import Hole, contour, valid_polygon


@dataclass(frozen=True, eq=False)
class Region:
    """What one layer fills: one or more polygons with holes, apart from each other, mm.

    - `polygons`: outlines counter-clockwise, holes clockwise.

    >>> Region.of([(0, 0), (4, 0), (4, 3), (0, 3)]).area
    12.0
    """

    polygons: tuple[Polygon, ...]

    @classmethod
    def of(cls, source: Any, *, holes: Iterable[Hole] = (), unit: str = "mm") -> "Region":
        """The region of a Shapely polygon or multipolygon, of WKT, GeoJSON, a file or points.

        Takes what `fdjax.part.contour.contour` takes, and raises what it raises.
        """
        if isinstance(source, Region):
            return source
        if isinstance(source, MultiPolygon):
            parts = [valid_polygon(part.exterior, part.interiors) for part in source.geoms]
            if not parts:
                raise InputError("region: holds no polygon")
            return cls(tuple(parts))
        return cls((contour(source, holes=holes, unit=unit),))

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

        Offset with mitred joins, so that straight sides keep their corners. Raises `InputError`
        when nothing is left.
        """
        room = shapely.buffer(self.geometry, -margin, join_style="mitre")
        if room.is_empty or not isinstance(room, Polygon | MultiPolygon):
            raise InputError(f"outline: nowhere wide enough for a road {2 * margin:g} mm wide")
        return room
