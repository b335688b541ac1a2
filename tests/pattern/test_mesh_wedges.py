"""What beads cover twice at nodes, against their unions as geometry, and designs by it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from slopes import assert_slopes

from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.mesh.triangulation import delaunay
from fdjax.optimise.design import design
from fdjax.optimise.objective import Objective
from fdjax.part.part import Part
from fdjax.pattern.mesh import CELLS, Mesh
from fdjax.pattern.mesh_wedges import excess
from fdjax.plan.compare import compare
from fdjax.plan.counted import deposits, total
from fdjax.plan.measure import measure
from fdjax.plan.trace import lay
from fdjax.road.window import SoftWindows
from fdjax.target.target import expression

pytestmark = pytest.mark.usefixtures("compiled_once")

LIMITS = profile.load("marlin-0.4").limits
DISC = shapely.Point(20, 20).buffer(20, quad_segs=24).difference(shapely.Point(14, 24).buffer(4))
LINEAR = expression("0.15 + 0.2*x/40", quantity="solid")
RADIUS, LENGTH = 0.2, 5.0


def around(angles):
    """Wedges of a node in the origin with edges at these angles."""
    ends = LENGTH * np.stack([np.cos(angles), np.sin(angles)], 1)
    return np.stack([np.zeros_like(ends), ends, np.roll(ends, -1, 0)], 1)


def union_of(ends):
    lines = [shapely.LineString([(0, 0), end]) for end in ends]
    beads = [line.buffer(RADIUS, quad_segs=256) for line in lines]
    return shapely.union_all(beads).area


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(0.25, 4), min_size=2, max_size=7), st.floats(0, 6))
def test_the_beads_at_a_node_cover_less_than_they_hold_by_the_excess(turns, first):
    angles = first + 2 * np.pi * np.cumsum(turns) / np.sum(turns)
    assume(np.min(turns) > 0.025 * np.sum(turns))
    wedges = around(angles)
    held = len(angles) * (2 * RADIUS * LENGTH + np.pi / 2 * RADIUS**2)
    twice = float(excess(jnp.asarray(wedges), RADIUS, RADIUS).sum())
    assert held - twice == pytest.approx(union_of(wedges[:, 1]), abs=1e-4)


def test_all_triangles_of_random_nodes_are_covered_as_told():
    mesh = delaunay(np.random.default_rng(4).uniform(0, 40, (150, 2)))
    corner = mesh.xy[mesh.triangles]
    side = np.hypot(*np.moveaxis(np.roll(corner, -1, 1) - corner, 2, 0))
    twice = sum(
        np.asarray(excess(jnp.asarray(np.roll(corner, -k, 1)), RADIUS, RADIUS)) for k in range(3)
    )
    covered = RADIUS * side.sum(1) - twice
    face = shapely.polygons(corner)
    left = shapely.area(shapely.buffer(face, -RADIUS, join_style="mitre", mitre_limit=99))
    # Smaller angles than 0.1 radians count as these.
    told = (left > 0) & (mesh.angles.min(1) > 6)
    assert told.sum() > 200
    assert covered[told] == pytest.approx((shapely.area(face) - left)[told], rel=1e-6)


def test_the_slopes_of_the_excess_are_those_of_differences():
    rng = np.random.default_rng(2)
    xy = jnp.asarray(rng.normal(size=(40, 3, 2)))
    slope = jax.grad(lambda xy: excess(xy, 0.2, 0.3).sum())(xy)
    for _ in range(3):
        way = jnp.asarray(rng.normal(size=xy.shape))
        h = 1e-6
        ahead, back = (float(excess(xy + s * h * way, 0.2, 0.3).sum()) for s in (1, -1))
        assert float((slope * way).sum()) == pytest.approx((ahead - back) / (2 * h), rel=1e-6)
    straight = jnp.array([[(0.0, 0), (1, 0), (-1, 0)]])
    bends = [excess(straight.at[0, 2, 1].set(y), 0.2, 0.2)[0] for y in (-1e-4, 0.0, 1e-4)]
    assert float(bends[0] - 2 * bends[1] + bends[2]) == pytest.approx(0, abs=1e-10)


def begun(cells, part, **settings):
    return Mesh(cells=cells, count="coverage", **settings).begin(part, LINEAR, LIMITS, 5.0)


def planned(strokes, part):
    return lay(strokes, part, lift_length=4.0, least_road=1.0, clearance=5e-3)


@pytest.mark.parametrize("cells", CELLS)
@pytest.mark.parametrize("walls", [False, True])
def test_the_deposit_is_what_a_plan_covers(cells, walls):
    part = Part.plate(DISC, layers=10, height=0.2)
    pattern = begun(cells, part, walls=walls)
    modelled = float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))
    build = planned(pattern.strokes(pattern.first), part)
    assert total(build, "coverage") == pytest.approx(modelled, rel=0.003)
    if not walls:
        asked = shapely.area(DISC) * 2.0 * (0.15 + 0.2 * shapely.centroid(DISC).x / 40)
        assert modelled == pytest.approx(float(asked), rel=0.03)


def test_gradients_agree_with_central_differences():
    part = Part.plate(DISC, layers=2, height=0.2)
    pattern = begun("triangles-and-voronoi-dual", part, phases=1)
    windows = SoftWindows.over(part, LINEAR.solid, 5.0, flat=True)
    assert_slopes(Objective(pattern, windows, LINEAR, LIMITS), scaled=False)


def test_cells_hold_what_is_covered_of_them():
    part = Part.plate(DISC, layers=2, height=0.2)
    shares = []
    for count in ("volume", "coverage"):
        pattern = Mesh(count=count, phases=2).begin(part, LINEAR, LIMITS, 5.0)
        _, porosity, volume = pattern.cells(pattern.realise(pattern.first))
        shares.append(float(((1 - porosity) * volume).sum() / volume.sum()))
    assert shares[1] == pytest.approx(shares[0], rel=0.06)
    assert float((1 - porosity).max()) < 0.9


def test_a_design_meets_its_target_by_what_its_roads_cover():
    part = Part.plate(DISC, layers=4, height=0.2)
    found = design(part, LINEAR, limits=LIMITS, pattern=Mesh(count="coverage", phases=4))
    build = planned(found.strokes(), part)
    better = planned(found.corrected(*deposits(build, 1.25, "coverage")).strokes(), part)
    covered = compare(measure(better, window=5.0, count="coverage"), LINEAR)
    assert covered.rms < 0.01
    assert total(better, "coverage") == pytest.approx(found.volume, rel=0.003)
    # The volume of the same roads is another: rounded sides take off it, nodes add to it.
    assert compare(measure(better, window=5.0), LINEAR).rms > 1.3 * covered.rms


def test_what_does_not_count_so_is_refused():
    with pytest.raises(InputError, match="coverage is of edges; polygons meet in no nodes"):
        Mesh(count="coverage", laid="polygons")
    with pytest.raises(InputError, match='count: "area" is not one of volume, coverage'):
        Mesh(count="area")
