"""What a pattern wants laid on one layer, before clipping and joining. Loads no JAX.

Each kind of stroke is one class here and one file in `fdjax.plan`, which says how it is laid.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LONGEST_JOIN = 25.0
"""Lines whose ends lie further apart along a wall than this are not joined unless asked, mm."""

APART = 0.7
"""Beyond its own turn a join keeps so many road widths from centre line to centre line."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of one family: level sets of one function, each of one level, clipped where it ends.

    - `family`: "xi" or "eta"; `parity`: as in `road.stacking.Scan`.
    - `level`: of each polyline, whole numbers that count the function's level sets in order, shape
      (lines,). Several polylines may share one level. All run the same way round: the higher
      levels lie on the left of each, or on the right of each.
    - `xy`: each polyline, shape (points, 2), mm; `width`: of each segment, shape (points - 1,), mm.
    - `material`: number of the material or tool.
    - `press`: a line beyond the walls by less than this share of the road width is pressed back,
      for lines that run along a wall but for rounding.
    - `cuts`: polylines within the layer that lines do not cross, shapes (points, 2), mm: they end
      there and are joined along it as along walls.
    """

    family: str
    parity: int
    level: NDArray[np.intp]
    xy: Sequence[Floats]
    width: Sequence[Floats]
    material: int = 0
    press: float = 0.02
    cuts: Sequence[Floats] = ()


@dataclass(frozen=True, eq=False)
class Graph:
    """Straight edges between nodes, each to be laid once, cut where a layer ends.

    - `xy`: of the nodes, shape (nodes, 2), mm.
    - `edges`: the two nodes of each edge, numbers from 0, shape (edges, 2).
    - `width`: of each edge, shape (edges,), mm.
    - `family`: a name that is neither "" nor a family of lines: roads of a graph meet in its nodes.
    - `material`: number of the material or tool.
    - `margin`: what edges keep from the walls beside half a road's width, mm.
    - `crossing`: whether roads may run across each other in nodes; else they touch there at most.
    """

    xy: Floats
    edges: NDArray[np.intp]
    width: Floats
    family: str
    material: int = 0
    margin: float = 0.0
    crossing: bool = True


@dataclass(frozen=True, eq=False)
class Drawing(Graph):
    """A graph that repeats a unit cell: laid with few short roads, each straight on if it can."""


@dataclass(frozen=True, eq=False)
class Polygons(Graph):
    """A graph whose faces are laid, each as a closed road inside its edges, not the edges."""


@dataclass(frozen=True, eq=False)
class Rings:
    """Closed roads along all walls of a layer, half a road from them.

    - `width`: mm; `family`: name of the roads; `material`: number of the material or tool.
    """

    width: float
    family: str
    material: int = 0


@dataclass(frozen=True, eq=False)
class Curve:
    """One road through a lattice of nodes, in squares of four that it goes through in some order.

    - `xy`: of the nodes, shape (2 n, 2 m, 2), mm, nan where there is none.
    - `rank`: of each square along the curve, whole numbers, shape (n, m).
    - `width`: at each node, shape (2 n, 2 m), mm.
    - `family`: name of the roads; `material`: number of the material or tool.
    - `finer`: the same with four squares for each, which has nodes where this has none.
    """

    xy: Floats
    rank: NDArray[np.intp]
    width: Floats
    family: str
    material: int = 0
    finer: "Curve | None" = None

    @property
    def levels(self) -> "list[Curve]":
        """This and what is finer, each a curve of its own."""
        return [self, *(self.finer.levels if self.finer is not None else ())]


@dataclass(frozen=True, eq=False)
class Subdomain:
    """A part of a layer and how it is filled, as a slice file says it.

    - `outline`: polygons with holes, mm; `fill`: "raster" or "contour".
    - `angle`: of the rasters with the x axis, degrees; `road_width`, `air_gap`: mm; `perimeters`:
      closed roads along its sides.
    """

    outline: Any
    fill: str
    angle: float
    road_width: float
    air_gap: float
    perimeters: int


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths that are joined and keep to the walls already, of one sub-domain.

    - `closed`: each (points, 2), mm, the first point not repeated; `open`: likewise.
    - `width`: of all, mm; `family`: name of the roads; `material`: number of the material or tool.
    """

    closed: Sequence[Floats]
    open: Sequence[Floats]
    width: float
    subdomain: Subdomain
    family: str
    material: int = 0


Stroke = Lines | Graph | Drawing | Polygons | Rings | Curve | Paths
