"""Lines of C-grids as roads: the cut leaves no trace in them."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box

from fdjax.errors import InputError
from fdjax.limits import Limits
from fdjax.part.contour import circle
from fdjax.part.part import Part
from fdjax.pattern.map_lines import MapLines
from fdjax.pattern.slit_lines import around, eta_places, xi_places
from fdjax.plan.check import check
from fdjax.plan.trace import lay
from fdjax.target.target import Target

pytestmark = pytest.mark.usefixtures("compiled_once")

LIMITS = Limits(road_width=(0.3, 0.8), longest_span=20.0)
PART = Polygon(box(0, 0, 60, 50).exterior, [circle((26, 23), 8).exterior])
EVEN = Target(lambda x, y: 0.7 + 0 * x)
PHASES = 3


def begun(polygon=PART, layers=2 * PHASES, **settings):
    given = {
        "map": "c-elliptic", "phases": PHASES, "controls": (), "lines": (9, 60), "nodes": (9, 33),
        "cut": (60.0, 25.0), **settings,
    }  # fmt: skip
    return MapLines(**given).begin(Part.plate(polygon, layers=layers), EVEN, LIMITS, 5.0)


@pytest.fixture(scope="module")
def made():
    pattern = begun()
    part = Part.plate(PART, layers=pattern.stacking.layers)
    return pattern, lay(pattern.strokes(pattern.first), part, lift_length=4.0)


@pytest.mark.parametrize("phases", [1, 2, 3, 4, 5, 7])
@pytest.mark.parametrize("count", [8, 9])
def test_each_phase_comes_around_the_hole_to_the_one_that_mirrors_it(phases, count):
    share = np.linspace(0, 1, 201)
    u = xi_places(share, count * phases, phases)
    assert u.shape == (count * phases, 201)
    assert (u > 0).all()
    assert (u < 1).all()
    for phase in range(phases):
        lines = u[phase::phases]
        assert (np.diff(lines, axis=0) > 0.99 / count).all()
        # One spacing across the cut, as everywhere.
        assert lines[0, 0] + lines[0, -1] == pytest.approx(1 / count)
        np.testing.assert_allclose(lines[:, 0] + lines[:, -1], (2 * np.arange(count) + 1) / count)
    # Together they lie evenly on both sides, and nowhere more than two thirds of them on one place.
    for end in (0, -1):
        np.testing.assert_allclose(np.sort(u[:, end]), (np.arange(len(u)) + 0.5) / len(u))
    np.testing.assert_allclose(u.mean(0), 0.5)


@pytest.mark.parametrize("comb", [90, 91, 92, 93, 94])
def test_lines_from_both_sides_meet_on_the_cut_whatever_their_number(comb):
    tail, phases = 0.23, 5
    even = (np.arange(comb) + 0.5) / comb
    v = eta_places(around(even, tail), comb, phases)
    for phase in range(phases):
        lines = v[phase::phases]
        assert (np.diff(lines) > 0.7 * phases / comb).all()
        near, far = lines[lines < tail], lines[lines > 1 - tail]
        np.testing.assert_allclose(near, 1 - far[::-1], atol=1e-12)


def test_lines_of_constant_xi_are_one_road_with_one_spacing_across_the_cut(made):
    _, build = made
    for layer in build.layers[::2]:
        (road,) = layer.roads
        for x in (46.0, 52.0, 57.0):
            hits = shapely.intersection(LineString(road.path), LineString([(x, 0), (x, 50)]))
            y = np.sort([point.y for point in shapely.get_parts(hits)])
            assert len(y) == 18
            gaps = np.diff(y)
            # Neighbouring gaps change slowly, those across the cut and beside it with them.
            assert np.abs(np.diff(gaps[5:-5])).max() < 0.12 * gaps.mean()


def test_lines_of_constant_eta_run_straight_through_the_cut(made):
    _, build = made
    for layer in build.layers[1::2]:
        cut = LineString([(41, 24), (56, 25)]).buffer(3.0, cap_style="flat")
        crossing = [
            piece
            for road in layer.roads
            for piece in shapely.get_parts(shapely.intersection(LineString(road.path), cut))
            if piece.length > 4.0
        ]
        assert len(crossing) >= 8
        for piece in crossing:
            way = np.diff(np.asarray(piece.coords), axis=0)
            turn = np.angle(np.exp(1j * np.diff(np.arctan2(way[:, 1], way[:, 0]))))
            assert np.abs(turn).max(initial=0.0) < 0.05
            assert piece.length > 5.9


def test_no_roads_cross_or_lie_on_one_another(made):
    _, build = made
    found = [each for each in check(build, LIMITS) if each.severity == "error"]
    assert found == []
    assert build.thinned < 0.01 * build.volume


def test_the_deposit_is_that_of_the_roads(made):
    pattern, build = made
    deposit = pattern.deposit(pattern.realise(pattern.first))
    # Lines are squeezed off the walls to first order.
    assert build.volume == pytest.approx(float(deposit.volume.sum()), rel=8e-3)
    assert shapely.contains_xy(PART, *np.asarray(deposit.xyz)[:, :2].T).all()


def test_gradients_of_the_deposit_are_those_of_central_differences():
    pattern = begun(
        controls=("spacing_field", "phi", "psi", "width_field"), field_knots=(5, 7), layers=2,
        mode="alternate", lines=(7, 30), nodes=(7, 25),
    )  # fmt: skip
    rng = np.random.default_rng(5)
    weight = jnp.asarray(rng.normal(size=2))

    def moment(controls):
        points = pattern.deposit(pattern.realise(controls))
        return (points.volume * jnp.cos(points.xyz[:, :2] @ weight / 8)).sum()

    leaves, shape = jax.tree.flatten(pattern.first)
    at = shape.unflatten([leaf + 0.2 * rng.normal(size=leaf.shape) for leaf in leaves])
    way = shape.unflatten([rng.normal(size=leaf.shape) for leaf in leaves])
    value = jax.jit(moment)
    gradient = jax.jit(jax.grad(moment))(at)
    # Short: walls have corners, and slopes there jump where a place that is looked at passes one.
    step = 1e-5
    ends = [
        float(value(jax.tree.map(lambda c, w, s=sign: c + s * step * w, at, way)))
        for sign in (1, -1)
    ]
    slope = (ends[0] - ends[1]) / (2 * step)
    parts = jax.tree.map(lambda g, w: float((g * w).sum()), gradient, way)
    assert sum(jax.tree.leaves(parts)) == pytest.approx(slope, rel=2e-5)
    assert all(part != 0 for part in jax.tree.leaves(parts))


def test_what_a_c_grid_cannot_be_of_is_said_in_one_line():
    two = Polygon(PART.exterior, [circle((16, 23), 6).exterior, circle((44, 23), 6).exterior])
    cases: Any = (
        (box(0, 0, 60, 50), {}, 'has 0 holes; map "c-elliptic" needs'),
        (two, {}, "has 2 holes"),
        (PART, {"cut": (70.0, 25.0)}, "cut: .* is 10 mm off the outline"),
        (PART, {"nodes": (9, 12)}, "nodes: .* at least 17 along eta"),
        (PART, {"solver": "sor"}, 'by "newton" only'),
        (PART, {"map": "o-elliptic"}, 'cut: map "o-elliptic" has none'),
        (PART, {"embedded": ("x",)}, "embedded: .* no zone can cross the cut"),
        (PART, {"spiral": True}, "no closed lines"),
    )
    for polygon, settings, error in cases:
        with pytest.raises(InputError, match=error) as raised:
            begun(polygon, **settings)
        assert "\n" not in str(raised.value)
