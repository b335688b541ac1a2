"""Edges of meshes: where design sees their material, against the roads that a plan lays."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from slopes import assert_slopes

from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.limits import Limits
from fdjax.mesh.given import Given as GivenMesh
from fdjax.mesh.triangulation import Triangulation
from fdjax.optimise import design as rounds
from fdjax.optimise.design import design
from fdjax.optimise.least_squares import Outcome
from fdjax.optimise.objective import Objective
from fdjax.part.part import Part
from fdjax.pattern.mesh import CELLS, Mesh
from fdjax.plan.check import check
from fdjax.plan.compare import compare
from fdjax.plan.measure import measure
from fdjax.plan.trace import lay
from fdjax.road.window import SoftWindows
from fdjax.target.target import Target, expression

pytestmark = pytest.mark.usefixtures("compiled_once")

MARLIN = profile.load("marlin-0.4")
DISC = shapely.Point(20, 20).buffer(20, quad_segs=24).difference(shapely.Point(14, 24).buffer(4))
LINEAR = expression("0.15 + 0.2*x/40", quantity="solid")


def plate(layers=10):
    return Part.plate(DISC, layers=layers, height=0.2)


def begun(part=None, target=LINEAR, **settings):
    return Mesh(**settings).begin(part or plate(), target, MARLIN.limits, 5.0)


def planned(result_or_pattern, part):
    strokes = result_or_pattern
    return lay(strokes, part, lift_length=4.0, least_road=1.0, clearance=5e-3)


@pytest.mark.parametrize("cells", CELLS)
def test_the_deposit_is_what_a_plan_lays(cells):
    part = plate()
    pattern = begun(part, cells=cells)
    modelled = float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))
    build = planned(pattern.strokes(pattern.first), part)
    assert build.volume + build.thinned == pytest.approx(modelled, rel=0.01)
    assert build.volume == pytest.approx(float(LINEAR_VOLUME), rel=0.08)


LINEAR_VOLUME = shapely.area(DISC) * 2.0 * (0.15 + 0.2 * shapely.centroid(DISC).x / 40)
"""mm^3 that the target asks for in ten layers of 0.2 mm."""


@pytest.mark.parametrize("cells", CELLS)
def test_gradients_agree_with_central_differences(cells):
    part = plate(5)
    pattern = begun(part, cells=cells, phases=2)
    windows = SoftWindows.over(part, LINEAR.solid, 5.0, flat=True)
    assert_slopes(Objective(pattern, windows, LINEAR, MARLIN.limits), scaled=False)


SPARSE = expression("0.2 + 0.15*x/40", quantity="solid")


@pytest.mark.parametrize("cells", ["triangles", "centre-dual", "triangles-and-voronoi-dual"])
def test_the_deposit_of_polygons_is_what_a_plan_lays(cells):
    part = plate()
    pattern = begun(part, SPARSE, cells=cells, laid="polygons")
    modelled = float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))
    build = planned(pattern.strokes(pattern.first), part)
    asked = shapely.area(DISC) * 2.0 * (0.2 + 0.15 * shapely.centroid(DISC).x / 40)
    assert build.volume + build.thinned == pytest.approx(modelled, rel=0.04)
    assert build.volume == pytest.approx(float(asked), rel=0.1)
    found = check(build.replace(origin=(50, 50)), MARLIN.limits)
    assert [each for each in found if each.severity == "error"] == []


def test_a_road_along_each_wall_is_counted_as_it_is_laid():
    part = plate()
    pattern = begun(part, walls=True)
    modelled = float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))
    build = planned(pattern.strokes(pattern.first), part)
    assert build.volume + build.thinned == pytest.approx(modelled, rel=0.01)
    walls = [road for road in build.layers[0].roads if road.family == "wall"]
    along = 2 * np.pi * (19.8 + 4.2)
    assert sum(road.length for road in walls) == pytest.approx(along, rel=0.005)
    found = check(build.replace(origin=(50, 50)), MARLIN.limits)
    assert [each for each in found if each.severity == "error"] == []
    with pytest.raises(InputError, match="polygons have a road along each wall anyway"):
        Mesh(laid="polygons", walls=True)


def test_gradients_of_polygons_agree_with_central_differences():
    part = plate(5)
    pattern = begun(part, SPARSE, cells="centre-dual", phases=2, laid="polygons")
    windows = SoftWindows.over(part, SPARSE.solid, 5.0, flat=True)
    assert_slopes(Objective(pattern, windows, SPARSE, MARLIN.limits), scaled=False)


def test_polygons_denser_than_roads_can_be_are_refused():
    full = expression("0.95", quantity="solid")
    with pytest.raises(InputError, match=r"roads 0\.4 mm wide hold a solid share of"):
        begun(target=full, laid="polygons")


@pytest.mark.parametrize("cells", ["triangles", "centre-dual"])
def test_a_disc_with_a_hole_meets_its_target_in_the_roads(cells):
    part = plate()
    found = design(part, LINEAR, limits=MARLIN.limits, pattern=Mesh(cells=cells))
    assert found.made
    assert found.broken == {}
    build = planned(found.strokes(), part)
    assert compare(measure(build, window=5.0), LINEAR).rms < 0.012
    assert build.volume == pytest.approx(found.volume, rel=0.01)
    better = planned(found.corrected(*build.deposits(1.25)).strokes(), part)
    assert better.volume == pytest.approx(found.volume, rel=0.003)
    findings = check(better.replace(origin=(9, 9)), Limits(least_road=1.0))
    assert {finding.severity for finding in findings} <= {"warning"}
    facts = found.pattern.facts(found.controls)
    assert facts["least_angle"] > 15
    assert facts["median_angle"] > 40
    assert facts["edge_length"][0] > 0.39


def strayed(pattern):
    way = np.random.default_rng(1).uniform(-1, 1, (len(pattern.first), 2))
    return pattern.at(pattern.first + 0.3 * pattern.size[:, None] * way)


@pytest.mark.parametrize("cells", ["triangles", "centre-dual", "triangles-and-centre-dual"])
def test_roads_that_a_flip_would_move_stay_joined(cells):
    moved = strayed(begun(cells=cells, phases=1))
    assert moved.mended() is moved


@pytest.mark.parametrize("cells", ["voronoi-dual", "triangles-and-voronoi-dual"])
def test_moved_nodes_are_joined_anew_on_all_sheets_of_a_mesh(cells):
    pattern = begun(cells=cells, phases=2)
    assert pattern.mended() is pattern
    moved = strayed(pattern)
    mended = moved.mended()
    assert mended is not moved
    assert mended.mended() is mended
    # All shapes stay, so nothing compiles anew.
    assert jax.tree.structure(mended) == jax.tree.structure(moved)
    assert [np.shape(x) for x in jax.tree.leaves(mended)] == [
        np.shape(x) for x in jax.tree.leaves(moved)
    ]
    nodes, triangles = np.asarray(mended.first), np.asarray(mended.triangles.nodes)
    mesh = Triangulation(nodes, triangles)
    assert mesh.angles.min() > Triangulation(nodes, np.asarray(moved.triangles.nodes)).angles.min()
    for first, last in mended.sheets:
        own = slice(first, last)
        sides, beside, ends = (
            np.asarray(each[own])
            for each in (mended.edges.sides, mended.edges.cells, mended.edges.nodes)
        )
        for cell in beside.T:
            shared = (triangles[cell][:, :, None] == sides[:, None, :]).any(1)
            assert shared.all()
        dual = ends[0, 0] >= len(nodes)
        np.testing.assert_array_equal(ends, len(nodes) + beside[:, ::-1] if dual else sides)
    excess = mended.penalties(mended.realise(mended.first), MARLIN.limits)["edge"]
    of_dual = np.asarray(mended.edges.nodes[:, 0]) >= len(nodes)
    # No edge is turned over: all are further from what is allowed than half a road.
    assert np.asarray(excess)[of_dual].max() < -0.49


def test_meshes_that_are_given_stay_joined_as_they_are():
    nodes = np.array([(0.0, 0), (40, 0), (39, 39), (0, 40)])
    given = GivenMesh.of(nodes, [(0, 1, 2), (0, 2, 3)])
    moved = strayed(begun(cells="voronoi-dual", mesh=(given,)))
    assert moved.mended() is moved


@pytest.mark.parametrize("cells", ["triangles", "voronoi-dual"])
def test_barriers_do_not_jump_where_an_edge_slides_over_a_wall(cells):
    pattern = begun(cells=cells, phases=1)
    # Small, so that edges are short, and those of Voronoi turned over; over the wall and back.
    about = jnp.asarray(DISC.exterior.coords[0])
    small = jnp.array([0.05 if cells == "triangles" else -0.05, 0.05])

    def barrier(shift):
        xy = about + small * (pattern.first - about) + jnp.array([shift, 0.0])
        excess = pattern.penalties(pattern.realise(xy), MARLIN.limits)["edge"]
        return jnp.where(excess > -0.5, excess, -0.5)

    excess = np.asarray(jax.jit(jax.vmap(barrier))(jnp.linspace(-0.5, 0.5, 1001)))
    assert np.ptp(excess, axis=0).max() > 0.2
    # 2 mm an mm, over the least length.
    assert np.abs(np.diff(excess, axis=0)).max() < 1.5 * 2 * 1e-3 / 0.3


def test_a_voronoi_design_ends_with_a_voronoi_diagram():
    part = plate(6)
    settings = Mesh(cells="voronoi-dual", phases=3)
    start = settings.begin(part, LINEAR, MARLIN.limits, 5.0)
    found = design(part, LINEAR, limits=MARLIN.limits, pattern=settings)
    assert found.made
    assert found.broken == {}
    assert found.outcome.converged
    assert found.pattern.mended() is found.pattern
    # Some edges are others than those that it began with.
    assert found.pattern.edges.sides.shape == start.edges.sides.shape
    assert (found.pattern.edges.sides != start.edges.sides).any()
    assert found.outcome.error < 0.01


def test_a_round_that_makes_a_design_worse_is_not_what_comes_back(monkeypatch):
    pattern = begun(cells="triangles", phases=1)
    problem = Objective(pattern, None, LINEAR, MARLIN.limits)
    ends, tried = iter([0.3, 0.1, 0.2]), []

    def optimise(own, controls, *, steps, patience, progress):
        if steps == 0:
            return Outcome(controls, 1.0, 1.0, 0.0, 0, False, 0.0)
        tried.append(controls + 1.0)
        end = next(ends)
        return Outcome(tried[-1], end, end, 0.0, 4, True, 0.0)

    def mended(self):
        return self.at(self.first + 10.0)

    monkeypatch.setattr(rounds, "optimise", optimise)
    monkeypatch.setattr(type(pattern), "mended", mended)
    found, outcome = rounds._in_rounds(problem, None, 0.1, None)
    # The third round, and mending the second once more, would lose.
    assert len(tried) == 3
    assert outcome.objective == 0.1
    assert outcome.steps == 12
    np.testing.assert_array_equal(found.first, tried[1])
    np.testing.assert_array_equal(outcome.controls, tried[1])


def test_cells_hold_what_the_whole_does():
    part = plate()
    pattern = begun(part, cells="triangles-and-centre-dual")
    xyz, porosity, volume = pattern.cells(pattern.realise(pattern.first))
    solid = float(((1 - porosity) * volume).sum() / volume.sum())
    assert solid == pytest.approx(float(LINEAR_VOLUME / (shapely.area(DISC) * 2)), rel=0.08)
    assert xyz.shape == (len(volume), 3)


def test_roads_of_a_mesh_cross_in_nodes_unless_the_job_says_no():
    for crossing in (True, False):
        pattern = begun(cells="triangles", phases=1, crossing=crossing)
        ((graph,), *_) = pattern.strokes(pattern.first)
        assert graph.crossing is crossing
    assert Mesh().crossing


def test_a_triangulation_and_its_dual_lie_on_layers_in_turn():
    pattern = begun(cells="triangles-and-centre-dual", phases=2)
    layers = [layer[0] for layer in pattern.strokes(pattern.first)]
    assert layers[0] is layers[4]
    degree = [np.median(np.bincount(each.edges.ravel())) for each in layers[:4]]
    assert degree == [6, 3, 6, 3]


def test_layers_may_differ_and_a_target_may_rise():
    part = Part.stack([DISC, DISC, shapely.box(0, 0, 40, 40)], 0.2)
    rising = Target(lambda x, y, z: 0.7 + 0 * x + 0.1 * z, "porosity")
    pattern = begun(part, rising)
    assert len(pattern.sheets) == 3
    build = planned(pattern.strokes(pattern.first), part)
    asked = sum(slab.region.area * 0.2 * (0.3 - 0.1 * (slab.z - 0.1)) for slab in part.slabs)
    assert build.volume == pytest.approx(asked, rel=0.08)


def test_what_cannot_be_meshed_is_refused_before_it_is_tried():
    for solid, said in (("0*x", "size is inf mm"), ("0.001 + 0*x", "more than half the part")):
        with pytest.raises(InputError, match=said):
            begun(target=expression(solid, quantity="solid"))
    huge = Part.plate(shapely.box(0, 0, 4000, 4000), layers=2)
    with pytest.raises(InputError, match=r"triangles; 1e\+06 at most"):
        begun(huge)
    with pytest.raises(InputError, match=r'cells: "squares" is not one of triangles'):
        Mesh(cells="squares")
