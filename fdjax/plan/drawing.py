"""A drawing as continuous roads: clipped at the walls, each edge laid once, in trails."""

from heapq import heappop, heappush
from itertools import combinations
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon

from fdjax.part.region import Region
from fdjax.plan.laid import Laid, shortest_road
from fdjax.plan.room import Room, Walls
from fdjax.plan.simplify import pieces, simplify_paths
from fdjax.plan.toolpath import Road
from fdjax.plan.trail import checked
from fdjax.road.stroke import Drawing

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_SHARP = 0.5
"""Cosine of the least angle, 60 degrees, at which a road goes on from one edge to another."""

_BESIDE = 0.01
"""A join at a wall leaves the free region by less than this, mm."""

_BY_ROAD = 4.0
"""Ends at a wall are joined already where the way between them along the drawing is no longer than
so many road widths: more would lie under that bead."""

_NONE = -1


def lay_drawing(
    drawing: Drawing,
    room: Room | Region | Polygon | MultiPolygon,
    *,
    least_road: float = 0.0,
    tolerance: float = 0.0,
    start: ArrayLike | None = None,
    **_: object,
) -> Laid:
    """Lay each edge of a drawing once, in trails that go on as straight as they can at each node.

    Edges are clipped where their centre line would come nearer to a wall than half the largest
    road width. At a node of three edges one road ends and one goes on; where an end would leave a
    road too short to be laid, it goes on in place of another. Nodes stay points of all their roads.

    - `least_road`: shorter roads are not laid, mm; nor any of less than `SHORTEST_ROAD` widths.
    - `tolerance`: points within this of a straight road are dropped, mm.
    - `start`: where the head comes from; the roads start near it.

    What else other strokes are laid by has no say. Returns the roads in the order in which they
    are laid, and as roads what was left out. Raises `InputError` for a drawing whose arrays do not
    fit, or no room for a road.

    >>> from shapely import box
    >>> tee = np.array([(0.0, 2.0), (3.0, 2.0), (9.0, 2.0), (3.0, 9.0)])
    >>> drawing = Drawing(tee, np.array([(0, 1), (1, 2), (1, 3)]), np.full(3, 0.4), "tee")
    >>> sorted(round(road.length, 6) for road in lay_drawing(drawing, box(0, 0, 9, 8)).roads)
    [5.8, 8.6]
    """
    checked(drawing)
    if not len(drawing.edges):
        return Laid()
    walls = Room.of(room).walls(float(drawing.width.max()))
    clipped = _clipped(drawing, walls)
    if not len(clipped.edges):
        return Laid()
    length = np.hypot(*(clipped.xy[clipped.edges[:, 1]] - clipped.xy[clipped.edges[:, 0]]).T)
    shortest = shortest_road(clipped.width, least_road + tolerance)
    partner = _paired(clipped, length.tolist(), shortest)
    roads = _roads(clipped, partner, tolerance)
    return Laid.of(roads, shortest, start=start)


def _clipped(drawing: Drawing, walls: Walls) -> Drawing:
    """The drawing inside the free region, with a node more wherever an edge meets a wall."""
    ends = drawing.xy[drawing.edges]
    longest = float(np.hypot(*(ends[:, 1] - ends[:, 0]).T).max())
    # Most edges lie too deep in the room to reach a wall.
    deep = shapely.contains_xy(walls.deep(longest), drawing.xy)[drawing.edges[:, 0]]
    near = np.flatnonzero(~deep)
    cut = shapely.intersection(shapely.linestrings(ends[near]), walls.free)
    parts, owner = shapely.get_parts(cut, return_index=True)
    kept = (shapely.get_type_id(parts) == shapely.GeometryType.LINESTRING) & (
        shapely.length(parts) > 1e-9
    )
    parts, owner = parts[kept], near[owner[kept]]
    points = np.stack([
        shapely.get_coordinates(shapely.get_point(parts, place)) for place in (0, -1)
    ], 1)  # fmt: skip
    nodes = len(drawing.xy) + np.arange(2 * len(parts)).reshape(-1, 2)
    same = np.hypot(*np.moveaxis(points - ends[owner], -1, 0)) < 1e-9
    nodes[same] = drawing.edges[owner][same]
    width = drawing.width[owner]
    joins, wide = _joins(points, nodes, ~same, width, walls)
    return Drawing(
        np.concatenate([drawing.xy, points.reshape(-1, 2)]),
        np.concatenate([drawing.edges[deep], nodes, joins]),
        np.concatenate([drawing.width[deep], width, wide]),
        drawing.family,
        drawing.material,
    )


def _joins(
    points: Floats, nodes: Ints, cut: NDArray[np.bool_], width: Floats, walls: Walls
) -> tuple[Ints, Floats]:
    """Edges between ends at a wall that are nearer than a road is wide, and their widths.

    Else two beads would end on each other where the node of their edges lies beyond the wall. Where
    a short way along the drawing leads from one to the other they are joined already.
    """
    piece, side = np.nonzero(cut)
    at, name = points[piece, side], nodes[piece, side]
    tree = shapely.STRtree(np.asarray(shapely.points(at)))
    i, j = tree.query(shapely.points(at), predicate="dwithin", distance=width[piece])
    i, j = i[i < j], j[i < j]
    gap = np.hypot(*(at[i] - at[j]).T)
    beside = shapely.distance(shapely.points((at[i] + at[j]) / 2), walls.free)
    found = np.flatnonzero(np.asarray(beside) < _BESIDE)
    found = found[np.argsort(gap[found], kind="stable")]
    group = list(range(len(at)))

    def root(end: int) -> int:
        while group[end] != end:
            end = group[end]
        return end

    # The two ends of a piece that a wall cuts off on both sides are joined by the piece.
    for end in np.flatnonzero(piece[1:] == piece[:-1]).tolist():
        group[end] = end + 1
    near = _Ways.of(points, nodes, _BY_ROAD * float(width.max(initial=0.0)))
    joined = []
    for k in found.tolist():
        one, other = root(int(i[k])), root(int(j[k]))
        if one != other and not near.lead(int(name[i[k]]), int(name[j[k]])):
            group[one] = other
            joined.append(k)
    pairs = np.stack([i[joined], j[joined]], 1)
    return name[pairs], width[piece][pairs].mean(1)


class _Ways(NamedTuple):
    """Short ways along pieces: the `pieces` at each node, as other nodes and lengths, mm."""

    pieces: dict[int, list[tuple[int, float]]]
    reach: float

    @classmethod
    def of(cls, points: Floats, nodes: Ints, reach: float) -> "_Ways":
        length = np.hypot(*(points[:, 1] - points[:, 0]).T)
        short = length < reach
        pieces: dict[int, list[tuple[int, float]]] = {}
        for (a, b), way in zip(nodes[short].tolist(), length[short].tolist(), strict=True):
            pieces.setdefault(a, []).append((b, way))
            pieces.setdefault(b, []).append((a, way))
        return cls(pieces, reach)

    def lead(self, start: int, end: int) -> bool:
        """Whether a way no longer than `reach` leads from one node to another."""
        least = {start: 0.0}
        waiting = [(0.0, start)]
        while waiting:
            far, node = heappop(waiting)
            if node == end:
                return True
            for other, way in self.pieces.get(node, ()):
                if far + way < min(self.reach, least.get(other, np.inf)):
                    least[other] = far + way
                    heappush(waiting, (far + way, other))
        return False


class _Halves(NamedTuple):
    """Ends of edges, 2 k and 2 k + 1 those of edge k, sorted by node: `first` and `degree` of
    each node's, and the `unit` vector from the node along the edge.
    """

    order: Ints
    first: Ints
    degree: Ints
    unit: Floats

    @classmethod
    def of(cls, drawing: Drawing) -> "_Halves":
        node = drawing.edges.ravel()
        along = drawing.xy[drawing.edges[:, ::-1].ravel()] - drawing.xy[node]
        degree = np.bincount(node, minlength=len(drawing.xy))
        return cls(
            np.argsort(node, kind="stable"),
            np.cumsum(degree) - degree,
            degree,
            along / np.hypot(*along.T)[:, None],
        )


def _paired(drawing: Drawing, length: list[float], shortest: float) -> list[int]:
    """The end of another edge at which a road goes on from each end of an edge, or `_NONE`."""
    halves = _Halves.of(drawing)
    order, unit = halves.order, halves.unit
    first, second, cosine = [], [], []
    for degree in np.unique(halves.degree[halves.degree > 1]).tolist():
        at = halves.first[halves.degree == degree]
        for i, j in combinations(range(degree), 2):
            first.append(order[at + i])
            second.append(order[at + j])
            turned = (unit[first[-1]] * unit[second[-1]]).sum(1)
            # Where two edges meet there is no other way to go on.
            cosine.append(turned if degree > 2 else np.full(len(at), -2.0))
    partner = [_NONE] * (2 * len(drawing.edges))
    if not first:
        return partner
    a, b, turn = np.concatenate(first), np.concatenate(second), np.concatenate(cosine)
    rank = np.argsort(np.round(turn, 9), kind="stable")
    rank = rank[turn[rank] < _SHARP]
    for i, j in zip(a[rank].tolist(), b[rank].tolist(), strict=True):
        if partner[i] == partner[j] == _NONE:
            partner[i], partner[j] = j, i
    _lengthen(drawing, halves, partner, length, shortest)
    return partner


def _lengthen(
    drawing: Drawing, halves: _Halves, partner: list[int], length: list[float], shortest: float
) -> None:
    """Let roads shorter than `shortest` go on where another then ends, and is long enough."""

    def beyond(half: int) -> float:
        """Length from an end of an edge along its road, as far as it matters."""
        total, at = 0.0, half
        while at != _NONE and total < shortest:
            total += length[at // 2]
            at = partner[at ^ 1]
        return total

    node, unit = drawing.edges.ravel(), halves.unit
    for end in [half for half, other in enumerate(partner) if other == _NONE]:
        if partner[end] != _NONE or beyond(end) >= shortest:
            continue
        at = halves.first[node[end]]
        for other in halves.order[at : at + halves.degree[node[end]]].tolist():
            left = partner[other]
            if left == _NONE or unit[end] @ unit[other] > _SHARP or beyond(left) < shortest:
                continue
            partner[left] = _NONE
            partner[end], partner[other] = other, end
            break


def _roads(drawing: Drawing, partner: list[int], tolerance: float) -> list[Road]:
    """The trails as roads with fewer points; nodes of three and more edges stay points of them."""
    node, count = drawing.edges.ravel().tolist(), len(drawing.edges)
    junction = (np.bincount(drawing.edges.ravel(), minlength=len(drawing.xy)) > 2).tolist()
    used = [False] * count
    starts = [half for half, other in enumerate(partner) if other == _NONE]
    # Points and edges of all pieces, one after the other, and where each piece and trail begins.
    points: list[int] = []
    edges: list[int] = []
    firsts: list[int] = []
    trails: list[int] = []
    # What no free end leads to is closed.
    for half in [*starts, *range(0, 2 * count, 2)]:
        if used[half // 2]:
            continue
        trails.append(len(firsts))
        firsts.append(len(points))
        points.append(node[half])
        at = half
        while at != _NONE and not used[at // 2]:
            used[at // 2] = True
            if junction[points[-1]] and len(points) > firsts[-1] + 1:
                firsts.append(len(points))
                points.append(node[at])
            points.append(node[at ^ 1])
            edges.append(at // 2)
            at = partner[at ^ 1]
    many = np.diff([*firsts, len(points)])
    fewer, wide = simplify_paths(
        pieces(drawing.xy[points], many),
        pieces(drawing.width[edges], many - 1),
        tolerance=tolerance / 2,
    )
    ends = [*trails[1:], len(firsts)]
    lasts = [*firsts[1:], len(points)]
    return [
        _road(drawing, fewer[a:b], wide[a:b], closed=points[firsts[a]] == points[lasts[b - 1] - 1])
        for a, b in zip(trails, ends, strict=True)
    ]


def _road(drawing: Drawing, parts: list[Floats], widths: list[Floats], *, closed: bool) -> Road:
    xy = parts[0]
    if len(parts) > 1:
        xy = np.concatenate([xy[:1], *(piece[1:] for piece in parts)])
    closed = closed and len(xy) > 3
    xy = xy[:-1] if closed else xy
    return Road(
        xy,
        widths[0] if len(widths) == 1 else np.concatenate(widths),
        material=drawing.material,
        family=drawing.family,
        closed=closed,
    )
