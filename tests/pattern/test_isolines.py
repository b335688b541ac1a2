"""Isolines: where design sees their material, against the roads that a plan lays."""

import jax
import jax.numpy as jnp
import pytest
import shapely
from jax.flatten_util import ravel_pytree
from outlines import OUTLINES
from slopes import assert_slopes

from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.limits import Limits
from fdjax.optimise.design import design
from fdjax.optimise.least_squares import FEW
from fdjax.optimise.objective import Objective
from fdjax.part.part import Part
from fdjax.pattern.isolines import Isolines
from fdjax.plan.compare import compare
from fdjax.plan.measure import measure
from fdjax.plan.trace import lay
from fdjax.road.window import SoftWindows
from fdjax.target.target import Target, expression

pytestmark = pytest.mark.usefixtures("compiled_once")

MARLIN = profile.load("marlin-0.4")
LINEAR = expression("0.15 + 0.35*x/80", quantity="solid")
DISC = shapely.Point(20, 20).buffer(20, quad_segs=24)
SMALL = expression("0.2 + 0.2*x/40", quantity="solid")


def begun(part, target=LINEAR, **settings):
    return Isolines(**settings).begin(part, target, MARLIN.limits, 5.0)


@pytest.mark.parametrize(("angle", "twist"), [(0.0, 0.0), (33.0, 0.0), (10.0, 90.0)])
@pytest.mark.parametrize("name", ["disc", "L", "ring"])
def test_the_deposit_is_what_a_plan_lays(name, angle, twist):
    part = Part.plate(OUTLINES[name](), layers=10, height=0.2)
    pattern = begun(part, angle=angle, twist=twist)
    modelled = float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))
    build = lay(pattern.strokes(pattern.first), part, lift_length=4.0)
    assert build.volume == pytest.approx(modelled, rel=0.01)


@pytest.mark.parametrize(("angle", "twist"), [(0.0, 0.0), (33.0, 0.0), (10.0, 90.0)])
@pytest.mark.parametrize("name", ["disc", "ring"])
def test_lines_of_all_phases_are_as_long_as_their_density_says(name, angle, twist):
    """The coarea formula: over the phases the mean length is the integral of |grad|."""
    part = Part.plate(OUTLINES[name](), layers=10, height=0.2)
    pattern = begun(part, angle=angle, twist=twist)
    free = part.regions[0].inset(0.2)
    length = {"xi": 0.0, "eta": 0.0}
    for layer in pattern.strokes(pattern.first):
        for lines in layer:
            drawn = shapely.MultiLineString(list(lines.xy))
            length[lines.family] += drawn.intersection(free).length / 5
    realised = jax.jit(lambda p: p.realise(p.first))(pattern)
    for family, density in zip(("xi", "eta"), realised.density, strict=True):
        modelled = float((density * pattern.room.area_at(0.2)).sum())
        assert length[family] == pytest.approx(modelled, rel=5e-3)


@pytest.mark.parametrize("size", [(15, 15), (30, 20), (60, 6)], ids=str)
def test_small_parts_have_coefficients_enough_for_damped_steps(size):
    pattern = begun(Part.plate(shapely.box(0, 0, *size)), SMALL)
    assert FEW < ravel_pytree(pattern.controls())[0].size < 3 * FEW
    assert begun(Part.plate(shapely.box(0, 0, *size)), SMALL, knots=(7, 8)).axes[0].count == 7


def test_of_one_layer_the_lines_of_one_family_begin_with_all_that_is_asked():
    part = Part.plate(DISC, layers=1)
    pattern = begun(part, expression("0.3", quantity="solid"), twist=0.0)
    modelled = float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))
    assert modelled == pytest.approx(0.3 * part.volume, rel=0.1)


CONTROLS = [
    ("coefficients",),
    ("p", "q"),
    ("p",),
    ("coefficients", "width"),
    ("q", "width_field"),
]


@pytest.mark.parametrize("controls", CONTROLS, ids="-".join)
def test_gradients_of_every_control_agree_with_central_differences(controls):
    part = Part.plate(DISC.difference(DISC.buffer(-14)), layers=10, height=0.2)
    pattern = begun(part, SMALL, controls=controls, knots=(8, 9), field_knots=(4, 5))
    windows = SoftWindows.over(part, SMALL.solid, 5.0, flat=True)
    assert_slopes(Objective(pattern, windows, SMALL, MARLIN.limits))


def test_a_disc_meets_its_target_in_the_roads():
    part = Part.plate(DISC, layers=10, height=0.2)
    found = design(part, SMALL, limits=MARLIN.limits)
    assert ravel_pytree(found.controls)[0].size > FEW / 2
    assert found.made
    assert found.broken == {}
    build = lay(found.strokes(), part, lift_length=4.0)
    assert compare(measure(build, window=5.0), SMALL).rms < 0.012
    assert max(len(layer.roads) for layer in build.layers) <= 3
    better = found.corrected(*build.deposits(0.5))
    again = lay(better.strokes(), part, lift_length=4.0)
    before, after = (abs(each.volume - found.volume) for each in (build, again))
    assert after < max(before, 0.003 * found.volume)


def test_layers_may_differ_and_a_target_may_rise():
    regions = [DISC] * 20 + [DISC.difference(shapely.Point(20, 20).buffer(6))] * 20
    part = Part.stack(regions, 0.2)

    def rising(x, y, z):
        return 0.65 + 0.05 * jnp.sin(x / 9) + 0.02 * z / 8

    found = design(part, rising, limits=MARLIN.limits)
    assert found.pattern.axes[2].count > 1
    assert found.outcome.error < 0.01


def test_a_plate_lower_than_a_window_may_have_a_target_that_rises():
    part = Part.plate(DISC, layers=4, height=0.2)
    found = design(part, lambda x, y, z: 0.7 + 0.05 * z + 0 * x, limits=MARLIN.limits)
    assert found.outcome.error < 0.01


def test_few_controls_are_moved_by_another_way():
    part = Part.plate(shapely.box(0, 0, 16, 11))
    few = Isolines(knots=(8, 7))
    target = Target(lambda x, y: 0.72 - 0.01 * x + 0.005 * y)
    found = design(part, target, limits=MARLIN.limits, pattern=few)
    assert ravel_pytree(found.controls)[0].size <= FEW
    build = lay(found.strokes(), part, lift_length=4.0)
    better = found.corrected(*build.deposits(0.5))
    assert found.outcome.error < 0.01
    assert better.outcome.error < 0.02


def test_a_part_narrower_than_half_a_window_is_told_so_at_once():
    with pytest.raises(InputError, match=r"window: none of 5 mm is half inside"):
        design(shapely.box(0, 0, 2, 30), SMALL, limits=MARLIN.limits)


def test_a_corrected_design_is_looked_at_anew():
    part = Part.plate(DISC, layers=10, height=0.2)
    settings = Isolines(controls=("coefficients", "width"))
    found = design(part, SMALL, limits=MARLIN.limits, pattern=settings, iterations=4)
    build = lay(found.strokes(), part, lift_length=4.0)
    better = found.corrected(*build.deposits(0.5))
    realised = better.pattern.realise(better.controls)
    assert better.road_width == tuple(map(float, better.pattern.widths(realised)))
    assert better.road_width != found.road_width


def test_what_keeps_a_design_from_its_target_is_said():
    square = Part.plate(shapely.box(0, 0, 40, 40))
    options = {"limits": MARLIN.limits, "iterations": 0, "pattern": Isolines(twist=0)}
    assert design(square, lambda x, y: 0.7 + 0 * x, **options).limited_by == []
    steep = design(square, lambda x, y: jnp.where(x < 20, 0.85, 0.55), **options)
    assert any("changes by 0.14 within 2.5 mm" in each for each in steep.limited_by)
    twisted = design(square, lambda x, y: 0.7 + 0 * x, limits=MARLIN.limits, iterations=0)
    assert [each.split(" in ")[0] for each in twisted.limited_by] == ["skew at its limit"]


def test_a_residual_of_ones_own_is_met_as_well():
    part = Part.plate(DISC, layers=10, height=0.2)

    def middle(pattern, realised):
        """How far the centre of mass lies from x = 21 mm, in units of 2 mm."""
        x, _, _, volume = pattern.deposit(realised)
        return ((volume.sum((1, 2)) * x).sum() / volume.sum() - 21.0)[None] / 2

    flat = Target(lambda x, y: 0.7 + 0 * x)
    got = []
    for terms in ((), (middle,)):
        found = design(part, flat, limits=MARLIN.limits, terms=terms)
        realised = found.pattern.realise(found.controls)
        got.append(abs(2 * float(middle(found.pattern, realised)[0])))
    assert got[0] > 0.8
    assert got[1] < 0.5 * got[0]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"angle": float("nan")}, "angle.*finite"),
        ({"controls": ("width",)}, 'one of "coefficients"'),
        ({"controls": ("coefficients", "width", "width_field")}, "exclude each other"),
        ({"phases": 1}, "phases: 1"),
        ({"controls": ("p", "q"), "knots": (5, 9)}, "at least 6"),
    ],
)
def test_settings_that_cannot_be_are_one_clear_line(settings, words):
    with pytest.raises(InputError, match=words) as caught:
        begun(Part.plate(DISC), **settings)
    assert "\n" not in str(caught.value)


def test_a_target_beyond_reach_names_the_place():
    asked = Target(lambda x, y: 0.7 - 0.68 * ((x - 30) ** 2 + (y - 20) ** 2 < 4))
    with pytest.raises(
        InputError, match=r"porosity 0\.0\d+ is asked at \((2[89]|3[01])[\d., ]+\) mm"
    ):
        begun(Part.plate(DISC), asked)
    with pytest.raises(InputError, match="nowhere wide enough"):
        begun(Part.plate(shapely.box(0, 0, 30, 0.3)))


def test_knots_finer_than_the_roads_are_warned_of():
    part = Part.plate(DISC)
    pattern = Isolines(knots=(90, 90)).begin(part, SMALL, Limits(longest_span=10.0), 5.0)
    (warning,) = pattern.facts(pattern.first)["warnings"]
    assert "finer than the roads' spacing" in warning
