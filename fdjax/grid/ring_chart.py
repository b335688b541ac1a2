"""Conformal maps of rings as charts that lines are drawn on, their walls of many vertices."""

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Array, Float
from shapely import LinearRing

from fdjax.grid.algebraic import Spacings
from fdjax.grid.base import Sides
from fdjax.grid.conformal_ring import Ring, ring_map, solve
from fdjax.grid.elliptic import NodeMap
from fdjax.part.curve import Curve, Floats, polyline_at

CHART = (33, 96)
"""Nodes from the hole outwards, and around, of the lattice that a chart goes through."""


def chart(outline: Floats, hole: Floats, most: int) -> tuple[NodeMap, float, float]:
    """The map of the unit square onto a ring whose lines cross squarely, closed along eta.

    Returned with its `error` and by how much, mm, the polygons that are mapped leave the walls:
    where these have more than `most` vertices in all, those that matter least are left out, and the
    map is bent to the walls. Cubic splines between nodes of the exact map.

    - `outline`, `hole`: counter-clockwise, shape (n, 2), mm.
    """
    kept, off = _kept((outline, hole), most)
    around = np.arange(CHART[1]) / CHART[1]
    found, lattice = _solved(outline[kept[0]], hole[kept[1]])
    nodes, angle = np.array(lattice), np.asarray(found.angle)
    m = len(kept[0])
    xi = np.linspace(0, 1, CHART[0])[:, None, None]
    curves = []
    for own, wall, rows, share in (
        (angle[m:], (hole, kept[1]), nodes[0].copy(), 1 - xi),
        (angle[:m], (outline, kept[0]), nodes[-1].copy(), xi),
    ):
        curve = _wall(own / (2 * np.pi), *wall, around, rows)
        nodes += share * (curve(around) - rows)
        curves.append(curve)
    left, right = curves
    cut = polyline_at(np.array([0.0, 1.0]), np.stack([left.start, right.start]))
    sides = Sides(cut, right, cut, left)
    made = NodeMap.through(jnp.asarray(nodes), sides, Spacings(), closed=True)
    return made, float(found.error), off


def _kept(walls: tuple[Floats, Floats], most: int) -> tuple[list[np.ndarray], float]:
    """Which vertices of both walls are mapped, and how far these polygons leave the walls, mm."""
    rings = [LinearRing(wall) for wall in walls]
    size = np.ptp(walls[0], axis=0).max()
    kept = [np.arange(len(wall)) for wall in walls]
    tolerance = 1e-5 * size
    while sum(map(len, kept)) > most:
        for j, (ring, wall) in enumerate(zip(rings, walls, strict=True)):
            simple = shapely.get_coordinates(shapely.simplify(ring, tolerance))[:-1]
            kept[j] = np.flatnonzero((wall[:, None] == simple).all(-1).any(1))
        tolerance *= 1.3
    polygons = [LinearRing(wall[k]) for wall, k in zip(walls, kept, strict=True)]
    off = max(shapely.hausdorff_distance(*pair) for pair in zip(rings, polygons, strict=True))
    return kept, float(off)


def _wall(eta: Floats, wall: Floats, kept: np.ndarray, around: Floats, at: Floats) -> Curve:
    """A wall over eta: all its vertices, and points between them where the lattice has nodes.

    - `eta`: of the vertices that are kept; `at`: the nodes on the polygon of these, at `around`.
    """
    breaks, points = [], []
    for j, k in enumerate(kept):
        end = kept[(j + 1) % len(kept)]
        run = np.arange(k, end + 1 if end > k else end + 1 + len(wall)) % len(wall)
        xy = wall[run]
        walked = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
        start, stop = eta[j], eta[j + 1] if j + 1 < len(eta) else eta[0] + 1
        # How far along the side the nodes on it are, is how far along the run.
        inside = (around - start) % 1 < stop - start
        place = start + (around[inside] - start) % 1
        order = np.argsort(place)
        way = xy[-1] - xy[0]
        share = ((at[inside] - xy[0]) @ way / (way @ way))[order]
        known = (
            np.concatenate([[0.0], share, [1.0]]),
            np.concatenate([[start], place[order], [stop]]),
        )
        share = np.unique(np.concatenate([walked / walked[-1], np.clip(share, 0, 1)]))[:-1]
        breaks.append(np.interp(share, *known))
        points.append(np.stack([np.interp(share * walked[-1], walked, each) for each in xy.T], 1))
    t, xy = np.concatenate(breaks) % 1, np.concatenate(points)
    # Just below 1, by rounding, is 0 and not a whole turn.
    t[t > 1 - 1e-9] = 0.0
    order = np.argsort(t)
    t, xy = t[order], xy[order]
    apart = np.diff(t, prepend=-1.0) > 1e-9
    t, xy = t[apart], xy[apart]
    # From eta = 0 on, wherever on a side that is.
    first = t[0] + (1 - t[-1])
    begin = xy[0] + (xy[-1] - xy[0]) * (t[0] / first if first > 0 else 0.0)
    if t[0] > 1e-9:
        t, xy = np.append(0.0, t), np.vstack([begin, xy])
    t[0] = 0.0
    return polyline_at(np.append(t, 1.0), np.vstack([xy, xy[:1]]))


@jax.jit
def _solved(outline: Float[Array, "m 2"], hole: Float[Array, "n 2"]) -> tuple[Ring, Array]:
    """The prevertices and the chart's nodes."""
    found = solve(outline, hole)
    xi, eta = jnp.linspace(0, 1, CHART[0])[:, None], jnp.arange(CHART[1])[None] / CHART[1]
    return found, ring_map(found, len(outline), xi, eta)
