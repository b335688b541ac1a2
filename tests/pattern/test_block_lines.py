"""Lines of blocks as roads: they run on from block to block, and lie where their model has them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from joins import kinks
from outlines import OUTLINES
from shapely import LineString, Polygon, box, points, union_all
from slopes import assert_slopes

from fdjax.errors import InputError
from fdjax.grid.respaced import SpacingField
from fdjax.grid.spacing import DensitySpacing
from fdjax.limits import Limits
from fdjax.optimise.objective import Objective
from fdjax.part.blocks import Blocks
from fdjax.part.contour import circle
from fdjax.part.curve import spline
from fdjax.part.part import Part
from fdjax.pattern.auto import Auto
from fdjax.pattern.block_lines import Multiblock
from fdjax.pattern.block_pattern import BlockControls
from fdjax.plan.trace import lay
from fdjax.road.bead import section_area
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


@pytest.mark.parametrize("smooth", [False, True])
def test_gradients_agree_with_central_differences(smooth):
    ring = Polygon(circle((20, 20), 20).exterior, [circle((20, 20), 8).exterior])
    part = Part.plate(ring, layers=10)
    pattern = begun(
        ring, target=SLOPED, controls=("spacing_field", "width_field"), field_knots=(4, 5),
        smooth=smooth,
    )  # fmt: skip
    windows = SoftWindows.over(part, SLOPED.solid, 5.0, flat=True)
    windows = jax.tree.map(lambda value: jnp.asarray(value, jnp.float64), windows)
    assert_slopes(Objective(moved(pattern), windows, SLOPED, LIMITS))


def test_smooth_lines_cross_joins_without_a_kink_however_they_are_spaced():
    quads = [[(0, 0), (26, 0), (34, 30), (0, 30)], [(26, 0), (60, 0), (60, 30), (34, 30)]]
    bend = [(26, 0), (33, 10), (27, 20), (34, 30)]
    polygon = box(0, 0, 60, 30)
    blocks = Blocks.of(polygon, quads, [spline(bend)])
    most = {}
    for smooth in (False, True):
        pattern = moved(begun(polygon, blocks=quads, curves=(("spline", bend),), smooth=smooth))
        assert pattern.facts(pattern.first)["smooth"] is smooth
        most[smooth] = kinks(blocks, pattern.grid(pattern.first)).max()
    assert most[False] > 5
    assert most[True] < 0.1


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
        (OUTLINES["insole"](), ["isolines", "transfinite", "blocks"]),
        (OUTLINES["star"](), ["isolines", "blocks"]),
    ],
)
def test_auto_tries_what_suits_the_outline(polygon, names):
    assert [name for name, _ in Auto().candidates(Part.plate(polygon))] == names
    fewer = Auto(tried=("isolines",)).candidates(Part.plate(polygon))
    assert [name for name, _ in fewer] == ["isolines"]


def test_blocks_whose_lines_would_cross_are_refused_before_any_design():
    dumbbell = circle((0, 0), 20).union(circle((60, 0), 20)).union(box(0, -4, 60, 4))
    with pytest.raises(InputError, match=r"would cross at \("):
        begun(dumbbell)


def test_bands_are_cut_where_the_blocks_of_one_ask_for_too_different_numbers_of_lines():
    polygon = circle((30, 30), 30)
    around = Target(lambda x, y: 0.8 - 0.2 * jnp.hypot(x - 30, y - 30) / 30)
    even = begun(polygon, target=around)
    assert (len(even.structure.cuts), len(even.structure.bands)) == (2, 5)
    # The band that runs through the middle patch goes along the sides that are cut.
    begin, end = np.asarray(even.structure.cuts[0])[[0, -1]]
    u, v = (end - begin) / np.hypot(*(end - begin))
    across = Target(lambda x, y: 0.7 - 0.1 * (u * (x - 30) + v * (y - 30)) / 30)
    cut = begun(polygon, target=across)
    assert len(cut.structure.cuts) > 2
    assert len(cut.structure.bands) > 5
    # What each block holds as a whole is what is asked of it.
    xyz, porosity, volume = map(np.asarray, cut.cells(cut.realise(cut.first)))
    asked = np.asarray(across(xyz[:, 0], xyz[:, 1]))
    of_block = ((porosity - asked) * volume).reshape(5, -1).sum(1) / volume.reshape(5, -1).sum(1)
    assert np.abs(of_block).max() < 0.02
    assert len(begun(polygon, target=across, controls=()).structure.cuts) == 2


def test_a_single_block_begins_with_the_lines_that_bring_what_is_asked():
    pattern = begun(box(0, 0, 40, 30), mode="alternate")
    xi, eta = np.asarray(pattern.lines)
    run = 0.5 * (xi * 30 + eta * 40 + 40 + 30)  # the turns take half of both sides
    section = float(section_area(0.4, 0.2))
    assert run * section == pytest.approx(0.3 * 40 * 30 * 0.2, rel=2e-3)


def test_a_band_keeps_its_own_places_along_it_beside_longer_ones():
    pattern = moved(begun(OUTLINES["disc"]()))
    rows = [len(own) for own in pattern.first.spacing]
    assert len(set(rows)) > 1
    grid, t = pattern.grid(pattern.first), jnp.linspace(0, 1, 9)
    for number, band in enumerate(pattern.structure.bands):
        if band.closed or len(band.stretches) > 1:
            continue
        ((block, axis, turned, back),) = band.stretches
        own = SpacingField(
            jax.vmap(DensitySpacing.of)(pattern.first.spacing[number]), turned=turned
        )
        along = 1 - t if back else t
        got = (grid.u, grid.v)[axis]
        got = jax.tree.map(lambda part, block=block: part[block], got)
        np.testing.assert_allclose(
            got(t[:, None], t[None]), own(t[:, None], along[None]), atol=1e-12
        )


def test_design_knows_the_spacing_that_walls_leave():
    pattern = begun(box(0, 0, 20, 20), mode="alternate")
    penalties = pattern.penalties(pattern.realise(pattern.first), LIMITS)
    closest = 0.4 / (1 + float(penalties["spacing"].max()))
    assert closest == pytest.approx((20 - 0.4) / float(pattern.lines.max()), rel=1e-6)
