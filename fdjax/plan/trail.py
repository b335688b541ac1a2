"""A graph as continuous roads: cut at the walls, each edge laid once, little travel between."""

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon

from fdjax.errors import InputError
from fdjax.part.region import Region
from fdjax.plan.cut import SHORTEST
from fdjax.plan.euler import trails
from fdjax.plan.laid import Laid, shortest_road
from fdjax.plan.room import Room, Walls
from fdjax.plan.toolpath import NO_NODES, Road
from fdjax.road.stroke import Graph

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_BEYOND = 0.01
"""An edge to a node at a wall may lie beyond the wall by this share of a road's width."""


def lay_graph(
    graph: Graph,
    room: Room | Region | Polygon | MultiPolygon,
    *,
    lift_length: float = 0.0,
    longest_join: float | None = None,
    least_spacing: float | None = None,
    least_road: float = 0.0,
    tolerance: float = 0.0,
    start: ArrayLike | None = None,
) -> Laid:
    """Lay each edge of a graph once as roads inside a room.

    Edges are cut where their centre would come nearer to a wall than half the largest road width.
    Edges shorter than wide are contracted where three or more meet at both ends. Roads go on
    through nodes as straight as may be, across each other there unless the graph says that they may
    not.

    - `least_road`: shorter roads are not laid, mm; nor any of less than `SHORTEST_ROAD` widths.
    - `tolerance`: what dropping points may take off a road, mm; no node is dropped.
    - `start`: where the head comes from; the roads start near it.
    - `lift_length`, `longest_join`, `least_spacing`: of lines; edges are neither joined along
      walls nor thinned.

    Returns the roads in the order in which they are laid, and as roads what was left out.
    Raises `InputError` for edges that do not fit, and for no room for a road.

    >>> square = Graph(np.array([(1.0, 1), (3, 1), (3, 3), (1, 3)]),
    ...     np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)]), np.full(5, 0.4), "mesh")
    >>> [road.length.__round__(3) for road in lay_graph(square, shapely.box(0, 0, 4, 4)).roads]
    [10.828]
    """
    xy, edges, width = checked(graph)
    if not len(edges):
        return Laid()
    within = Room.of(room).shrunk(graph.margin)
    if within is None:
        return Laid()
    walls = within.walls(float(width.max()))
    xy, edges, width = _cut(*_contracted(xy, edges, width), walls)
    roads = [
        Road(xy[nodes], width[list(own)], graph.material, closed, graph.family)
        for nodes, own, closed in trails(xy, edges, crossing=graph.crossing)
    ]
    shortest = [shortest_road(road.width, least_road + tolerance) for road in roads]
    return Laid.of(roads, shortest, start=start)


def checked(graph: Graph) -> tuple[Floats, Ints, Floats]:
    """Nodes, edges and widths as arrays; raises `InputError` where they do not fit together."""
    xy, edges = np.asarray(graph.xy, float), np.asarray(graph.edges)
    width = np.asarray(graph.width, float)
    if xy.ndim != 2 or xy.shape[1] != 2 or not np.isfinite(xy).all():
        raise InputError("graph: nodes must be finite, shape (nodes, 2)")
    if edges.ndim != 2 or edges.shape[1] != 2 or edges.dtype.kind != "i":
        raise InputError("graph: edges must be whole numbers, shape (edges, 2)")
    if edges.size and not 0 <= edges.min() <= edges.max() < len(xy):
        raise InputError(f"graph: edges name nodes beyond the {len(xy)} that there are")
    if width.shape != (len(edges),) or not (np.isfinite(width) & (width > 0)).all():
        raise InputError(f"graph: needs {len(edges)} positive widths, one an edge")
    if graph.family in NO_NODES:
        raise InputError(f'graph: "{graph.family}" is a family of lines; name it otherwise')
    return xy, edges, width


def _contracted(xy: Floats, edges: Ints, width: Floats) -> tuple[Floats, Ints, Floats]:
    """The graph without edges shorter than wide between nodes where three or more meet.

    The two become one node in their middle: the roads beside such an edge would lie on each other.
    """
    degree = np.bincount(edges.ravel(), minlength=len(xy))
    short = np.hypot(*(xy[edges[:, 1]] - xy[edges[:, 0]]).T) < width
    short &= (degree[edges] > 2).all(1)
    xy, number = _merged(xy, edges[short])
    return xy, number[edges[~short]], width[~short]


def _merged(xy: Floats, near: Ints) -> tuple[Floats, Ints]:
    """Points of which these pairs become one, in their middle, and the new number of each."""
    # Loaded here, as lines do without: it takes longer than to lay them.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairing = coo_array((np.ones(len(near)), tuple(near.T)), shape=(len(xy), len(xy)))
    count, number = connected_components(pairing, directed=False)
    size = np.bincount(number, minlength=count)
    middle = [np.bincount(number, along, count) for along in xy.T]
    return np.stack(middle, 1) / size[:, None], number.astype(int)


def _cut(xy: Floats, edges: Ints, width: Floats, walls: Walls) -> tuple[Floats, Ints, Floats]:
    """The graph inside the walls: edges cut, their ends there brought together, bits left out."""
    nodes = len(xy)
    xy, edges, width = _clipped(xy, edges, width, walls.free, walls)
    used = np.unique(edges)
    inner = used[used < nodes]
    boundary = walls.free.boundary
    close = shapely.dwithin(boundary, shapely.points(xy[inner]), walls.road_width)
    moved = np.concatenate([inner[close], np.arange(nodes, len(xy))])
    together, number = _together(xy[moved], walls)
    renamed = np.arange(len(xy))
    renamed[moved] = len(xy) + number
    edges = renamed[edges]
    # Of edges that have come to join the same two nodes one is laid.
    once = np.unique(np.sort(edges, axis=1), axis=0, return_index=True)[1]
    once = once[edges[once, 0] != edges[once, 1]]
    # Edges to nodes that have moved may now cross a wall that bulges; there they end a road early,
    # off those that end at the wall.
    beyond = shapely.buffer(walls.free, _BEYOND * walls.road_width, quad_segs=2)
    xy = np.concatenate([xy, together])
    return _clipped(xy, edges[once], width[once], beyond, walls, early=walls.road_width)


def _clipped(
    xy: Floats,
    edges: Ints,
    width: Floats,
    free: Polygon | MultiPolygon,
    walls: Walls,
    *,
    early: float = 0.0,
) -> tuple[Floats, Ints, Floats]:
    """The graph inside a region, with a new node, behind the others, wherever an edge is cut.

    - `early`: what an edge that is cut loses beyond that, mm.
    """
    start, end = xy[edges[:, 0]], xy[edges[:, 1]]
    length = np.hypot(*(end - start).T)
    # Most edges lie too deep in the room to reach a wall.
    deep = walls.deep(float(length.max(initial=0.0)))
    suspect = np.flatnonzero(~shapely.contains_xy(deep, *start.T))
    whole = np.setdiff1d(np.arange(len(edges)), suspect)
    lines = shapely.linestrings(np.stack([start[suspect], end[suspect]], 1))
    parts, of = shapely.get_parts(shapely.intersection(lines, free), return_index=True)
    straight = shapely.length(parts) > 0
    parts, owner = parts[straight], suspect[of[straight]]
    ends = shapely.get_coordinates(parts).reshape(-1, 2, 2)
    along = (end - start)[owner]
    share = ((ends - start[owner, None]) * along[:, None]).sum(2) / (length[owner] ** 2)[:, None]
    # An end where the edge itself ends is that node still; any other is a new one.
    cut = (share > 1e-9) & (share < 1 - 1e-9)
    node = np.where(share > 0.5, edges[owner, 1:], edges[owner, :1])
    node[cut] = len(xy) + np.arange(cut.sum())
    left = shapely.length(parts) - early * cut.sum(1)
    long = (~cut.any(1) | (left >= SHORTEST * width[owner])) & (node[:, 0] != node[:, 1])
    back = np.array([[1.0], [-1.0]]) * along[:, None] / length[owner, None, None]
    ends = ends + early * back
    return (
        np.concatenate([xy, ends[cut]]),
        np.concatenate([edges[whole], node[long]]),
        np.concatenate([width[whole], width[owner[long]]]),
    )


def _together(ends: Floats, walls: Walls) -> tuple[Floats, Ints]:
    """Ends at the walls and nodes near them, (n, 2), as nodes, and the node of each, (n,).

    Those nearer to each other than a road is wide become one, or the roads that end there would lie
    on one another: so do those cut short of a node that is just beyond.
    """
    if not len(ends):
        return ends, np.zeros(0, int)
    from scipy.spatial import KDTree

    near = KDTree(ends).query_pairs(walls.road_width, output_type="ndarray")
    middle, number = _merged(ends, near)
    to_room = shapely.shortest_line(walls.free, shapely.points(middle))
    return shapely.get_coordinates(to_room).reshape(-1, 2, 2)[:, 0], number
