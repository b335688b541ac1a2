"""Flips of edges against the triangulation that a library makes of the same nodes."""

import numpy as np

from fdjax.mesh.flips import Joined, flipped
from fdjax.mesh.triangulation import Triangulation, delaunay


def joined(mesh):
    return Joined(mesh.triangles, mesh.edges[mesh.inner], mesh.beside[mesh.inner])


def lattice(rng, stray):
    x, y = (each.ravel() for each in np.meshgrid(np.arange(12.0), np.arange(9.0)))
    xy = np.stack([x + y % 2 / 2, y * np.sqrt(3) / 2], 1)
    inside = (x > 0) & (x < 11) & (y > 0) & (y < 8)
    return xy, xy + stray * inside[:, None] * rng.uniform(-1, 1, xy.shape)


def as_sets(some):
    return {frozenset(each) for each in some.tolist()}


def test_moved_nodes_are_joined_as_their_delaunay_triangulation_is():
    rng = np.random.default_rng(3)
    before, after = lattice(rng, 0.45)
    mesh = delaunay(before)
    was = joined(mesh)
    now, changed = flipped(after, was)
    moved = Triangulation(after, mesh.triangles)
    assert moved.angles.min() > 0
    assert 5 < changed.sum() < len(changed) / 2
    assert as_sets(now.edges[~changed]) <= as_sets(was.edges)
    own = Triangulation(after, now.triangles)
    # The rim, a row of nodes zigzagging, is held; all of the library's triangles within it are had.
    rim = np.unique(mesh.edges[~mesh.inner])
    within = [each for each in delaunay(after).triangles if not np.isin(each, rim).any()]
    assert as_sets(np.array(within)) <= as_sets(now.triangles)
    assert len(within) > 100
    assert own.angles.min() > moved.angles.min()


def test_edges_lie_between_the_triangles_beside_them():
    before, xy = lattice(np.random.default_rng(5), 0.45)
    now, _ = flipped(xy, joined(delaunay(before)))
    mesh = Triangulation(xy, now.triangles)
    expected = {
        tuple(edge): tuple(beside)
        for edge, beside in zip(
            mesh.edges[mesh.inner].tolist(), mesh.beside[mesh.inner].tolist(), strict=True
        )
    }
    for edge, beside in zip(now.edges.tolist(), now.beside.tolist(), strict=True):
        turned = edge[0] > edge[1]
        assert expected[tuple(sorted(edge))] == tuple(beside[::-1] if turned else beside)


def test_what_is_delaunay_stays():
    xy, _ = lattice(np.random.default_rng(0), 0.0)
    was = joined(delaunay(xy))
    now, changed = flipped(xy, was)
    assert not changed.any()
    for before, after in zip(was, now, strict=True):
        np.testing.assert_array_equal(before, after)
    # Four nodes on a circle, either way.
    square = np.array([(0.0, 0), (1, 0), (1, 1), (0, 1)])
    for triangles in ([(0, 1, 2), (0, 2, 3)], [(0, 1, 3), (1, 2, 3)]):
        assert not flipped(square, joined(Triangulation(square, np.array(triangles))))[1].any()
