"""The differentiable deposit against closed forms and against the roads of a plan."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from deposit_samples import AREA, HEIGHT, WIDTH, deposit, in_windows, laid, line_volume, pattern

from fdjax.grid.algebraic import Cartesian
from fdjax.grid.base import Tangents, tangents
from fdjax.part.patch import cosine_top, from_polygon, rectangle
from fdjax.plan.measure import measure
from fdjax.road.porosity import Samples, cell_porosity, equal_edges, midpoints, whole_lines
from fdjax.road.stacking import Stacking

pytestmark = pytest.mark.usefixtures("compiled_once")

PLATE = rectangle(40, 30)
LINES = (20, 12)
MODES = [(1, False), (2, False), (5, False), (1, True), (3, True)]


def plate_volume(xi, eta):
    """Of a layer with both families of lines of the plate: lines and turn-arounds."""
    inside_x, inside_y = 40 - WIDTH, 30 - WIDTH
    lines = xi * inside_y + eta * inside_x
    turns = (xi - 1) / xi * inside_x + (eta - 1) / eta * inside_y
    return AREA * (lines + turns)


@pytest.mark.parametrize("both", [False, True])
def test_total_on_a_rectangle_is_that_of_its_lines_and_turn_arounds(both):
    _, volume = deposit(pattern(PLATE, LINES, both=both))
    assert volume.sum() == pytest.approx(plate_volume(*LINES) * (1 if both else 0.5), rel=1e-6)


@pytest.mark.parametrize(("phases", "both"), MODES)
def test_total_is_that_of_the_roads_laid(phases, both):
    plan = pattern(PLATE, LINES, phases, both=both)
    build = laid(plan, PLATE.outline)
    assert all(len(layer.roads) == (2 if both else 1) for layer in build.layers)
    _, volume = deposit(plan)
    assert build.volume / len(build.layers) == pytest.approx(volume.sum(), rel=1e-5)


def differences(phases, patch, lines, window=5.0, shift=0.5, **more):
    """Windows of the roads laid less those of the deposit, in lines' volumes of a window."""
    plan = pattern(patch, lines, phases, **more)
    build = laid(plan, patch.outline)
    measurement = measure(build, window=window, shift=(shift, shift))
    got = measurement.volume / len(build.layers)
    expected = in_windows(*deposit(plan), measurement)
    return ((got - expected) / line_volume(plan, window))[measurement.kept]


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.5])
@pytest.mark.parametrize(("phases", "both"), [(2, False), (5, False), (3, True)])
def test_windows_of_the_roads_differ_by_at_most_half_a_line(phases, both, shift):
    assert np.abs(differences(phases, PLATE, LINES, shift=shift, both=both)).max() < 0.5


def test_the_more_phases_the_smaller_the_difference():
    rms = [np.sqrt((differences(phases, PLATE, LINES) ** 2).mean()) for phases in (1, 2, 5)]
    assert rms[0] > 2 * rms[1] > 2 * rms[2]


@pytest.fixture(scope="module")
def curved():
    return pattern(cosine_top(), (20, 16), 5, kind="transfinite")


def test_total_and_windows_on_a_curved_domain(curved):
    outline = cosine_top().outline
    build = laid(curved, outline)
    points, volume = deposit(curved)
    # Lines are squeezed off the walls to first order.
    assert build.volume / len(build.layers) == pytest.approx(volume.sum(), rel=2e-3)
    measurement = measure(build, window=7.62)
    got = measurement.volume / len(build.layers)
    difference = (got - in_windows(points, volume, measurement))[measurement.kept]
    assert np.abs(difference).max() < 0.5 * line_volume(curved, 7.62)


def test_material_lies_half_a_road_inside(curved):
    for plan, outline in ((pattern(PLATE, LINES), PLATE.outline), (curved, cosine_top().outline)):
        points = deposit(plan)[0][:: 7 if plan is curved else 1]
        clear = shapely.distance(outline.exterior, shapely.points(points))
        assert shapely.contains_xy(outline, *points.T).all()
        assert clear.min() == pytest.approx(WIDTH / 2, rel=5e-3)


def test_turn_arounds_cover_half_of_each_wall():
    points, volume = deposit(pattern(PLATE, LINES))
    for at, axis, length, lines in ((0.2, 0, 30, 12), (39.8, 0, 30, 12), (0.2, 1, 40, 20)):
        on_wall = np.abs(points[:, axis] - at) < 1e-9
        # On every second layer; where the family begins and ends there is half a gap less.
        expected = AREA * (length - WIDTH) * (1 - 1 / lines) / 2 / 2
        assert volume[on_wall].sum() == pytest.approx(expected, rel=1e-4)


# --- the lines' own cells ---


@pytest.mark.parametrize(("both", "share"), [(False, 0.5), (True, 1.0)])
def test_cells_of_a_uniform_grid_follow_the_paper(both, share):
    """1 - (w/2)(1/h_xi + 1/h_eta), w the width of the flat section with the road's area."""
    box = Cartesian(jnp.zeros(2), jnp.array([40.0, 30.0]))
    _, along = tangents(box, jnp.asarray(midpoints(4))[:, None], jnp.asarray(midpoints(3))[None])
    stacking = Stacking("both" if both else "alternate")
    got = cell_porosity(along, WIDTH, HEIGHT, LINES, stacking)
    flat = WIDTH - HEIGHT * (1 - np.pi / 4)
    expected = 1 - flat * share * (1 / (40 / 20) + 1 / (30 / 12))
    np.testing.assert_allclose(got, np.full((4, 3), expected), rtol=1e-13)


def test_cells_of_a_sheared_grid_count_lengths_over_areas():
    along = Tangents(jnp.array([10.0, 0.0]), jnp.array([6.0, 8.0]))
    got = cell_porosity(along, 0.5, 0.25, (4, 5), Stacking("alternate"))
    # J = 80, |r_xi| = |r_eta| = 10: spacings 80 / (4 * 10) = 2 and 80 / (5 * 10) = 1.6.
    section = 0.25 * 0.25 + np.pi / 4 * 0.25**2
    assert got == pytest.approx(1 - section / 0.25 / 2 * (1 / 2 + 1 / 1.6))


def test_cells_are_the_deposit_without_walls():
    plan = pattern(PLATE, LINES, samples=64)
    points, volume = deposit(plan)
    inside = (np.abs(points - [20, 15]) < [10, 8]).all(1)
    xyz, local, _ = eqx.filter_jit(lambda p: p.cells(p.realise(p.first)))(plan)
    kept = (np.abs(np.asarray(xyz)[:, :2] - [20, 15]) < [10, 8]).all(-1)
    solid = volume[inside].sum() / (20 * 16 * HEIGHT)
    assert 1 - np.asarray(local)[kept].mean() == pytest.approx(solid, rel=0.03)


# --- where the sums are taken ---


def test_samples_stand_for_all_of_the_interval():
    edges = equal_edges(lambda t: t**2, 7)
    np.testing.assert_allclose(edges**2, np.linspace(0, 1, 8), atol=1e-6)
    samples = Samples.between(edges)
    assert float(samples.weights.sum()) == pytest.approx(1)
    assert (np.diff(samples.places) > 0).all()


@pytest.mark.parametrize("comb", [5, 16, 40, 333])
def test_parts_with_whole_lines_hold_as_many_each_as_they_weigh(comb):
    edges = whole_lines(equal_edges(lambda t: t + 0.3 * t * (1 - t), 16), comb)
    places = (np.arange(comb) + 0.5) / comb
    held = np.histogram(places, edges)[0]
    assert (held >= 1).all()
    np.testing.assert_allclose(held / comb, np.diff(edges))


def test_half_a_road_is_kept_square_to_a_slanted_wall():
    slanted = from_polygon(shapely.Polygon([(0, 0), (30, 0), (42, 24), (12, 24)]))
    points, _ = deposit(pattern(slanted, LINES, kind="transfinite", samples=64))
    clear = shapely.distance(slanted.outline.boundary, shapely.points(points))
    assert clear.min() == pytest.approx(WIDTH / 2, rel=1e-9)
