"""What a machine is asked to lay down: roads in layers in a build. Frozen data, NumPy only."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon, STRtree, get_precision, points, set_precision

from fdjax.errors import InputError
from fdjax.road.bead import section_area
from fdjax.road.stroke import Subdomain

Floats = NDArray[np.float64]
Outline = Polygon | MultiPolygon
"""What a layer fills, holes included, mm."""


def _frozen(values: ArrayLike) -> Floats:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


NO_NODES = ("", "xi", "eta", "curve", "polygon", "raster", "contour")
"""Families of roads that are no edges of graphs."""


@dataclass(frozen=True, eq=False)
class Road:
    """One continuous deposit, from flow on to flow off.

    - `xy`: centre line, shape (points, 2), mm in the part's coordinates; at least two points.
      A closed road does not repeat its first point.
    - `width`: road width of each segment, shape (segments,), mm.
    - `material`: number of the material or tool, from 0.
    - `closed`: whether the last point runs on to the first.
    - `family`: "xi" or "eta" where the road follows grid lines of one family, "curve" for a
      part of a curve, "polygon" for a face of a graph, "raster" and "contour" in sub-domains, ""
      for no family; any other name where it follows edges of a graph, which may meet at its points.
    - `section`: area of each segment's section, shape (segments,), mm^2, where it is not the one
      of `section_area` in a layer's height. `role`: what a slicer says that the road is.

    Raises `InputError` when the shapes do not fit together or a value is not finite.
    """

    xy: Floats
    width: Floats
    material: int = 0
    closed: bool = False
    family: str = ""
    section: Floats | None = None
    role: str = ""

    def __post_init__(self) -> None:
        xy = _frozen(self.xy)
        if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 2:
            raise InputError(f"road: points have shape {xy.shape}; (points, 2), at least two")
        segments = len(xy) - (not self.closed)
        width = np.asarray(self.width, float)
        if width.shape != (segments,):
            width = np.broadcast_to(width, (segments,))
        width = _frozen(width)
        if not (np.isfinite(xy).all() and np.isfinite(width).all()):
            raise InputError("road: points and widths must be finite")
        object.__setattr__(self, "xy", xy)
        object.__setattr__(self, "width", width)
        if self.section is not None:
            section = np.broadcast_to(np.asarray(self.section, float), (segments,))
            object.__setattr__(self, "section", _frozen(section))

    @property
    def path(self) -> Floats:
        """Centre line with the closing point repeated where closed, shape (segments + 1, 2)."""
        return np.vstack([self.xy, self.xy[:1]]) if self.closed else self.xy

    @property
    def segment_lengths(self) -> Floats:
        """Length of each segment, shape (segments,), mm."""
        return np.hypot(*np.diff(self.path, axis=0).T)

    @property
    def length(self) -> float:
        """Length of the centre line, mm."""
        return float(self.segment_lengths.sum())

    def areas(self, height: float) -> Floats:
        """Section of each segment in a layer of this height, shape (segments,), mm^2."""
        return section_area(self.width, height) if self.section is None else self.section

    @property
    def of_graph(self) -> bool:
        """Whether the road follows edges of a graph."""
        return self.family not in NO_NODES

    def segment_volumes(self, height: float) -> Floats:
        """Deposited volume of each segment in a layer of this height, shape (segments,), mm^3."""
        return self.areas(height) * self.segment_lengths


def lengths_of(roads: Sequence[Road]) -> Floats:
    """Length of the centre line of each road, shape (roads,), mm.

    >>> lengths_of([Road([(0, 0), (3, 4)], 0.4), Road([(0, 0), (0, 2)], 0.4)]).tolist()
    [5.0, 2.0]
    """
    if not roads:
        return np.zeros(0)
    paths = [road.path for road in roads]
    steps = np.hypot(*np.diff(np.concatenate(paths), axis=0).T)
    first = np.cumsum([0, *(len(path) for path in paths)])
    steps[first[1:-1] - 1] = 0.0  # from one road to the next
    return np.add.reduceat(steps, first[:-1])


@dataclass(frozen=True, eq=False)
class Roads(Sequence[Road]):
    """Many roads in flat arrays; each becomes a `Road` when it is asked for.

    - `points`: of all paths, one after the other, shape (points, 2); a closed road's last repeats
      its first. `first`: index of each road's first point, and their number, shape (roads + 1,).
    - `width`, `section`: of each segment, shape (points - roads,); `section` may be None.
    - `material`, `closed`, `family`, `role`: of each road; the last two are indices of `names`.
    """

    points: Floats
    first: NDArray[np.intp]
    width: Floats
    material: NDArray[np.integer]
    closed: NDArray[np.bool_]
    family: NDArray[np.integer]
    role: NDArray[np.integer]
    names: tuple[str, ...]
    section: Floats | None = None

    def __len__(self) -> int:
        return len(self.first) - 1

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return tuple(self[k] for k in range(*index.indices(len(self))))
        k = range(len(self))[index]
        begin, end = int(self.first[k]), int(self.first[k + 1])
        own = slice(begin - k, end - k - 1)
        closed = bool(self.closed[k])
        return Road(
            self.points[begin : end - closed],
            self.width[own],
            int(self.material[k]),
            closed,
            self.names[self.family[k]],
            None if self.section is None else self.section[own],
            self.names[self.role[k]],
        )

    def __iter__(self) -> Iterator[Road]:
        return map(self.__getitem__, range(len(self)))

    @property
    def owner(self) -> NDArray[np.intp]:
        """Index of the road of each segment."""
        return np.repeat(np.arange(len(self)), np.diff(self.first) - 1)

    @property
    def lengths(self) -> Floats:
        """Of each segment, shape (segments,), mm."""
        run, rise = np.diff(self.points, axis=0).T
        # Between two roads is no segment.
        return np.delete(np.sqrt(run * run + rise * rise), self.first[1:-1] - 1)


@dataclass(frozen=True, eq=False)
class Layer:
    """Roads laid at one height, in the order in which they are laid.

    - `z`: top of the layer above the bed, mm; `height`: its thickness, mm.
    - `outline`: what the layer is to fill, one or several polygons with their holes, or None where
      a file does not say.
    - `thinned`: volume of lines that were left out because others lie too near, mm^3.
    - `subdomains`: that the layer falls into, each filled in its own way; none where it is whole.

    Raises `InputError` for an outline of another kind.
    """

    z: float
    height: float
    roads: Sequence[Road]
    outline: Outline | None = None
    thinned: float = 0.0
    subdomains: tuple[Subdomain, ...] = ()

    def __post_init__(self) -> None:
        outline = self.outline
        if outline is None:
            return
        if not isinstance(outline, Polygon | MultiPolygon):
            kind = getattr(outline, "geom_type", type(outline).__name__)
            raise InputError(f"layer: the outline is a {kind}; a Polygon or MultiPolygon is needed")
        if get_precision(outline) > 0:
            # The grid of one geometry would rule whatever is done with another.
            object.__setattr__(self, "outline", set_precision(outline, 0))

    @cached_property
    def road_volumes(self) -> Floats:
        """Deposited volume of each road, shape (roads,), mm^3; what overlaps counts twice."""
        roads = self.roads
        if isinstance(roads, Roads) and len(roads):
            section = section_area(roads.width, self.height)
            section = section if roads.section is None else roads.section
            begin = roads.first[:-1] - np.arange(len(roads))
            return np.add.reduceat(section * roads.lengths, begin)
        return np.array([road.segment_volumes(self.height).sum() for road in roads], float)

    @property
    def volume(self) -> float:
        """Deposited volume, mm^3; what overlaps counts twice."""
        return float(self.road_volumes.sum())

    @property
    def materials(self) -> NDArray[np.integer]:
        """Material of each road, shape (roads,)."""
        roads = self.roads
        if isinstance(roads, Roads):
            return roads.material
        return np.array([road.material for road in roads], int)

    @cached_property
    def owners(self) -> NDArray[np.intp]:
        """Number of the sub-domain that each road lies in, shape (roads,); 0 in a whole layer."""
        if len(self.subdomains) < 2:
            return np.zeros(len(self.roads), np.intp)
        starts = points([road.xy[0] for road in self.roads])
        outlines = np.array([some.outline for some in self.subdomains])
        return np.asarray(STRtree(outlines).nearest(np.asarray(starts)), np.intp)

    @property
    def travel(self) -> float:
        """Length moved without deposit between the layer's roads, mm."""
        roads = self.roads
        if isinstance(roads, Roads):
            jumps = roads.points[roads.first[1:-1]] - roads.points[roads.first[1:-1] - 1]
            return float(np.hypot(*jumps.T).sum())
        ends = [road.path[-1] for road in self.roads[:-1]]
        starts = [road.path[0] for road in self.roads[1:]]
        return float(sum(np.hypot(*(b - a)) for a, b in zip(ends, starts, strict=True)))


@dataclass(frozen=True, eq=False)
class Build:
    """Everything that one machine file holds.

    - `layers`: from the bed upwards.
    - `name`: of the part.
    - `origin`: where the part's (0, 0) lies on the machine's bed, mm. Roads and outlines are in
      the part's coordinates; writers add the origin, readers take it off again.
    - `notes`: header facts as text, kept in the file's comments (the target, for one).
    - `reading`: how a file was read where it leaves something open, by what was open.
    """

    layers: tuple[Layer, ...]
    name: str = "part"
    origin: tuple[float, float] = (0.0, 0.0)
    notes: Mapping[str, str] = field(default_factory=dict)
    reading: Mapping[str, str] = field(default_factory=dict)

    @property
    def volume(self) -> float:
        """Deposited volume, mm^3; what overlaps counts twice."""
        return sum(layer.volume for layer in self.layers)

    @property
    def thinned(self) -> float:
        """Volume of lines that were left out because others lie too near, mm^3."""
        return sum(layer.thinned for layer in self.layers)

    def deposits(self, step: float) -> tuple[Floats, Floats]:
        """The roads in pieces no longer than `step` mm: middles (n, 3), mm, and volumes (n,), mm^3.

        A piece's z is the middle of its layer.
        """
        places, volumes = [np.zeros((0, 3))], [np.zeros(0)]
        for layer in self.layers:
            for road in layer.roads:
                path, length = road.path, road.segment_lengths
                count = np.maximum(np.ceil(length / step), 1).astype(int)
                owner = np.repeat(np.arange(len(count)), count)
                number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
                share = ((number + 0.5) / count[owner])[:, None]
                xy = (1 - share) * path[:-1][owner] + share * path[1:][owner]
                z = np.full((len(xy), 1), layer.z - layer.height / 2)
                places.append(np.concatenate([xy, z], 1))
                volumes.append((road.segment_volumes(layer.height) / count)[owner])
        return np.concatenate(places), np.concatenate(volumes)

    def replace(self, **changes: Any) -> "Build":
        """A copy with some fields changed."""
        return replace(self, **changes)
