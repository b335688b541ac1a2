"""Triangulations whose nodes have moved made Delaunay's again, by flips (Lawson 1977).

A flip takes the edge between two triangles out and puts the other diagonal of the two in. The
numbers of triangles and edges stay, and the rim does.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

_LEAST = 1e-9
"""Where the two angles opposite to an edge have cotangents that sum to more below nought than this
it is flipped: with four nodes on a circle rounding must not decide for ever."""


class Joined(NamedTuple):
    """How nodes are joined.

    - `triangles`: nodes of each, counterclockwise, (t, 3).
    - `edges`: nodes of each edge between two triangles, (e, 2); `beside`: those two, left and
      right of it, (e, 2).
    """

    triangles: Ints
    edges: Ints
    beside: Ints


def flipped(xy: Floats, joined: Joined) -> tuple[Joined, NDArray[np.bool_]]:
    """Nodes (n, 2) joined as Delaunay's triangles are, and which edges are others, (e,).

    Triangles must not be folded. Edges that are flipped and their triangles keep their numbers.

    >>> xy = np.array([(0.0, 0), (1, 0), (1.2, 1.2), (0, 1)])
    >>> long = Joined(np.array([(0, 1, 2), (0, 2, 3)]), np.array([(0, 2)]), np.array([(1, 0)]))
    >>> flipped(xy, long)[0].edges.tolist()
    [[1, 3]]
    """
    triangles, edges, beside = (np.array(each) for each in joined)
    changed = np.zeros(len(edges), bool)
    while True:
        a, b = edges.T
        c, d = (triangles[own].sum(1) - a - b for own in beside.T)
        blunt = _cotangent(xy[a] - xy[c], xy[b] - xy[c]) + _cotangent(xy[b] - xy[d], xy[a] - xy[d])
        wrong = np.flatnonzero(blunt < -_LEAST)
        if not len(wrong):
            return Joined(triangles, edges, beside), changed
        # All at once, but of edges of one triangle the one that is most wrong.
        wrong = wrong[np.argsort(blunt[wrong], kind="stable")]
        worst = np.full(len(triangles), len(edges))
        np.minimum.at(worst, beside[wrong], np.arange(len(wrong))[:, None])
        chosen = wrong[(worst[beside[wrong]] == np.arange(len(wrong))[:, None]).all(1)]
        a, b, c, d = (each[chosen] for each in (a, b, c, d))
        left, right = beside[chosen].T
        triangles[left] = np.stack([a, d, c], 1)
        triangles[right] = np.stack([d, b, c], 1)
        edges[chosen] = np.stack([d, c], 1)
        changed[chosen] = True
        beside = _beside(triangles, edges)


def _cotangent(first: Floats, second: Floats) -> Floats:
    """Of the angle from the first to the second of vectors (n, 2)."""
    return (first * second).sum(1) / (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _beside(triangles: Ints, edges: Ints) -> Any:
    """The triangles left and right of each edge, (e, 2)."""
    count = int(triangles.max()) + 1
    sides = triangles * count + np.roll(triangles, -1, 1)
    order = np.argsort(sides, axis=None)
    sorted_sides = sides.ravel()[order]
    wanted = np.stack([edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]], 1)
    return order[np.searchsorted(sorted_sides, wanted)] // 3
