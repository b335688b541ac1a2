"""Nodes of dual meshes: a point in each triangle, joined over the sides. NumPy's or JAX's arrays.

For equal triangles both kinds are the same honeycomb.
"""

from typing import Any

from fdjax.arrays import namespace


def centre_points(xy: Any, triangles: Any) -> Any:
    """The paper's type I: the mean of each triangle's nodes, shape (triangles, 2), mm."""
    return xy[triangles].mean(1)


def circumcentres(xy: Any, triangles: Any) -> Any:
    """Type II: nodes of the Voronoi diagram of a Delaunay triangulation, (triangles, 2), mm.

    Differentiable where no triangle is flat.
    """
    corner = xy[triangles]
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    twice = 2 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    a, b = (first**2).sum(1), (second**2).sum(1)
    xp = namespace(xy)
    across = xp.stack([second[:, 1] * a - first[:, 1] * b, first[:, 0] * b - second[:, 0] * a], 1)
    return corner[:, 0] + across / twice[:, None]
