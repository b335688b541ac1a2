"""Embedded grids: where fine lines lie, how they join the base's, and what they bring."""

from itertools import combinations
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from shapely import Polygon, box
from slopes import assert_slopes

from fdjax.errors import InputError
from fdjax.keys import Place
from fdjax.limits import Limits
from fdjax.optimise.design import design
from fdjax.optimise.objective import Objective
from fdjax.part.contour import circle
from fdjax.part.part import Part
from fdjax.pattern.embedded import Embedded, Zone
from fdjax.pattern.embedding import EMBEDDED, Wanted
from fdjax.pattern.map_lines import MapLines
from fdjax.plan.compare import compare
from fdjax.plan.measure import measure
from fdjax.plan.trace import lay
from fdjax.road.window import SoftWindows
from fdjax.target.target import Target

pytestmark = pytest.mark.usefixtures("compiled_once")

LIMITS = Limits(road_width=(0.3, 0.8), longest_span=12.0)
PLATE = box(0, 0, 60, 40)
EVEN = Target(lambda x, y: 0.8 + 0 * x)
CELLS = ((3, 7), (2, 6))
"""From the third to the seventh xi line, and from the second to the sixth eta line."""


def begun(*wanted, layers=2, target=EVEN, part=PLATE, **settings):
    given = {"map": "uniform", "mode": "alternate", "controls": (), "lines": (16, 11)}
    pattern = MapLines(**{**given, **settings, "embedded": wanted})
    return pattern.begin(Part.plate(part, layers=layers), target, LIMITS, 5.0)


def laid(pattern, part=PLATE):
    part = Part.plate(part, layers=pattern.stacking.layers)
    return lay(pattern.strokes(pattern.first), part, lift_length=4.0)


def lengths(pattern):
    """Length of the lines of each family, mm, as they are before they are cut."""
    found = {}
    for (lines,) in pattern.strokes(pattern.first):
        found[lines.family] = sum(float(np.hypot(*np.diff(xy, axis=0).T).sum()) for xy in lines.xy)
    return found


def zone(outline, refine, fade=2.0):
    return Zone.of(outline, refine, fade=fade, base=PLATE, resolution=0.25)


def test_zones_multiply_lines_inside_and_half_so_at_their_border():
    nested = Embedded((zone(box(10, 10, 40, 30), 2), zone(box(20, 15, 30, 25), 3)))
    at = np.array([[5.0, 5.0], [10.0, 20.0], [15.0, 20.0], [20.0, 20.0], [25.0, 20.0]])
    np.testing.assert_allclose(nested.times(at), [1, 1.5, 2, 4, 6], atol=1e-9)
    np.testing.assert_allclose(nested.times(jnp.asarray(at)), nested.times(at))
    # Walls are no borders.
    cut = Embedded((zone(box(0, 0, 20, 40), 2),))
    at = np.array([[0.2, 0.2], [10.0, 39.9], [20.0, 40.0], [22.0, 0.1]])
    np.testing.assert_allclose(cut.times(at), [2, 2, 1.5, 1], atol=1e-4)
    np.testing.assert_allclose(Embedded((zone(PLATE, 3),)).times(at), 3)
    assert nested.parts == 6
    assert Embedded((zone(box(0, 0, 9, 9), 2), zone(box(20, 0, 29, 9), 3))).parts == 6
    assert Embedded((zone(box(0, 0, 9, 9), 2), zone(box(20, 0, 29, 9), 2))).parts == 2


@pytest.mark.parametrize("refine", [2, 3, 4])
def test_fine_lines_are_as_long_as_the_cells_they_divide(refine):
    step_xi, step_eta = (60 - 0.4) / 16, (40 - 0.4) / 11
    pattern = begun(Wanted(refine, cells=CELLS), mode="both")
    for xi, eta in pattern.strokes(pattern.first):
        fine = [np.asarray(xy) for xy in xi.xy if np.ptp(xy[:, 1]) < 39]
        assert len(fine) == 4 * (refine - 1)
        for xy in fine:
            assert np.ptp(xy[:, 0]) < 1e-9
            np.testing.assert_allclose(
                xy[[0, -1], 1], 0.2 + (np.array([2, 6]) - 0.5) * step_eta, atol=1e-9
            )
        at = 0.2 + (3 - 0.5) * step_xi + np.arange(4 * refine + 1) * step_xi / refine
        places = np.sort([xy[0, 0] for xy in fine])
        np.testing.assert_allclose(places, np.delete(at, slice(None, None, refine)), atol=1e-9)
        assert len(eta.xy) == 11 + 4 * (refine - 1)


@pytest.mark.parametrize(("refine", "pairs"), [(2, 2), (3, 4)])
def test_lines_that_take_fine_ones_are_longer_by_these_and_four_turns_a_pair(refine, pairs):
    plain, fine = lengths(begun()), lengths(begun(Wanted(refine, cells=CELLS)))
    step = {"xi": (60 - 0.4) / 16, "eta": (40 - 0.4) / 11}
    clear = 1.1 * 0.4
    for family, other in (("xi", "eta"), ("eta", "xi")):
        more = 4 * (refine - 1) * 4 * step[other]
        turns = pairs * 4 * step[family] / refine
        # Where a road comes to the border twice it stays off by a road.
        short = pairs * (4 if refine == 2 else 2) * clear
        got = fine[family] - plain[family]
        assert got == pytest.approx(more + turns - short, abs=1e-6)


ZONES = {
    "nested": (Wanted(2, box(12, 8, 40, 30)), Wanted(2, box(20, 12, 32, 22))),
    "at walls": (Wanted(3, box(-5, -5, 20, 20)), Wanted(2, box(40, 20, 70, 50))),
    "everywhere": (Wanted(2, box(-1, -1, 61, 41)),),
    "round": (Wanted(2, circle((30, 20), 13)),),
    "side by side": (Wanted(2, box(10, 8, 30, 30)), Wanted(3, box(30, 8, 50, 30))),
    "over each other": (Wanted(2, box(10, 8, 35, 30)), Wanted(2, box(25, 15, 50, 38))),
}


def assert_apart(build, outline):
    """No roads cross or touch within a layer, and all stay inside."""
    for layer in build.layers:
        courses = [shapely.LineString(road.path) for road in layer.roads]
        assert all(course.is_simple for course in courses)
        for a, b in combinations(courses, 2):
            assert a.distance(b) > 0.9 * 0.4
        assert shapely.union_all(courses).within(outline.buffer(-0.19))


@pytest.mark.parametrize("wanted", ZONES.values(), ids=ZONES)
def test_no_roads_cross_or_touch_within_a_layer_and_all_stay_inside(wanted):
    pattern = begun(*wanted, layers=4, mode="alternate-staggered", phases=2)
    assert_apart(laid(pattern), PLATE)


def test_few_roads_lie_where_lines_run_through_a_zone():
    build = laid(begun(*ZONES["nested"]))
    assert max(len(layer.roads) for layer in build.layers) <= 3


def test_the_base_stays_as_it_is():
    plain, fine = begun(), begun(Wanted(2, cells=CELLS), mode="both")
    ((base,), _), ((xi, _), _) = plain.strokes(plain.first), fine.strokes(fine.first)
    for line in base.xy:
        assert any(np.array_equal(line, other) for other in xi.xy if len(other) == len(line))


RING, AROUND = (
    Polygon(circle((0, 0), outer).exterior, [circle((0, 0), inner).exterior])
    for outer, inner in ((30, 10), (24, 16))
)
RING_ZONES = {
    "nested over the seam": (Wanted(2, box(13, -14, 28, 16)), Wanted(2, box(16, -5, 24, 6))),
    "away from it": (Wanted(3, box(-26, -8, -13, 9)),),
    "around": (Wanted(2, AROUND),),
    "around, and across it": (Wanted(2, AROUND), Wanted(2, box(12, -12, 28, 12))),
    "everywhere": (Wanted(2, circle((0, 0), 31)),),
}


def ring_begun(*wanted, **settings):
    given = {"map": "polar", "lines": (7, 36), "mode": "alternate-staggered", "phases": 2}
    return begun(*wanted, part=RING, **{**given, **settings})


@pytest.mark.parametrize("wanted", RING_ZONES.values(), ids=RING_ZONES)
def test_on_rings_no_roads_cross_or_touch_and_all_stay_inside(wanted):
    pattern = ring_begun(*wanted, layers=4)
    assert_apart(laid(pattern, RING), RING)


def test_on_rings_fine_lines_lie_between_lines_that_a_design_has_moved():
    pattern = ring_begun(
        *RING_ZONES["nested over the seam"], layers=4, controls=("spacing_field", "width_field")
    )
    rng = np.random.default_rng(0)
    change = jax.tree.map(lambda c: 0.08 * rng.normal(size=c.shape), pattern.first)
    moved = pattern.at(jax.tree.map(lambda c, d: c + jnp.asarray(d), pattern.first, change))
    for layer in laid(moved, RING).layers:
        courses = [shapely.LineString(road.path) for road in layer.roads]
        assert all(course.is_simple for course in courses)
        assert min(a.distance(b) for a, b in combinations(courses, 2)) > 0.3


@pytest.mark.parametrize("first", [3, 46])
def test_on_rings_fine_lines_are_as_long_as_the_cells_they_divide_over_the_seam_too(first):
    wanted = Wanted(2, cells=((3, 7), (first, first + 10)))
    settings = {"lines": (10, 50), "mode": "both"}
    plain, fine = (ring_begun(*w, layers=1, **settings) for w in ((), (wanted,)))
    ((base, rays),), ((xi, eta),) = (list(p.strokes(p.first)) for p in (plain, fine))
    assert len(xi.xy) == len(base.xy) + 4
    assert len(eta.xy) == len(rays.xy) + 10
    step = (30 - 10 - 0.4) / 10
    radii = 10.2 + step * (np.arange(3, 7))
    arcs = sorted((xy for xy in xi.xy if (xy[0] != xy[-1]).any()), key=lambda xy: np.hypot(*xy[0]))
    for xy, radius in zip(arcs, radii, strict=True):
        np.testing.assert_allclose(np.hypot(*xy.T), radius, atol=1e-6)
        turn = np.unwrap(np.arctan2(*xy.T[::-1]))
        assert turn[-1] - turn[0] == pytest.approx(2 * np.pi * 10 / 50)
    short = [xy for xy in eta.xy if np.ptp(np.hypot(*xy.T)) < 15]
    assert len(short) == 10
    for xy in short:
        np.testing.assert_allclose(np.hypot(*xy[[0, -1]].T), 10.2 + step * np.array([2.5, 6.5]))


def test_circles_of_a_zone_all_around_are_closed():
    fine = ring_begun(*RING_ZONES["around"], layers=2)
    (xi,), _ = fine.strokes(fine.first)
    assert all((xy[0] == xy[-1]).all() for xy in xi.xy)
    (base,), _ = ring_begun().strokes(ring_begun().first)
    assert len(xi.xy) > len(base.xy)


@pytest.mark.parametrize("name", ["nested over the seam", "around"])
def test_on_rings_the_model_has_what_is_laid(name):
    pattern = ring_begun(*RING_ZONES[name], layers=20, phases=5, lines=(9, 45))
    deposit = pattern.deposit(pattern.realise(pattern.first))
    build = laid(pattern, RING)
    assert build.volume == pytest.approx(float(deposit.volume.sum()), rel=0.015)


RING_STEP = Target(lambda x, y: 0.86 - 0.16 * ((abs(x - 20) < 6) & (abs(y) < 8)))


def test_on_rings_zones_lie_where_the_target_asks():
    found = ring_begun(Wanted(2), target=RING_STEP, controls=("spacing",), lines=None)
    (zone,) = found.embedded.zones
    asked = box(14, -8, 26, 8)
    assert zone.outline.symmetric_difference(asked).area < 0.3 * asked.area


@pytest.mark.parametrize("mode", ["alternate-staggered", "both-staggered"])
@pytest.mark.parametrize("name", ["nested", "at walls", "everywhere"])
def test_the_model_has_what_is_laid(name, mode):
    pattern = begun(*ZONES[name], layers=10, mode=mode, lines=(24, 18))
    deposit = pattern.deposit(pattern.realise(pattern.first))
    build = laid(pattern)
    assert build.volume == pytest.approx(float(deposit.volume.sum()), rel=0.012)
    places, volumes = build.deposits(1.0)
    for x in (15.0, 30.0, 45.0):
        modelled = float(deposit.volume[deposit.xyz[:, 0] < x].sum())
        assert volumes[places[:, 0] < x].sum() == pytest.approx(modelled, rel=0.03)


def test_gradients_are_those_of_finite_differences():
    target = Target(lambda x, y: 0.82 - 0.1 * jnp.exp(-((x - 30) ** 2 + (y - 20) ** 2) / 90))
    pattern = begun(*ZONES["nested"], target=target, controls=("spacing",), lines=None)
    part = Part.plate(PLATE, layers=2)
    windows = SoftWindows.over(part, target.solid, 5.0, flat=True)
    assert_slopes(Objective(pattern, windows, target, LIMITS, 1e-4))


STEP = Target(lambda x, y: 0.84 - 0.16 * ((abs(x - 30) < 10) & (abs(y - 20) < 8)))


def test_a_step_is_met_better_with_a_zone_than_by_any_base_alone_and_so_is_the_mean():
    part = Part.plate(PLATE, layers=10)
    settings = MapLines(map="uniform", embedded=(Wanted(2),))
    made = design(part, STEP, limits=LIMITS, pattern=settings, iterations=12)
    build = lay(made.strokes(), part, lift_length=4.0)
    made = made.recounted(build.volume)
    seen = compare(measure(lay(made.strokes(), part, lift_length=4.0), window=5.0), STEP)
    assert seen.mean_got == pytest.approx(seen.mean_asked, abs=1.5e-3)
    # Straight lines square to each other bring a sum of what each family does.
    asked = seen.asked
    sums = asked.mean(0, keepdims=True) + asked.mean(1, keepdims=True) - asked.mean()
    assert seen.rms < 0.4 * np.sqrt(((asked - sums) ** 2).mean())


def test_zones_lie_where_the_target_asks_and_nowhere_if_the_base_can():
    found = begun(Wanted(2), Wanted(2), target=STEP, controls=("spacing",), lines=None)
    (zone,) = found.embedded.zones
    asked = box(20, 12, 40, 28)
    assert zone.outline.symmetric_difference(asked).area < 0.15 * asked.area
    slope = Target(lambda x, y: 0.85 - 0.2 * x / 60)
    assert begun(Wanted(2), target=slope, controls=("spacing",), lines=None).embedded.zones == ()


@pytest.mark.parametrize(
    ("wanted", "settings", "error"),
    [
        ((Wanted(2, box(70, 0, 80, 10)),), {}, r"region 1, at \(75, 5\), lies outside"),
        ((Wanted(2, box(10, 10, 11, 11)),), {}, "region 1.* smaller than a cell.*3.69 mm"),
        ((Wanted(8, box(5, 5, 50, 35)),), {"lines": (60, 40)}, "refine by 2 at most"),
        ((Wanted(8, box(5, 5, 50, 35)),) * 3, {}, "more than 64 parts"),
        ((Wanted(2, cells=((3, 20), (2, 4))),), {}, "xi line 3 to 20; they rise from 0 to 17"),
        (
            (Wanted(2, box(5, 5, 50, 35)),),
            {"map": "polar", "spiral": True},
            "a spiral has no cells",
        ),
        (
            (Wanted(2, box(5, 5, 9, 9)),),
            {"map": "polar", "part": circle((0, 0), 20)},
            "a disc has no cells",
        ),
        (
            (Wanted(2, cells=((1, 3), (0, 3))),),
            {"map": "polar", "part": RING, "lines": (8, 40)},
            "eta line 0 to 3; they begin at 1 to 40",
        ),
    ],
)
def test_what_cannot_be_embedded_is_said_in_one_line(wanted, settings, error):
    with pytest.raises(InputError, match=error) as raised:
        begun(*wanted, **settings)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("value", "error"),
    [
        ("car", "neither"),
        ([{"region": "auto", "refin": 2}], "is no zone"),
        ([{"refine": 2}], "needs one of"),
        ([{"region": "auto", "points": [[0, 0], [1, 0], [1, 1]]}], "needs one of"),
        ([{"region": "auto", "refine": 1}], "2 to 8"),
        ([{"region": "POINT (1 2)"}], r"embedded\[0\].region: .*POINT"),
        ([{"region": "none.wkt"}], "cannot be read"),
        ([{"points": [[0, 0], [9, 9], [9, 0], [0, 9]]}], "cross"),
        ([{"cells": [[1, 2]]}], "2 are needed"),
    ],
)
def test_what_is_no_zone_is_said_with_its_place(value, error):
    with pytest.raises(InputError, match=error) as raised:
        EMBEDDED.read(value, Place("job.toml", "[pattern]", "embedded", Path()))
    assert str(raised.value).startswith("job.toml: [pattern] embedded")
