"""Lines across a convex room: each crosses it in one piece, so all of them are one path.

Loads no JAX.
"""

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

INSIDE = 1e-6
"""Rounding of what lies inside, mm."""

_CONVEX = 1e-12
"""Share of its area by which a convex outline may differ from its hull."""


class Zigzags(NamedTuple):
    """Lines along x from one side of a room to the other, each turned to the next at an end.

    - `left`, `right`, `y`: of the lines, (lines,), mm.
    - `path`: number of the path that each belongs to, (lines,), rising.
    - `at_right`: the end at which it turns, or ends, (lines,).
    - `turns`: length of the way to the next line, 0 for a path's last, (lines,), mm.
    """

    left: Floats
    right: Floats
    y: Floats
    path: Ints
    at_right: NDArray[np.bool_]
    turns: Floats

    def points(self) -> Floats:
        """Corners of all lines, one after the other, (2 lines, 2), mm."""
        x = np.stack([self.left, self.right], 1)
        x[~self.at_right] = x[~self.at_right, ::-1]
        return np.column_stack([x.ravel(), np.repeat(self.y, 2)])

    def lengths(self, paths: int) -> Floats:
        """Of so many paths, turns included, (paths,), mm."""
        return np.bincount(self.path, self.right - self.left + self.turns, paths).astype(float)


class Sides:
    """The left and the right side of a convex outline, from its lowest to its highest corners."""

    def __init__(self, outline: shapely.Polygon) -> None:
        xy = shapely.get_coordinates(shapely.orient_polygons(outline))[:-1]
        lowest = xy[:, 1] == xy[:, 1].min()
        # From the lowest corner furthest to the right, counter-clockwise.
        xy = np.roll(xy, -int(np.flatnonzero(lowest & ~np.roll(lowest, -1))[0]), 0)
        highest = np.flatnonzero(xy[:, 1] == xy[:, 1].max())
        down = xy[highest[-1] :] if lowest.sum() > 1 else np.vstack([xy[highest[-1] :], xy[:1]])
        self._x, self._y = zip(
            *(side.T for side in (down[::-1], xy[: highest[0] + 1])), strict=True
        )

    @classmethod
    def of(cls, outline: Any) -> "Sides | None":
        """None for an outline that is not convex."""
        if not isinstance(outline, shapely.Polygon) or outline.interiors or outline.is_empty:
            return None
        if outline.convex_hull.area - outline.area > _CONVEX * outline.area:
            return None
        return cls(outline)

    def zigzags(self, y: Floats, path: Ints, longest: float) -> Zigzags | None:
        """Lines at these heights, mm, of one path or of several, those of each rising; or None
        where a turn would be longer than `longest`, mm.

        The first turn of a path is the shorter of the two that are possible; then they alternate.
        """
        left, right = (np.interp(y, *side) for side in zip(self._y, self._x, strict=True))
        long = right - left > INSIDE
        left, right, y, path = left[long], right[long], y[long], path[long]
        on = path[1:] == path[:-1]
        ways = np.zeros((2, len(y)))
        ways[:, :-1] = on * np.hypot(np.diff(np.stack([left, right])), np.diff(y))
        if ways.max(initial=0.0) > longest:
            return None
        begin = np.flatnonzero(np.append(True, ~on)[: len(y)])
        lines = np.diff(np.append(begin, len(y)))
        nth = np.arange(len(y)) - np.repeat(begin, lines)
        at_right = (nth % 2 == 0) == np.repeat(ways[1, begin] <= ways[0, begin], lines)
        return Zigzags(left, right, y, path, at_right, np.where(at_right, ways[1], ways[0]))
