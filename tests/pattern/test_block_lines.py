"""Lines of blocks as roads: they run on from block to block, and lie where their model has them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from outlines import OUTLINES
from shapely import LineString, Polygon, box, points, union_all
from slopes import assert_slopes

from fdjax.errors import InputError
from fdjax.limits import Limits
from fdjax.optimise.objective import Objective
from fdjax.part.contour import circle
from fdjax.part.part import Part
from fdjax.pattern.auto import Auto
from fdjax.pattern.block_lines import Multiblock
from fdjax.pattern.block_pattern import BlockControls
from fdjax.plan.trace import lay
from fdjax.road.window import SoftWindows
from fdjax.target.target import Target

pytestmark = pytest.mark.usefixtures("compiled_once")

LIMITS = Limits(road_width=(0.3, 0.8), longest_span=10.0)
EVEN = Target(lambda x, y: 0.7 + 0 * x)
SLOPED = Target(lambda x, y: 0.75 - 0.1 * x / 80)
ELL = Polygon([(0, 0), (40, 0), (40, 18), (18, 18), (18, 40), (0, 40)])


def begun(polygon, layers=10, target=EVEN, **settings):
    return Multiblock(**settings).begin(Part.plate(polygon, layers=layers), target, LIMITS, 5.0)


def laid(pattern, polygon):
    part = Part.plate(polygon, layers=pattern.stacking.layers)
    return lay(pattern.strokes(pattern.first), part, lift_length=4.0)


def moved(pattern, seed=0):
    """The pattern with its spacings changed at random."""
    rng = np.random.default_rng(seed)
    change = jax.tree.map(lambda c: jnp.asarray(0.15 * rng.normal(size=c.shape)), pattern.first)
    return pattern.at(change)


@pytest.mark.parametrize("name", ["L", "disc", "three holes"])
def test_lines_run_on_over_joins_and_end_at_walls_and_cuts_only(name):
    polygon = OUTLINES[name]()
    pattern = moved(begun(polygon))
    cuts = [LineString(cut) for cut in pattern.structure.cuts]
    stops = union_all([polygon.boundary, *cuts])
    for family in list(pattern.strokes(pattern.first))[:2]:
        for lines in family:
            for xy in lines.xy:
                steps = np.hypot(*np.diff(xy, axis=0).T)
                assert steps.max() < 6 * np.median(steps) + 0.5
                if (xy[0] == xy[-1]).all():
                    continue
                assert all(stops.distance(points(xy[k])) < 0.02 for k in (0, -1))


def test_the_centre_of_a_disc_is_crossed_by_lines_and_circled_by_rings():
    pattern = begun(OUTLINES["disc"]())
    closed = [band for band in pattern.structure.bands if band.closed]
    assert [len(band.stretches) for band in closed] == [4]
    layers = list(pattern.strokes(pattern.first))[:2]
    rings = [
        [xy for lines in layer for xy in lines.xy if (xy[0] == xy[-1]).all()] for layer in layers
    ]
    assert sorted(map(bool, rings)) == [False, True]
    middle = np.array([40.0, 40.0])
    for xy in max(rings, key=len):
        turn = np.unwrap(np.arctan2(*(xy - middle).T[::-1]))
        assert abs(turn[-1] - turn[0]) == pytest.approx(2 * np.pi)


@pytest.mark.parametrize("name", ["L", "disc"])
def test_the_deposit_is_what_a_plan_lays(name):
    polygon = OUTLINES[name]()
    pattern = begun(polygon, controls=())
    volume = float(pattern.deposit(pattern.realise(pattern.first)).volume.sum())
    asked = 0.3 * polygon.area * 2.0
    assert volume == pytest.approx(asked, rel=0.05)
    build = laid(pattern, polygon)
    assert build.volume + build.thinned == pytest.approx(volume, rel=0.01)


def test_gradients_agree_with_central_differences():
    ring = Polygon(circle((20, 20), 20).exterior, [circle((20, 20), 8).exterior])
    part = Part.plate(ring, layers=10)
    pattern = begun(
        ring, target=SLOPED, controls=("spacing_field", "width_field"), field_knots=(4, 5)
    )
    windows = SoftWindows.over(part, SLOPED.solid, 5.0, flat=True)
    windows = jax.tree.map(lambda value: jnp.asarray(value, jnp.float64), windows)
    assert_slopes(Objective(moved(pattern), windows, SLOPED, LIMITS))


def test_numbers_of_lines_are_scaled_alike_where_the_mean_is_missed():
    pattern = begun(ELL)
    first = pattern.whole_counts(pattern.first)
    assert pattern.counted(1.0, 1.002) is pattern
    more = pattern.counted(1.1, 1.0)
    assert more.whole_counts(pattern.first) == [
        pytest.approx(1.1 * count, abs=1.1) for count in first
    ]


def test_controls_that_exclude_each_other_are_refused():
    with pytest.raises(InputError, match="exclude each other"):
        Multiblock(controls=("spacing", "spacing_field"))
    assert begun(ELL, controls=()).first == BlockControls()


@pytest.mark.parametrize(
    ("polygon", "names"),
    [
        (OUTLINES["disc"](), ["isolines", "polar", "blocks"]),
        (OUTLINES["ring"](), ["isolines", "polar", "o-transfinite", "blocks"]),
        (box(0, 0, 40, 30), ["isolines", "transfinite", "blocks"]),
        (OUTLINES["L"](), ["isolines", "blocks"]),
        (OUTLINES["three holes"](), ["isolines", "transfinite", "blocks"]),
    ],
)
def test_auto_tries_what_suits_the_outline(polygon, names):
    assert [name for name, _ in Auto().candidates(Part.plate(polygon))] == names
    fewer = Auto(tried=("isolines",)).candidates(Part.plate(polygon))
    assert [name for name, _ in fewer] == ["isolines"]
