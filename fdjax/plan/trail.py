"""A graph as continuous roads: cut at the walls, each edge laid once, little travel between.

The Chinese postman's way (Edmonds and Johnson 1973): where an odd number of edges meets a road
must begin or end; these nodes are paired with little distance, and with travel between the two of
a pair all edges lie on closed ways (Euler). Roads are what is left of these without the travel.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon

from fdjax.errors import InputError
from fdjax.part.region import Region
from fdjax.plan.cut import SHORTEST
from fdjax.plan.laid import Laid, shortest_road
from fdjax.plan.pairing import pairs
from fdjax.plan.room import Room, Walls
from fdjax.plan.toolpath import NO_NODES, Road
from fdjax.road.stroke import Graph

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_BEYOND = 0.01
"""An edge to a node at a wall may lie beyond the wall by this share of a road's width."""

_ALONE = 10.0
"""What an edge that begins and ends in one road of its own costs, beside the turns that it saves:
a turn costs 1 + cos of the angle between its sides, 0 straight on, 2 turning back."""

_AGAIN = 4
"""So often nodes with such an edge are looked at once more."""


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
    through nodes as straight as may be.

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
        for nodes, own, closed in trails(xy, edges)
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


def trails(xy: Floats, edges: Ints) -> list[tuple[list[int], list[int], bool]]:
    """Trails that hold each edge of a graph once: nodes, edges, and whether each is closed.

    A closed one does not repeat its first node. In an order with little travel: only between nodes
    where an odd number of edges meets, and from one connected part to the next.
    """
    degree = np.bincount(edges.ravel(), minlength=len(xy))
    odd = np.flatnonzero(degree % 2)
    travel = odd[pairs(xy[odd])]
    return _Euler(xy, edges, travel).trails()


class _Euler:
    """Closed ways over edges and travel. End `2 k` of edge k is at its first node.

    `partner` of an end is the end of another edge by which the way goes on at the node.
    """

    def __init__(self, xy: Floats, edges: Ints, travel: Ints) -> None:
        self.edges = len(edges)
        self.node: list[int] = np.concatenate([edges, travel]).ravel().tolist()
        away = np.diff(xy[edges], axis=1)[:, 0]
        away = away / np.hypot(*away.T)[:, None]
        both = np.stack([away, -away], 1).reshape(-1, 2)
        self.away: list[complex] = (both[:, 0] + 1j * both[:, 1]).tolist()
        gap = np.hypot(*(xy[travel[:, 1]] - xy[travel[:, 0]]).T) if len(travel) else np.zeros(0)
        self.gap: list[float] = gap.tolist()
        self.partner = [-1] * len(self.node)
        ends: dict[int, list[int]] = {}
        for end, node in enumerate(self.node):
            ends.setdefault(node, []).append(end)
        # Where there is least to choose from first.
        self.ends = sorted(ends.values(), key=len)
        for own in self.ends:
            self._pair(own)
        # What is paired at one node decides what an edge costs at the other.
        for _ in range(_AGAIN):
            for own in self.ends:
                if self._is_travel(own[-1]) and self._turn(self.partner[own[-1]], own[-1]) > 0:
                    self._pair(own)
        self._merge()

    def trails(self) -> list[tuple[list[int], list[int], bool]]:
        found = []
        for way in self._ways():
            breaks = [k for k, end in enumerate(way) if self._is_travel(end)]
            if not breaks:
                found.append(([self.node[end] for end in way], [end // 2 for end in way], True))
                continue
            first = max(breaks, key=lambda k: self.gap[way[k] // 2 - self.edges])
            run: list[int] = []
            for end in [*way[first + 1 :], *way[: first + 1]]:
                if not self._is_travel(end):
                    run.append(end)
                elif run:
                    nodes = [*(self.node[each] for each in run), self.node[run[-1] ^ 1]]
                    found.append((nodes, [each // 2 for each in run], False))
                    run = []
        return found

    def _is_travel(self, end: int) -> bool:
        return end >= 2 * self.edges

    def _turn(self, a: int, b: int) -> float:
        """Cost of going on from one end to another at their node."""
        if self._is_travel(a) or self._is_travel(b):
            other = a if self._is_travel(b) else b
            beyond = self.partner[other ^ 1]
            return _ALONE if beyond >= 0 and self._is_travel(beyond) else 0.0
        first, second = self.away[a], self.away[b]
        return 1 + first.real * second.real + first.imag * second.imag

    def _pair(self, ends: list[int]) -> None:
        """Pair the ends at a node, the straightest ways through it first."""
        lasts: Iterable[tuple[int, ...]] = [()]
        if self._is_travel(ends[-1]):
            lasts = [(end, ends[-1]) for end in ends[:-1]]
        chosen = min((self._straightest(ends, last) for last in lasts), key=lambda made: made[0])
        for a, b in chosen[1]:
            self.partner[a], self.partner[b] = b, a

    def _straightest(
        self, ends: Sequence[int], last: tuple[int, ...]
    ) -> tuple[float, list[tuple[int, ...]]]:
        cost = self._turn(*last) if last else 0.0
        made = [last] if last else []
        free = set(ends).difference(last)
        turns = sorted((self._turn(a, b), a, b) for a, b in combinations(sorted(free), 2))
        for turn, a, b in turns:
            if a in free and b in free:
                free -= {a, b}
                cost += turn
                made.append((a, b))
        return cost, made

    def _ways(self) -> list[list[int]]:
        """The closed ways, each as the ends at which its edges and travels begin."""
        seen = [False] * len(self.node)
        found = []
        for first in range(0, len(self.node), 2):
            way, end = [], first
            while not seen[end]:
                seen[end] = seen[end ^ 1] = True
                way.append(end)
                end = self.partner[end ^ 1]
            if way:
                found.append(way)
        return found

    def _merge(self) -> None:
        """Make one way of those that meet in a node, where the turns suffer least."""
        root = list(range(len(self.node) // 2))

        def of(end: int) -> int:
            k = end // 2
            while root[k] != k:
                root[k] = root[root[k]]
                k = root[k]
            return k

        for way in self._ways():
            for end in way:
                root[of(end)] = of(way[0])
        while True:
            changes = []
            for ends in self.ends:
                if len({of(end) for end in ends}) > 1:
                    changes += self._exchanges(ends)
            joined = False
            for _, a, b, c, d in sorted(changes):
                if self.partner[a] == b and self.partner[c] == d and of(a) != of(c):
                    self.partner[a], self.partner[c] = c, a
                    self.partner[b], self.partner[d] = d, b
                    root[of(a)] = of(c)
                    joined = True
            if not joined:
                return

    def _exchanges(self, ends: list[int]) -> list[tuple[float, int, int, int, int]]:
        """Ways to join two closed ways at a node, a to c and b to d, with what the turns lose."""
        through = [(end, self.partner[end]) for end in ends if end < self.partner[end]]
        found = []
        for (a, b), (c, d) in combinations(through, 2):
            now = self._turn(a, b) + self._turn(c, d)
            for e, f in ((c, d), (d, c)):
                lost = self._turn(a, e) + self._turn(b, f) - now
                if lost < _ALONE / 2:
                    found.append((lost, a, b, e, f))
        return found
