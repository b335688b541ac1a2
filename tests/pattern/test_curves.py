"""Space-filling curves: their closed form against what a plan lays, and a design of one."""

import jax
import numpy as np
import pytest
import shapely
from outlines import OUTLINES
from slopes import assert_slopes

from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.optimise.design import design
from fdjax.optimise.objective import Objective
from fdjax.part.part import Part
from fdjax.pattern.curve_order import NAMES, rank
from fdjax.pattern.curves import Curves
from fdjax.plan.compare import compare
from fdjax.plan.measure import measure
from fdjax.plan.trace import lay
from fdjax.road.window import SoftWindows
from fdjax.target.target import expression

pytestmark = pytest.mark.usefixtures("compiled_once")

MARLIN = profile.load("marlin-0.4")
EVEN = expression("0.35", quantity="solid")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("turned", "mirrored"), [(False, "no"), (True, "no"), (True, "both")])
def test_the_deposit_is_what_a_plan_lays(name, turned, mirrored):
    part = Part.plate(OUTLINES["disc"](), layers=10, height=0.2)
    settings = Curves(curve=name, turned=turned, mirrored=mirrored)
    pattern = settings.begin(part, EVEN, MARLIN.limits, 5.0)
    modelled = float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))
    build = lay(pattern.strokes(pattern.first), part, lift_length=4.0, least_road=1.0)
    assert build.volume == pytest.approx(modelled, rel=0.015)
    assert [len(layer.roads) for layer in build.layers] == [1] * 10


@pytest.mark.parametrize("depths", [1, 2])
def test_halved_steps_lay_what_the_model_has(depths):
    part = Part.plate(OUTLINES["disc"](), layers=10, height=0.2)
    target = expression("0.5 - 0.4*min(1, hypot(x - 40, y - 40)/40)", quantity="solid")
    pattern = Curves(depths=depths).begin(part, target, MARLIN.limits, 5.0)
    realised = jax.jit(lambda p: p.realise(p.first))(pattern)
    inside = np.asarray(pattern.room.area[0, ..., 0]) > 0
    assert np.asarray(realised.times)[..., 0][inside].max() > 1.9
    modelled = float(pattern.deposit(realised).volume.sum())
    build = lay(pattern.strokes(pattern.first), part, lift_length=4.0, least_road=1.0)
    assert build.volume == pytest.approx(modelled, rel=0.02)
    assert [len(layer.roads) for layer in build.layers] == [1] * 10
    facts = pattern.facts(pattern.first)
    assert facts["depths"] == depths
    shortest = min(road.segment_lengths.min() for layer in build.layers for road in layer.roads)
    assert shortest < facts["gap"]


def test_gradients_of_the_depth_agree_with_central_differences():
    disc = shapely.Point(20, 20).buffer(20, quad_segs=24)
    part = Part.plate(disc.difference(disc.buffer(-14)), layers=10, height=0.2)
    target = expression("0.2 + 0.25*x/40", quantity="solid")
    pattern = Curves(depths=2, knots=(8, 9)).begin(part, target, MARLIN.limits, 5.0)
    windows = SoftWindows.over(part, target.solid, 5.0, flat=True)
    assert_slopes(Objective(pattern, windows, target, MARLIN.limits))


def test_even_targets_are_left_to_the_chart():
    part = Part.plate(OUTLINES["disc"](), layers=10, height=0.2)
    for solid, depths in (("0.3", 0), ("0.15 + 0.3*x/80", 1)):
        target = expression(solid, quantity="solid")
        pattern = Curves().begin(part, target, MARLIN.limits, 5.0)
        assert (pattern.finest, pattern.first.times is None) == (2.0**depths, not depths)


def test_steps_under_a_roads_width_are_refused():
    part = Part.plate(shapely.box(0, 0, 20, 20), layers=2, height=0.2)
    target = expression("0.95", quantity="solid")
    with pytest.raises(InputError, match=r"machine \(0\.376 mm apart is less than 0\.4\); change"):
        Curves().begin(part, target, MARLIN.limits, 5.0)


def test_turned_layers_are_the_drawing_turned_in_its_plane():
    part = Part.plate(shapely.box(0, 0, 20, 20), layers=2, height=0.2)
    pattern = Curves(phases=1).begin(part, EVEN, MARLIN.limits, 5.0)
    (first,), (second,) = pattern.strokes(pattern.first)
    steps = [np.nanmedian(np.diff(each.xy, axis=0), axis=(0, 1)) for each in (first, second)]
    across = np.nanmedian(np.diff(first.xy, axis=1), axis=(0, 1))
    assert steps[0] @ steps[1] == pytest.approx(0, abs=1e-6)
    assert steps[1] == pytest.approx(across, abs=1e-6)


@pytest.mark.parametrize(
    ("mirrored", "axes"),
    [("xi", [(), (0,)]), ("eta", [(), (1,)]), ("both", [(), (0,), (0, 1), (1,)])],
)
def test_mirrored_layers_go_the_other_way_along_the_drawings_axes(mirrored, axes):
    part = Part.plate(shapely.box(0, 0, 20, 20), layers=len(axes), height=0.2)
    settings = Curves(phases=1, turned=False, mirrored=mirrored)
    pattern = settings.begin(part, EVEN, MARLIN.limits, 5.0)
    first, *others = (stroke for (stroke,) in pattern.strokes(pattern.first))
    for stroke, axis in zip(others, axes[1:], strict=True):
        assert stroke.xy == pytest.approx(first.xy, nan_ok=True)
        assert (np.flip(first.rank, axis) == stroke.rank).all()
        assert (first.rank != stroke.rank).any()


def test_a_disc_meets_its_target_in_one_road_a_layer():
    disc = shapely.Point(20, 20).buffer(20, quad_segs=24)
    part = Part.plate(disc, layers=10, height=0.2)
    target = expression("0.2 + 0.2*x/40", quantity="solid")
    found = design(part, target, limits=MARLIN.limits, pattern=Curves())
    build = lay(found.strokes(), part, lift_length=4.0)
    for _ in range(2):
        found = found.corrected(*build.deposits(1.25))
        build = lay(found.strokes(), part, lift_length=4.0)
    assert compare(measure(build, window=5.0), target).rms < 0.02
    assert [len(layer.roads) for layer in build.layers] == [1] * 10


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (8, 8), (13, 29)])
def test_a_curve_goes_through_each_square_once(name, shape):
    assert len(np.unique(rank(name, shape))) == shape[0] * shape[1]


@pytest.mark.parametrize(
    ("name", "side"), [("hilbert", 16), ("peano", 27), ("meander", 20), ("sierpinski", 16)]
)
def test_a_curve_goes_from_each_square_to_a_neighbour(name, side):
    order = np.argsort(rank(name, (side, side)).ravel())
    step = np.abs(np.diff(np.stack(np.divmod(order, side), 1), axis=0))
    assert step.max() == 1
    # Sierpinski's goes across corners, too.
    assert (step.sum(1) == 1).mean() > (0.8 if name == "sierpinski" else 0.999)


def test_gospers_curve_goes_to_one_of_six_neighbours_where_it_stays_inside():
    order = np.argsort(rank("gosper", (40, 40)).ravel())
    step = np.diff(np.stack(np.divmod(order, 40), 1), axis=0)
    six = {(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)}
    assert np.mean([tuple(each) in six for each in step.tolist()]) > 0.97
