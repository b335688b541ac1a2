"""Size fields, triangulations that follow them, and their duals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from scipy.spatial import Voronoi

from fdjax.errors import InputError
from fdjax.mesh.dual import centre_points, circumcentres
from fdjax.mesh.size import SizeField
from fdjax.mesh.triangulation import Triangulation, delaunay, relaxed

SQUARE = shapely.box(0, 0, 40, 40)
HOLED = shapely.Point(50, 10).buffer(20).difference(shapely.Point(44, 12).buffer(5))


@pytest.mark.parametrize(
    ("size", "said"),
    [
        (lambda x, y: 0 * x, r"size is 0 mm at \(.*\) mm; it must be positive"),
        (lambda x, y: x - 20, "it must be positive and finite"),
        (lambda x, y: np.where(y > 35, np.nan, 1.0), "size is nan mm"),
        (lambda x, y: 30 + 0 * x, "more than half the part, which is 40 mm"),
        (lambda x, y: 0.01 + 0 * x, "triangles; 1e.06 at most"),
    ],
)
def test_a_size_that_gives_no_mesh_is_refused(size, said):
    with pytest.raises(InputError, match=said):
        SizeField.over(SQUARE, size)


@pytest.mark.parametrize("region", [SQUARE, HOLED], ids=["square", "holed"])
@pytest.mark.parametrize("phase", [0.0, 0.6])
def test_edges_are_as_long_as_an_ideal_mesh_has_them(region, phase):
    field = SizeField.over(region, lambda x, y: 1.5 + (x + y) / 40)
    mesh = relaxed(field, phase)
    lines = shapely.linestrings(mesh.xy[mesh.edges])
    length = shapely.length(shapely.intersection(lines, region)).sum()
    ideal = field.integral(2 * np.sqrt(3) / field.size, region)
    # Real triangles are not equal: their edges are longer.
    assert ideal < length < 1.12 * ideal
    inside = mesh.part(shapely.contains_xy(region, *mesh.xy[mesh.triangles].mean(1).T))
    assert inside.angles.min() > 20
    assert np.median(inside.angles.min(1)) > 44
    assert np.allclose(inside.angles.sum(1), 180)


def test_other_phases_are_other_meshes_and_each_is_the_same_every_time():
    field = SizeField.over(SQUARE, lambda x, y: 4 + 0 * x)
    first, again, other = relaxed(field), relaxed(field), relaxed(field, 0.5)
    assert (first.xy == again.xy).all()
    assert len(first.xy) == len(other.xy)
    assert np.abs(first.xy - other.xy).max() > 1


def test_edges_and_the_triangles_beside_them():
    rng = np.random.default_rng(2)
    mesh = delaunay(rng.uniform(0, 9, (60, 2)) + 1e4)
    # Euler: nodes - edges + triangles = 1.
    assert len(mesh.xy) - len(mesh.edges) + len(mesh.triangles) == 1
    left, right = mesh.beside.T
    assert (np.maximum(left, right) >= 0).all()
    a, b = np.moveaxis(mesh.xy[mesh.edges], 1, 0)
    for side, sign in ((left, 1), (right, -1)):
        own = side >= 0
        to = mesh.xy[mesh.triangles[side[own]]].mean(1) - a[own]
        along = (b - a)[own]
        assert (sign * (along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]) > 0).all()


def test_a_part_of_a_mesh_has_its_own_nodes():
    mesh = delaunay(np.random.default_rng(4).uniform(0, 9, (30, 2)))
    kept = np.arange(len(mesh.triangles)) < 5
    part = mesh.part(kept)
    assert np.unique(part.triangles).tolist() == list(range(len(part.xy)))
    assert (part.xy[part.triangles] == mesh.xy[mesh.triangles[kept]]).all()


def test_circumcentres_are_the_nodes_of_the_voronoi_diagram():
    xy = np.random.default_rng(5).uniform(0, 9, (40, 2))
    mesh = delaunay(xy)
    own = circumcentres(xy, mesh.triangles)
    theirs = Voronoi(xy).vertices
    gap = np.hypot(*np.moveaxis(own[:, None] - theirs, 2, 0)).min(1)
    assert gap.max() < 1e-6


def test_both_duals_of_equal_triangles_are_one():
    equal = Triangulation(
        np.array([(0.0, 0), (2, 0), (1, np.sqrt(3)), (3, np.sqrt(3))]),
        np.array([(0, 1, 2), (1, 3, 2)]),
    )
    points = [each(equal.xy, equal.triangles) for each in (centre_points, circumcentres)]
    assert points[0] == pytest.approx(points[1])


@pytest.mark.parametrize("points", [centre_points, circumcentres])
def test_duals_can_be_differentiated(points):
    xy = jnp.asarray(np.random.default_rng(6).uniform(0, 9, (12, 2)))
    triangles = delaunay(np.asarray(xy)).triangles

    def value(xy):
        return jnp.tanh(points(xy, triangles) / 9).sum()

    way = jnp.asarray(np.random.default_rng(7).normal(size=xy.shape))
    h = 1e-5
    slope = (value(xy + h * way) - value(xy - h * way)) / (2 * h)
    assert float((jax.grad(value)(xy) * way).sum()) == pytest.approx(float(slope), rel=1e-5)
