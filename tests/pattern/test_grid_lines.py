"""Grid lines as roads: where they lie, what they break, how rough their controls are."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely

from fdjax.errors import InputError
from fdjax.grid.base import Sides
from fdjax.limits import Limits
from fdjax.part.patch import cosine_top, from_polygon, rectangle
from fdjax.pattern.grid_controls import Controls
from fdjax.pattern.grid_lines import GridLines
from fdjax.pattern.maps import CLOSED, MAPS, NEED_BASE
from fdjax.road.porosity import Samples
from fdjax.road.stacking import Stacking

pytestmark = pytest.mark.usefixtures("compiled_once")

PLATE = rectangle(40, 30)
EVENLY = Samples.between(np.linspace(0, 1, 9))


def plan(kind="uniform", comb=(20, 12), patch=PLATE, **more):
    return GridLines(
        sides=Sides.of(patch),
        comb=tuple(jnp.asarray(float(n)) for n in comb),
        **{
            "width": 0.4,
            "width_range": (0.3, 0.8),
            "height": 0.2,
            "first": Controls(),
            "samples": (EVENLY, EVENLY),
            "kind": kind,
            "nodes": (9, 9),
            **more,
        },
    )


def test_lines_of_a_plate_keep_half_a_road_beside_them_and_reach_the_walls_they_meet():
    ((xi,), (eta,)) = plan().strokes(Controls())
    assert (xi.family, eta.family) == ("xi", "eta")
    lines, widths = np.stack(xi.xy), np.stack(xi.width)
    assert lines.shape == (20, 257, 2)
    assert widths.shape == (20, 256)
    assert xi.level.tolist() == list(range(20))
    inside = 0.2 + (np.arange(20) + 0.5) / 20 * (40 - 0.4)
    np.testing.assert_allclose(lines[:, :, 0], np.broadcast_to(inside[:, None], (20, 257)))
    np.testing.assert_allclose(lines[:, [0, -1], 1], np.tile([0.0, 30.0], (20, 1)), atol=1e-12)
    across = np.stack(eta.xy)
    inside = 0.2 + (np.arange(12) + 0.5) / 12 * (30 - 0.4)
    np.testing.assert_allclose(across[:, 0, 1], inside)
    np.testing.assert_allclose(across[:, [0, -1], 0], np.tile([0.0, 40.0], (12, 1)), atol=1e-12)
    np.testing.assert_array_equal(widths, np.full(widths.shape, 0.4))


def test_layers_take_their_phases_of_one_comb():
    layers = plan(stacking=Stacking("both-staggered", 3, 4)).strokes(Controls())
    layers = list(layers)
    x = [np.stack(layer[0].xy)[:, 0, 0] for layer in layers]
    assert [len(each) for each in x] == [7, 7, 6, 7]
    np.testing.assert_allclose(x[3], x[0])
    together = np.sort(np.concatenate(x[:3]))
    np.testing.assert_allclose(np.diff(together), (40 - 0.4) / 20)
    # What repeats is the same, so that the plan lays it once.
    assert layers[3][0] is layers[0][0]
    assert [family.parity for layer in layers for family in layer] == [0, 0, 1, 1, 0, 0, 0, 0]


def test_a_width_that_varies_comes_along_the_lines():
    rising = jnp.broadcast_to(jnp.linspace(-2, 2, 5)[:, None], (5, 4))
    ((xi,), (eta,)) = plan().strokes(Controls(width=rising))
    along_xi, along_eta = np.stack(xi.width), np.stack(eta.width)
    assert np.ptp(along_xi, axis=1).max() < 1e-12
    assert (np.diff(along_xi[:, 0]) > 0).all()
    assert (np.diff(along_eta, axis=1) > 0).all()
    # All keep half of the widest road, which is at the right wall.
    widest = along_eta[:, -1].max()
    assert 40 - np.stack(xi.xy)[:, 0, 0].max() > widest / 2


def test_a_width_control_lies_within_the_range():
    realised = plan().realise(Controls(width=jnp.asarray(0.0)))
    assert float(realised.width(jnp.zeros(1), jnp.zeros(1))[0]) == pytest.approx(0.55)


@pytest.mark.parametrize(
    "kind", [kind for kind in MAPS if kind not in ("stretched", *CLOSED, *NEED_BASE)]
)
def test_every_map_fills_the_plate(kind):
    pattern = plan(kind)
    corners = jax.jit(
        lambda p: p.realise(Controls()).grid(*jnp.array([[0, 1, 1, 0], [0, 0, 1, 1]]))
    )
    np.testing.assert_allclose(corners(pattern), PLATE.corners, atol=1e-9)


@pytest.mark.parametrize("alpha", [0.0, 0.5])
def test_the_stretched_map_draws_lines_to_its_ends(alpha):
    grid = plan("stretched", alpha=(alpha, 0.5), strength=(1.05, 1e6)).realise(Controls()).grid
    x = np.asarray(grid(jnp.linspace(0, 1, 11), jnp.full(11, 0.5)))[:, 0]
    steps = np.diff(x)
    assert x[[0, -1]] == pytest.approx([0, 40])
    assert steps[-1] < 0.5 * steps.max()
    assert (steps[0] < 0.5 * steps.max()) == (alpha == 0.5)
    y = np.asarray(grid(jnp.zeros(11), jnp.linspace(0, 1, 11)))[:, 1]
    np.testing.assert_allclose(y, np.linspace(0, 30, 11), atol=1e-6)


def test_the_control_of_stretching_takes_the_place_of_beta():
    control = Controls(stretching=jnp.log(jnp.array([0.05, 0.2])))
    own = plan("stretched", strength=(1.05, 1.2)).realise(Controls()).grid
    freed = plan("stretched").realise(control).grid
    places = jnp.linspace(0, 1, 5)
    np.testing.assert_allclose(freed(places, places), own(places, places))


def test_lines_of_a_curved_domain_stay_in_it():
    patch = cosine_top()
    ((xi,), (eta,)) = plan("transfinite", patch=patch).strokes(Controls())
    room = patch.outline.buffer(1e-3)
    for family in (xi, eta):
        assert all(room.contains(shapely.LineString(line)) for line in family.xy)
        clear = shapely.distance(
            patch.outline.exterior, shapely.points(np.stack(family.xy)[:, 128])
        )
        assert clear.min() > 0.2 - 1e-9


def test_an_unknown_map_names_the_known_ones():
    with pytest.raises(InputError, match=r"conical.*transfinite"):
        plan("conical")


LIMITS = Limits(least_spacing=0.8, longest_span=4.0, least_road=10.0)


def penalties(pattern, limits=LIMITS, controls=None):
    return eqx.filter_jit(lambda p, c: p.penalties(p.realise(c), limits))(
        pattern, controls or Controls()
    )


def test_penalties_of_a_plate_are_shares_of_its_limits():
    found = penalties(plan(comb=(25, 10)))
    # Lines lie 40 / 25 = 1.6 and 30 / 10 = 3 apart; each is unsupported over the other's gap.
    np.testing.assert_allclose(
        np.unique(np.round(found["spacing"], 12)), [0.8 / 3 - 1, 0.8 / 1.6 - 1]
    )
    np.testing.assert_allclose(np.unique(np.round(found["span"], 12)), [1.6 / 4 - 1, 3 / 4 - 1])
    np.testing.assert_allclose(np.unique(np.round(found["length"], 12)), [10 / 40 - 1, 10 / 30 - 1])
    assert float(found["fold"].max()) < 0
    assert float(found["skew"].max()) < 0


def test_each_limit_is_broken_by_what_breaks_it():
    def broken(limits=LIMITS, **more):
        found = penalties(plan(**more), limits)
        return {name for name, value in found.items() if float(value.max()) > 0}

    assert broken(comb=(25, 10)) == set()
    assert broken(comb=(51, 10)) == {"spacing"}
    assert broken(comb=(9, 10)) == {"span"}
    assert broken(replace(LIMITS, least_road=31.0), comb=(25, 10)) == {"length"}
    # Where no least spacing is given, roads must not overlap.
    assert broken(replace(LIMITS, least_spacing=None), comb=(99, 10)) == set()
    assert broken(replace(LIMITS, least_spacing=None), comb=(101, 10)) == {"spacing"}


def test_a_fold_is_seen_and_does_not_blow_up():
    # The third corner points inwards: a bilinear map turns over beside it.
    ring = [(0, 0), (30, 0), (6, 6), (0, 30)]
    arrow = from_polygon(shapely.Polygon(ring), corners=ring)
    found = penalties(plan("transfinite", patch=arrow))
    assert float(found["fold"].max()) > 0
    assert all(np.isfinite(part).all() for part in found.values())


def test_skew_is_the_cosine_of_the_angle_between_the_families():
    ring = [(0, 0), (40, 0), (58, 24), (18, 24)]
    slanted = from_polygon(shapely.Polygon(ring), corners=ring)
    pattern = plan("transfinite", patch=slanted)
    skew = eqx.filter_jit(lambda p: p.skew(p.realise(Controls())))(pattern)
    np.testing.assert_allclose(skew, 18 / 30, rtol=1e-9)
    assert float(penalties(pattern)["skew"].max()) == pytest.approx(0.6 / 0.9 - 1)


def test_controls_in_line_are_not_rough():
    line = jnp.linspace(0, 3, 7)
    smooth = Controls(
        spacing=jnp.stack([line, -line, 2 * line, 0 * line]),
        phi=line[:, None] + jnp.linspace(0, 1, 5),
        width=jnp.asarray(0.3),
    )
    pattern = plan()
    np.testing.assert_allclose(pattern.roughness(smooth), 0, atol=1e-12)
    # The four sides are no neighbours of each other, however much they differ.
    bent = eqx.tree_at(lambda c: c.spacing, smooth, smooth.spacing.at[1, 3].add(1.0))
    assert float((pattern.roughness(bent) ** 2).sum()) == pytest.approx((1 + 4 + 1) / 28)


def test_no_controls_have_no_roughness():
    assert plan().roughness(Controls()).shape == (0,)
