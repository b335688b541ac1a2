"""Meshes that are given or drawn in a chart, as roads and as keys of a job."""

from itertools import islice

import jax
import meshio
import numpy as np
import pytest
import shapely

from fdjax.app import config
from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.mesh.given import Given, lattice
from fdjax.part.part import Part
from fdjax.pattern.mesh import Mesh
from fdjax.plan.check import check
from fdjax.plan.trace import lay
from fdjax.target.target import expression

pytestmark = pytest.mark.usefixtures("compiled_once")

MARLIN = profile.load("marlin-0.4")
THIRD = expression("0.25 + 0*x", quantity="solid")
SQUARE = shapely.box(0, 0, 40, 40)
RING = shapely.Point(20, 20).buffer(20, quad_segs=32).difference(shapely.Point(20, 20).buffer(8))


def begun(outline=SQUARE, **settings):
    part = Part.plate(outline)
    return part, Mesh(**settings).begin(part, THIRD, MARLIN.limits, 5.0)


def laid(part, pattern):
    return lay(pattern.strokes(pattern.first), part, lift_length=4.0, least_road=1.0)


def modelled(pattern):
    return float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))


def given(counts=(8, 8), size=40.0, diagonal="rising"):
    mesh = lattice(counts, diagonal)
    return (Given.of(size * mesh.xy, mesh.triangles),)


def test_each_edge_of_a_given_mesh_is_laid_once():
    part, pattern = begun(mesh=given())
    build = laid(part, pattern)
    # Ends that come together at the walls lengthen edges a little.
    straight, across = 2 * 7 * 39.6, 64 * 5 * np.sqrt(2) - 15 * 2 * 0.2 * np.sqrt(2)
    for layer in build.layers:
        length = sum(road.length for road in layer.roads)
        assert length == pytest.approx(straight + across, rel=3e-3)
    assert modelled(pattern) == pytest.approx(build.volume, rel=5e-3)


def test_a_mesh_smaller_than_the_part_has_its_rim_laid_too():
    moved = given((2, 2), 20.0)[0].mesh
    part, pattern = begun(mesh=(Given.of(moved.xy + 10, moved.triangles),))
    length = sum(road.length for road in laid(part, pattern).layers[0].roads)
    assert length == pytest.approx(6 * 20 + 4 * 10 * np.sqrt(2), rel=1e-6)


def test_the_dual_of_a_given_mesh_reaches_the_walls():
    part, pattern = begun(mesh=given(), cells="centre-dual")
    build = laid(part, pattern)
    ends = np.concatenate([
        road.path[[0, -1]] for road in build.layers[0].roads if not road.closed
    ])  # fmt: skip
    # Of 32 sides of the rim each is crossed once, but where two ends meet in a corner.
    at_wall = np.minimum(ends, 40 - ends).min(1) < 0.21
    assert at_wall.sum() >= 30
    assert modelled(pattern) == pytest.approx(build.volume, rel=5e-3)


def test_several_meshes_follow_each_other_over_the_layers():
    _, pattern = begun(mesh=given((4, 4)) + given((5, 5)))
    counts = [len(layer[0].edges) for layer in pattern.strokes(pattern.first)]
    assert counts[0] < counts[1]
    assert counts == counts[:2] * 5


@pytest.mark.parametrize(
    ("outline", "through", "settings"),
    [
        (SQUARE, "uniform", {"diagonal": "falling"}),
        (SQUARE, "two-boundary", {"cells": "centre-dual"}),
        (shapely.Polygon([(0, 0), (40, 5), (36, 40), (4, 30)]), "transfinite", {}),
        (RING, "polar", {}),
        (RING, "o-transfinite", {"cells": "centre-dual"}),
    ],
)
def test_quads_of_a_chart_are_as_fine_as_the_target_asks(outline, through, settings):
    part, pattern = begun(outline, through=through, **settings)
    assert pattern.realise(pattern.first).made
    build = laid(part, pattern)
    assert build.volume == pytest.approx(0.25 * shapely.area(outline) * 2, rel=0.12)
    # Where rays crowd at a hole ends come together.
    assert build.volume + build.thinned == pytest.approx(modelled(pattern), rel=0.025)
    found = check(build.replace(origin=(50, 50)), MARLIN.limits)
    assert [each for each in found if each.severity == "error"] == []


def test_quads_are_moved_from_phase_to_phase_and_counted_as_asked():
    _, pattern = begun(through="uniform", quads=(8, 4), phases=4)
    first, second = (layer[0] for layer in islice(pattern.strokes(pattern.first), 2))
    x = [np.unique(np.round(graph.xy[:, 0], 6)) for graph in (first, second)]
    assert np.diff(x[0]) == pytest.approx(5)
    assert (x[1] - x[0][:1]) % 5 == pytest.approx(1.25)


def test_a_mesh_of_the_unit_square_goes_through_a_chart():
    corners = [(0, 0), (40, 5), (36, 40), (4, 30)]
    _, pattern = begun(shapely.Polygon(corners), mesh=given(size=1.0), through="transfinite")
    xy = np.asarray(pattern.first)
    for corner in corners:
        assert np.hypot(*(xy - corner).T).min() < 1e-9
    with pytest.raises(InputError, match=r"its node \(0, 1\.25\) lies beyond the unit square"):
        begun(mesh=given(size=10.0), through="uniform")


def test_a_given_mesh_keeps_what_it_has_of_angles():
    flat = lattice((8, 2), "rising")
    _, pattern = begun(mesh=(Given.of(flat.xy * [8, 40], flat.triangles),))
    assert pattern.facts(pattern.first)["least_angle"] < 5
    broken = pattern.penalties(pattern.realise(pattern.first), MARLIN.limits)
    assert max(float(each.max()) for each in broken.values()) < 0


def test_what_is_not_designed_is_not_corrected_either():
    assert Mesh(mesh=given(), controls=(), corrections=3).corrections == 0
    assert (Mesh().corrections, Mesh(cells="voronoi-dual").corrections) == (2, 8)
    assert Mesh(corrections=1).corrections == 1


def test_the_voronoi_dual_of_a_mesh_that_is_none_of_delaunay_is_refused():
    mesh = lattice((4, 4), "rising")
    sheared = mesh.xy @ [[1, 0], [0.9, 1]]
    outline = shapely.MultiPoint(40 * sheared).convex_hull
    with pytest.raises(InputError, match=r"sides of the mesh, the first at .* centre-dual"):
        begun(outline, mesh=(Given.of(40 * sheared, mesh.triangles),), cells="voronoi-dual")
    even = mesh.xy @ [[1, 0], [-0.5, np.sqrt(3) / 2]]
    outline = shapely.MultiPoint(40 * even).convex_hull
    given_even = (Given.of(40 * even, mesh.triangles),)
    voronoi, centre = (
        begun(outline, mesh=given_even, cells=f"{kind}-dual")[1] for kind in ("voronoi", "centre")
    )
    inner = len(mesh.xy) + np.arange(8)
    both = [np.asarray(each.nodes(each.first))[inner] for each in (voronoi, centre)]
    assert both[0] == pytest.approx(both[1])


def test_a_mesh_beside_the_part_is_refused():
    mesh = lattice((4, 4), "rising")
    with pytest.raises(InputError, match=r"none of its triangles lies in the part, which reaches"):
        begun(mesh=(Given.of(mesh.xy + 900, mesh.triangles),))


def parsed(pattern, folder=None):
    table = {
        "part": {"shape": "rectangle", "size": [40, 40]},
        "target": {"solid": 0.25},
        "pattern": {"kind": "mesh", **pattern},
    }
    return config.parse(table, **({} if folder is None else {"folder": folder})).pattern


def test_a_job_names_files_or_gives_nodes(tmp_path):
    mesh = lattice((4, 3), "rising")
    flat = np.column_stack([mesh.xy, 0 * mesh.xy[:, 0]])
    meshio.Mesh(flat, [("triangle", mesh.triangles)]).write(tmp_path / "a.vtk")
    one = parsed({"mesh": "a.vtk"}, tmp_path).mesh
    inches = parsed({"mesh": ["a.vtk", {"file": "a.vtk", "unit": "in"}]}, tmp_path).mesh
    assert len(one) == 1
    assert np.ptp(inches[1].mesh.xy, axis=0) == pytest.approx([25.4, 25.4])
    table = {"nodes": [[0, 0], [9, 0], ["1cm", 9]], "triangles": [[0, 1, 2]]}
    (given,) = parsed({"mesh": table}).mesh
    assert given.mesh.xy[2].tolist() == [10, 9]


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ({"mesh": "none.vtk"}, r"none\.vtk: no such file"),
        ({"mesh": []}, "is empty"),
        ({"mesh": 3}, "3 is no mesh; a file, or a table of"),
        ({"mesh": {"nods": []}}, "is no mesh; a file, or a table of"),
        ({"mesh": {"nodes": [[0, 0]], "triangles": []}}, "has 1 points; 3 or more"),
        ({"mesh": {"nodes": [[0, 0], [1, 0], [0, 1]], "triangles": [[0, 1, 3]]}}, "names node 3"),
        ({"quads": [4, 4]}, "quads: they are of a map; give through"),
        ({"through": "elliptic"}, '"elliptic" is not one of uniform'),
        ({"through": "polar", "diagonal": "up"}, '"up" is not one of rising'),
    ],
)
def test_keys_that_do_not_fit_are_refused(pattern, said):
    with pytest.raises(InputError, match=said):
        parsed(pattern)
