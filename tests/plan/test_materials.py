"""Materials of roads: by place, by chance, split, and the order that changes seldom."""

import numpy as np
import pytest
from shapely import box

from fdjax.errors import InputError
from fdjax.plan.check import check
from fdjax.plan.materials import ByChance, ByPlace, assigned, centre, centres, changes
from fdjax.plan.toolpath import Build, Layer, Road

BY_X = ByPlace(lambda x, y, z: x - 10.0)


def build_of(*layers):
    return Build(
        tuple(
            Layer(0.2 * (k + 1), 0.2, tuple(roads), box(0, 0, 20, 20))
            for k, roads in enumerate(layers)
        )
    )


def line(x0, x1, y, width=0.4):
    return Road(np.array([(x0, y), (x1, y)]), width)


def ring(x, y, r=2.0, points=40):
    turn = np.linspace(0, 2 * np.pi, points, endpoint=False)
    return Road(np.stack([x + r * np.cos(turn), y + r * np.sin(turn)], 1), 0.4, closed=True)


def test_whole_roads_go_by_their_centres():
    # Its points crowd on the right, its centre is left of the line.
    square = Road(
        np.array([(8.0, 0), (11, 0), (11, 1), (11, 2), (11, 3), (8, 3)]), 0.4, closed=True
    )
    build = assigned(build_of([line(0, 12, 5), line(9, 19, 7), square]), [BY_X], (0, 1))
    assert centre(square) == pytest.approx([9.5, 1.5])
    assert sorted((road.xy[0, 0].item(), road.material) for road in build.layers[0].roads) == [
        (0, 0), (8, 0), (9, 1),
    ]  # fmt: skip


def test_split_roads_hold_their_volume_and_change_at_the_line():
    roads = [line(0, 20, 5), ring(10, 12, 4), line(2, 8, 9)]
    build = build_of(roads, roads)
    made = assigned(build, [BY_X], (0, 1), split=True, least_road=1.0)
    assert made.volume == pytest.approx(build.volume, rel=1e-9)
    for layer in made.layers:
        assert [len([r for r in layer.roads if r.material == m]) for m in (0, 1)] == [3, 2]
        for road in layer.roads:
            over = road.path[:, 0] - 10.0
            assert (over if road.material else -over).min() > -0.21
    assert changes(made) == 2


def test_a_piece_too_short_to_lay_takes_its_neighbours_material_or_grows():
    def laid(half):
        narrow = ByPlace(lambda x, y, z: half - abs(x - 10.0))
        made = assigned(build_of([line(0, 20, 5)]), [narrow], (0, 1), split=True)
        return sorted(
            (road.xy[:, 0].min(), road.length, road.material) for road in made.layers[0].roads
        )

    assert laid(0.2) == [pytest.approx((0, 20, 0))]
    # Of three widths it is nearer to what is asked than of none.
    assert laid(0.4) == [
        pytest.approx(each) for each in ((0, 9.4, 0), (9.4, 1.2, 1), (10.6, 9.4, 0))
    ]


@pytest.mark.parametrize("bias", [-0.4, 0.0, 0.2])
def test_many_pieces_too_short_keep_their_share(bias):
    rule = ByPlace(lambda x, y, z: np.sin(2.7 * x + y) + bias)
    build = build_of(*[[line(0, 20, k / 2) for k in range(1, 30)]] * 3)
    made = assigned(build, [rule], (0, 1), split=True, least_road=3.3)
    roads = [road for layer in made.layers for road in layer.roads]
    assert min(road.length for road in roads) > 3.3 - 1e-6
    second = sum(road.length for road in roads if road.material) / (3 * 29 * 20)
    x, y = np.meshgrid((np.arange(4000) + 0.5) / 200, np.arange(1, 30) / 2)
    asked = (np.sin(2.7 * x + y) + bias >= 0).mean()
    assert second == pytest.approx(asked, abs=0.003)


def test_layers_alternate_which_comes_first():
    roads = [line(0, 4, k) for k in (1, 3, 5)] + [line(14, 18, k) for k in (2, 4)]
    build = assigned(build_of(*[roads] * 6), [BY_X], (3, 1))
    order = [[road.material for road in layer.roads] for layer in build.layers]
    assert order[:2] == [[3, 3, 3, 1, 1], [1, 1, 3, 3, 3]]
    assert changes(build) == 6


def test_chance_meets_its_share_and_repeats_with_its_seed():
    roads = [line(0, 1 + k % 7, k / 4) for k in range(80)]
    build = build_of(roads)
    made = [assigned(build, [ByChance(0.3, seed)], (0, 1)) for seed in (1, 1, 2)]
    drawn = [{r.xy[0, 1].item() for r in m.layers[0].roads if r.material} for m in made]
    assert drawn[0] == drawn[1] != drawn[2]
    for m in made:
        _, volumes = centres(m)
        second = np.array([road.material == 1 for road in m.layers[0].roads])
        assert volumes[second].sum() / m.volume == pytest.approx(0.3, abs=0.002)


def test_a_few_long_roads_meet_a_share_as_well_as_they_can():
    lengths = [18.0, 17, 16, 15, 9, 8, 7, 6, 3, 1]
    build = build_of(*[[line(0, length, 5)] for length in lengths])
    for seed in range(10):
        made = assigned(build, [ByChance(0.3, seed)], (0, 1))
        second = sum(layer.volume for layer in made.layers if layer.roads[0].material)
        assert second / made.volume == pytest.approx(0.3, abs=0.002)
        assert changes(made) <= len(lengths)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.55, 0.98])
@pytest.mark.parametrize("closed", [False, True])
def test_one_road_of_a_share_is_cut_if_asked(share, closed):
    road = ring(10, 10, 8) if closed else line(0, 20, 5)
    build = build_of([road], [road])
    made = assigned(build, [ByChance(share, 0)], (0, 1), split=True, least_road=0.5)
    roads = [road for layer in made.layers for road in layer.roads]
    second = sum(road.length for road in roads if road.material)
    # To half a road's width, and no piece shorter than three.
    assert second == pytest.approx(share * 2 * road.length, abs=0.2 + 1.2 * (share in (0.02, 0.98)))
    assert made.volume == pytest.approx(build.volume, rel=1e-9)
    assert len(roads) <= 3
    assert changes(made) <= 2


def test_a_function_that_is_not_finite_is_an_error_with_the_place():
    with pytest.raises(InputError, match=r"nan at \(10, 5, 0.1\) mm"):
        assigned(build_of([line(0, 20, 5)]), [ByPlace(lambda x, y, z: np.sqrt(x - 11))], (0, 1))


def test_three_materials_by_levels_of_a_function_are_met_by_volume():
    rules = [ByPlace(lambda x, y, z, at=at: x - at) for at in (5.0, 14.0)]
    build = build_of(*[[line(0, 20, k / 2) for k in range(1, 30)]] * 3)
    made = assigned(build, rules, (2, 0, 1), split=True, least_road=1.0)
    assert made.volume == pytest.approx(build.volume, rel=1e-9)
    volumes = np.array([r.length for layer in made.layers for r in layer.roads])
    tools = np.array([r.material for layer in made.layers for r in layer.roads])
    shares = [volumes[tools == tool].sum() / volumes.sum() for tool in (2, 0, 1)]
    assert shares == pytest.approx([0.25, 0.45, 0.3], abs=0.005)
    for layer in made.layers:
        for road in layer.roads:
            low, high = {2: (0, 5), 0: (5, 14), 1: (14, 20)}[road.material]
            assert road.path[:, 0].min() > low - 0.21
            assert road.path[:, 0].max() < high + 0.21
    # Each layer begins with what the one below ended with.
    assert changes(made) == 2 * 3


@pytest.mark.parametrize("second", [0.493, 0.504])
def test_cuts_move_by_half_a_width_to_meet_shares(second):
    """Where roads lie a little beside their target a function has another share of them."""
    roads = [line(0, 20, k / 2) for k in range(1, 30)]
    build = build_of(*[[*roads, ring(10, 18, 1.5)]] * 3)
    made = assigned(build, [BY_X], (0, 1), split=True, shares=[1 - second, second])
    _, volumes = centres(made)
    material = np.concatenate([layer.materials for layer in made.layers])
    assert made.volume == pytest.approx(build.volume, rel=1e-9)
    assert volumes[material == 1].sum() / made.volume == pytest.approx(second, abs=2e-4)
    ends = np.array([road.path[[0, -1], 0] for layer in made.layers for road in layer.roads])
    cuts = ends[(ends > 5) & (ends < 15)] - 10
    assert np.abs(cuts).max() < 0.41
    # Only so many as are needed, and all to one side of where they were.
    before = assigned(build, [BY_X], (0, 1), split=True)
    was = np.array([road.path[[0, -1], 0] for layer in before.layers for road in layer.roads])
    moved = np.sort(cuts) - np.sort(was[(was > 5) & (was < 15)] - 10)
    assert 0.2 < np.mean(np.abs(moved) > 1e-9) < 0.9
    # More than half a width at each cut would give stays owed.
    far = assigned(build, [BY_X], (0, 1), split=True, shares=[0.4, 0.6])
    _, volumes = centres(far)
    material = np.concatenate([layer.materials for layer in far.layers])
    assert volumes[material == 1].sum() / far.volume == pytest.approx(0.51, abs=0.003)


def test_a_layer_ends_with_a_material_that_the_next_one_has():
    by_thirds = [ByPlace(lambda x, y, z, at=at: x - at) for at in (6.0, 14.0)]
    all_three = [line(0, 4, 1), line(8, 12, 1), line(16, 20, 1)]
    made = assigned(build_of(all_three, all_three[1:2], all_three), by_thirds, (0, 1, 2))
    order = [[road.material for road in layer.roads] for layer in made.layers]
    assert order == [[0, 2, 1], [1], [1, 0, 2]]


def test_chance_meets_three_shares():
    build = build_of([line(0, 1 + k % 7, k / 8) for k in range(160)])
    made = assigned(build, [ByChance(0.5, 3), ByChance(0.4, 4)], (0, 1, 2))
    (layer,) = made.layers
    got = [layer.road_volumes[layer.materials == k].sum() / made.volume for k in range(3)]
    assert got == pytest.approx([0.5, 0.3, 0.2], abs=0.003)


def test_roads_of_a_graph_are_cut_at_their_nodes():
    """Else pieces would begin beside a crossing, on the bead of the other road."""
    xs = np.arange(0.5, 40, 2.0)
    along = [np.stack([xs, np.full_like(xs, y)], 1) for y in xs]
    roads = [Road(xy, 0.4, family="grid") for xy in (*along, *(xy[:, ::-1] for xy in along))]
    outline = box(0, 0, 39, 39)
    build = Build(tuple(Layer(0.2 * k, 0.2, tuple(roads), outline) for k in (1, 2)))
    rule = ByPlace(lambda x, y, z: x + 0.13 * y - 17.2)
    made = assigned(build, [rule], (0, 1), split=True, least_road=1.0)
    assert [each for each in check(made) if each.severity == "error"] == []
    assert made.volume == pytest.approx(build.volume, rel=1e-9)
    places, volumes = centres(made)
    second = np.array([road.material == 1 for layer in made.layers for road in layer.roads])
    x, y = places[:, :2].T
    assert (second == (x + 0.13 * y >= 17.2)).mean() > 0.97
    free, lines = np.linspace(0.5, 38.5, 2000)[None], xs[:, None]
    asked = np.mean([free + 0.13 * lines >= 17.2, lines + 0.13 * free >= 17.2])
    assert volumes[second].sum() / made.volume == pytest.approx(asked, rel=0.01)
