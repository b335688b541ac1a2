"""Rooms: what a layer's beads may fill, and the walls that centre lines keep to in it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, STRtree

from fdjax.errors import InputError
from fdjax.part.region import Region
from fdjax.plan.wall import Wall, free_region, rings

Floats = NDArray[np.float64]


SLIT = 1e-3
"""Width of a cut within a room, mm."""


@dataclass(frozen=True, eq=False)
class Walls:
    """The rings that centre lines of roads up to one width may reach but not cross.

    - `road_width`: the largest, mm.
    - `press`: a line beyond the free region by less than this share of the width is pressed back.
    - `free`: where centre lines may lie; `near`: the same and what is pressed back onto it.
    - `rings`: those of `free`; `outer`: those of `near`.
    """

    road_width: float
    press: float
    free: Polygon | MultiPolygon
    near: Polygon | MultiPolygon
    rings: tuple[Wall, ...]
    outer: tuple[Wall, ...]
    _deep: dict[float, Polygon | MultiPolygon] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls, geometry: Polygon | MultiPolygon, road_width: float, press: float, tolerance: float
    ) -> "Walls":
        free, near = (
            _simple(free_region(geometry, share * road_width), tolerance)
            for share in (0.5, 0.5 - press)
        )
        inner, outer = (tuple(Wall.of(ring) for ring in rings(each)) for each in (free, near))
        shapely.prepare([free, near])
        return cls(road_width, press, free, near, inner, outer)

    def deep(self, reach: float) -> Polygon | MultiPolygon:
        """What of the free region lies further than `reach` mm from every wall; may be empty."""
        # Rounded up, so that lines of like steps share it.
        key = 0.25 * np.ceil(reach / 0.25)
        if key not in self._deep:
            self._deep[key] = shapely.buffer(self.free, -key, quad_segs=2)
            shapely.prepare(self._deep[key])
        return self._deep[key]

    @cached_property
    def sides(self) -> "Sides":
        """All straight sides of both kinds of ring."""
        return Sides.of([*self.rings, *self.outer])


@dataclass(frozen=True, eq=False)
class Sides:
    """Straight sides of rings: from `a` to `b`, (n, 2), mm; `at` is the position of a on `ring`."""

    a: Floats
    b: Floats
    at: Floats
    ring: NDArray[np.intp]
    tree: STRtree

    @classmethod
    def of(cls, walls: list[Wall]) -> "Sides":
        a = np.concatenate([wall.xy[:-1] for wall in walls])
        b = np.concatenate([wall.xy[1:] for wall in walls])
        at = np.concatenate([wall.at[:-1] for wall in walls])
        ring = np.repeat(np.arange(len(walls)), [len(wall.xy) - 1 for wall in walls])
        tree = STRtree(np.asarray(shapely.linestrings(np.stack([a, b], 1))))
        return cls(a, b, at, ring, tree)


@dataclass(frozen=True, eq=False)
class Room:
    """What the beads of a layer may fill, and its walls, made once for each road width.

    - `geometry`: polygons with holes, mm.
    - `tolerance`: points of walls within this of a straight side are dropped, mm.

    >>> room = Room.of([(0, 0), (4, 0), (4, 3), (0, 3)])
    >>> round(room.walls(0.4).free.area, 6)
    9.36
    """

    geometry: Polygon | MultiPolygon
    tolerance: float = 0.0
    _made: dict[tuple[float, float], Walls] = field(default_factory=dict, repr=False)
    _shrunk: dict[float, "Room | None"] = field(default_factory=dict, repr=False)
    _parted: dict[tuple[int, ...], tuple["Room", tuple[Floats, ...]]] = field(
        default_factory=dict, repr=False
    )

    @classmethod
    def of(cls, source: object, *, clearance: float = 0.0, tolerance: float = 0.0) -> "Room":
        """The room of what `Region.of` takes, less `clearance` (mm) along its walls.

        Raises what `Region.of` raises, and `InputError` where nothing is left.
        """
        if isinstance(source, Room):
            return source
        region = Region.of(source)
        if clearance <= 0:
            return cls(region.geometry, tolerance)
        room = shapely.buffer(region.geometry, -clearance, join_style="mitre")
        if room.is_empty:
            raise InputError(f"outline: nothing is left when shrunk by {clearance:g} mm")
        return cls(room, tolerance)

    def parted(self, cuts: Sequence[Floats]) -> "Room":
        """The room with walls along these polylines, (points, 2), mm, besides its own."""
        if not len(cuts):
            return self
        key = tuple(id(cut) for cut in cuts)
        if key not in self._parted:
            lines = shapely.line_merge(shapely.union_all([shapely.LineString(c) for c in cuts]))
            slit = shapely.buffer(lines, SLIT / 2, cap_style="flat", join_style="mitre")
            # The cuts are kept, so that their identities stay theirs.
            parted: Any = self.geometry.difference(slit)
            self._parted[key] = Room(parted, self.tolerance), tuple(cuts)
        return self._parted[key][0]

    def shrunk(self, margin: float) -> "Room | None":
        """What of the room is further than `margin`, mm, from its walls; None for nothing."""
        if margin <= 0:
            return self
        if margin not in self._shrunk:
            inner: Any = shapely.buffer(self.geometry, -margin, join_style="mitre")
            self._shrunk[margin] = None if inner.is_empty else Room(inner, self.tolerance)
        return self._shrunk[margin]

    def walls(self, road_width: float, press: float = 0.0) -> Walls:
        """The walls for roads up to this width, mm. Raises `InputError` where none fits."""
        key = road_width, press
        if key not in self._made:
            self._made[key] = Walls.of(self.geometry, road_width, press, self.tolerance)
        return self._made[key]


def _simple(region: Polygon | MultiPolygon, tolerance: float) -> Polygon | MultiPolygon:
    """With fewer vertices, where the rings stay apart."""
    if tolerance <= 0:
        return region
    fewer = shapely.simplify(region, tolerance, preserve_topology=False)
    if not fewer.is_valid or fewer.is_empty:
        fewer = shapely.simplify(region, tolerance, preserve_topology=True)
    return fewer if fewer.is_valid and isinstance(fewer, Polygon | MultiPolygon) else region
