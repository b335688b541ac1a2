"""Lines of rings and discs as roads: closed, without a seam, and where their model has them."""

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from fdjax.errors import InputError
from fdjax.limits import Limits
from fdjax.part.contour import circle
from fdjax.part.part import Part
from fdjax.pattern.map_lines import MapLines
from fdjax.plan.trace import lay
from fdjax.road.porosity import first_kept, kept
from fdjax.target.target import Target

pytestmark = pytest.mark.usefixtures("compiled_once")

LIMITS = Limits(road_width=(0.3, 0.8), longest_span=10.0)
RING = Polygon(circle((2, 3), 20).exterior, [circle((2, 3), 8).exterior])
EVEN = Target(lambda x, y: 0.7 + 0 * x)


def begun(polygon, layers=4, **settings):
    given = {"map": "polar", "phases": 2, "controls": (), "lines": (12, 40), **settings}
    return MapLines(**given).begin(Part.plate(polygon, layers=layers), EVEN, LIMITS, 5.0)


def laid(pattern, polygon):
    part = Part.plate(polygon, layers=pattern.stacking.layers)
    return lay(pattern.strokes(pattern.first), part, lift_length=4.0)


def test_circles_are_closed_and_begin_elsewhere_on_each_layer():
    build = laid(begun(RING), RING)
    starts = []
    for layer in build.layers[::2]:
        assert len(layer.roads) == 12
        assert all(road.closed for road in layer.roads)
        radius = np.array([np.hypot(*(road.xy - [2, 3]).T) for road in layer.roads])
        assert np.ptp(radius, axis=1).max() < 5e-3
        assert 8.2 - 5e-3 < radius.min() < radius.max() < 19.8 + 5e-3
        starts.append(np.arctan2(*(layer.roads[0].xy[0] - [2, 3])[::-1]))
    assert abs(np.angle(np.exp(1j * (starts[1] - starts[0])))) == pytest.approx(np.pi, abs=0.05)


def test_rays_are_one_road_that_turns_at_both_walls_by_turns():
    build = laid(begun(RING), RING)
    for layer in build.layers[1::2]:
        (road,) = layer.roads
        radius = np.hypot(*(road.xy - [2, 3]).T)
        assert (np.diff(np.sign(radius - 14)) != 0).sum() == 40


def test_a_spiral_is_one_road_of_the_same_length():
    circles, spiral = (laid(begun(RING, spiral=each), RING) for each in (False, True))
    for round_, wound in zip(circles.layers[::2], spiral.layers[::2], strict=True):
        (road,) = wound.roads
        assert not road.closed
        # Circles of one phase lie a little more inwards, those of the other outwards.
        assert road.length == pytest.approx(sum(each.length for each in round_.roads), rel=0.03)
        radius = np.hypot(*(road.xy - [2, 3]).T)
        assert (np.diff(radius) > -1e-3).all() or (np.diff(radius) < 1e-3).all()
    assert spiral.volume == pytest.approx(circles.volume, rel=5e-3)


@pytest.mark.parametrize("kind", ["polar", "o-transfinite", "o-elliptic"])
def test_the_deposit_is_that_of_the_roads(kind):
    polygon = RING if kind == "polar" else Polygon(box(0, 0, 40, 36).exterior, RING.interiors)
    if kind != "polar":
        polygon = Polygon(box(-18, -16, 22, 22).exterior, [circle((2, 3), 8).exterior])
    pattern = begun(polygon, map=kind, nodes=(9, 24))
    deposit = pattern.deposit(pattern.realise(pattern.first))
    build = laid(pattern, polygon)
    # Lines are squeezed off the walls to first order.
    assert build.volume == pytest.approx(float(deposit.volume.sum()), rel=8e-3)
    assert shapely.contains_xy(polygon, *np.asarray(deposit.xyz)[:, :2].T).all()


def test_rays_of_a_disc_end_by_halves_and_keep_apart():
    disc = circle((0, 0), 20)
    pattern = begun(disc, lines=(10, 64))
    assert pattern.apart is not None
    build = laid(pattern, disc)
    for layer in build.layers[1::2]:
        crossed = [
            int(shapely.intersection(shapely.MultiLineString([r.path for r in layer.roads]), ring)
                .geoms.__len__())
            for ring in (shapely.Point(0, 0).buffer(radius).exterior for radius in (18, 3, 1.4))
        ]  # fmt: skip
        assert crossed[0] == 64
        assert crossed[0] > crossed[1] > crossed[2]
    deposit = pattern.deposit(pattern.realise(pattern.first))
    assert build.volume == pytest.approx(float(deposit.volume.sum()), rel=0.02)


def test_the_share_kept_is_that_of_the_lines_that_end():
    spacing = np.linspace(0.02, 1.5, 400)
    level = np.arange(256)
    first = first_kept(np.broadcast_to(spacing, (256, 400)), level)
    share = (first[:, None] <= np.arange(400)).mean(0)
    model = np.asarray(kept(jnp.asarray(spacing)))
    assert np.abs(np.cumsum(model - share)).max() < 0.05 * share.sum()


@pytest.mark.parametrize(
    ("kind", "polygon", "error"),
    [
        ("polar", box(0, 0, 40, 30), "its outline is no circle"),
        ("polar", Polygon(RING.exterior, [circle((6, 3), 8).exterior]), "its hole is no circle"),
        ("o-elliptic", box(0, 0, 40, 30), "has 0 holes"),
        (
            "o-conformal",
            Polygon(
                box(0, 0, 40, 30).exterior,
                [circle((9, 9), 3).exterior, circle((29, 9), 3).exterior],
            ),
            "has 2 holes",
        ),
        ("conformal", circle((0, 0), 20), "at most 64"),
    ],
)
def test_what_a_map_cannot_do_is_said_in_one_line(kind, polygon, error):
    with pytest.raises(InputError, match=error) as raised:
        begun(polygon, map=kind)
    assert "\n" not in str(raised.value)


def test_keys_that_do_not_go_together_are_refused():
    for settings, error in (
        ({"map": "transfinite", "spiral": True}, "no closed lines"),
        ({"map": "o-elliptic", "solver": "sor"}, 'by "newton" only'),
        ({"map": "polar", "controls": ("spacing", "spacing_field")}, "exclude each other"),
        ({"map": "stretched", "stretching": ("tanh", "roberts"), "strength": (-1.0, 1.0)}, "tanh"),
    ):
        with pytest.raises(InputError, match=error):
            MapLines(**settings)
