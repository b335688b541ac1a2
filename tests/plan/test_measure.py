import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon, Point, box, intersection, set_precision

from fdjax.errors import InputError
from fdjax.plan.compare import compare
from fdjax.plan.lines import lay_lines
from fdjax.plan.measure import measure
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.road.bead import section_area
from fdjax.road.stroke import Lines

PLATE = box(0, 0, 20, 10)
BEAD = section_area(0.4, 0.2)


def plate(*roads, outline=PLATE, layers=1):
    return Build(tuple(Layer(0.2 * (k + 1), 0.2, roads, outline) for k in range(layers)))


def test_parallel_lines_across_windows():
    roads = [Road([(0, y), (20, y)], 0.4) for y in (1, 2, 6)]
    result = measure(plate(*roads, layers=3), window=5)
    assert result.solid.shape == (4, 2)
    assert result.x.tolist() == [0, 5, 10, 15, 20]
    assert result.solid[:, 0] == pytest.approx(2 * 5 * BEAD / (25 * 0.2))
    assert result.solid[:, 1] == pytest.approx(5 * BEAD / (25 * 0.2))
    assert result.porosity == pytest.approx(1 - result.solid)
    assert result.mean_solid == pytest.approx(3 * 20 * BEAD / (200 * 0.2))


def test_serpentine_counts_its_turns():
    lines = [[(x, 0), (x, 10)] for x in (2, 6, 12, 18)]
    widths = [np.full(len(line) - 1, 0.4) for line in lines]
    strokes = Lines("", 0, np.arange(len(lines)), lines, widths)
    (road,) = lay_lines(strokes, PLATE, lift_length=1).roads
    result = measure(plate(road), window=10)
    # Left: two lines, the top turn 2..6, and of the bottom turn 6..12 four.
    assert result.volume[:, 0] == pytest.approx(BEAD * np.array([2 * 9.6 + 8, 2 * 9.6 + 8]))
    assert result.mean_solid == pytest.approx((4 * 9.6 + 16) * BEAD / 40)


def test_diagonal_is_split_at_every_edge():
    result = measure(plate(Road([(0, 0), (20, 10)], 0.4)), window=2.5)
    half = np.hypot(2.5, 1.25) * BEAD
    expected = np.zeros((8, 4))
    expected[np.arange(8), np.arange(8) // 2] = half
    assert result.volume == pytest.approx(expected)


def test_segment_on_a_window_edge_counts_once():
    edges = [Road([(5, 0), (5, 10)], 0.4), Road([(0, 10), (20, 10)], 0.4)]
    for shift in (0.0, 1e-13):
        roads = [Road(road.xy - shift, 0.4) for road in edges]
        result = measure(plate(*roads), window=5)
        column = 5 * BEAD
        assert result.volume[1, 0] == pytest.approx(column)
        assert result.volume[:, 1] == pytest.approx([column, 2 * column, column, column])


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    window=st.floats(0.7, 5),
    shift=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
def test_windows_hold_all_volume_and_measuring_is_additive(seed, window, shift):
    rng = np.random.default_rng(seed)
    outline = PLATE.difference(Point(8, 5).buffer(2))

    def road():
        xy = np.round(rng.uniform(0, 1, (12, 2)) * [20, 10], 1)
        return Road(xy, rng.uniform(0.3, 0.5, 11))

    first, second = (road(), road()), (road(),)
    parts = [
        measure(plate(*roads, outline=outline), window=window, shift=shift)
        for roads in (first, second, first + second)
    ]
    for part in parts:
        assert part.volume.sum() == pytest.approx(part.total_volume, rel=1e-12)
        assert part.area.sum() == pytest.approx(outline.area, rel=1e-12)
    assert parts[0].volume + parts[1].volume == pytest.approx(parts[2].volume, abs=1e-12)


def test_windows_half_inside_are_kept():
    result = measure(plate(), window=4)
    # 20 x 10 in windows of 4: the last row is half inside; shifted, no row at the edge is.
    assert result.kept.all()
    assert result.area[0, -1] == pytest.approx(8)
    shifted = measure(plate(), window=4, shift=(0, 0.25))
    assert shifted.y.tolist() == [-3, 1, 5, 9, 13]
    assert shifted.kept[0].tolist() == [False, True, True, False]


def test_layers_with_their_own_outlines():
    half = box(0, 0, 10, 10)
    road = Road([(0, 5), (10, 5)], 0.4)
    build = Build((Layer(0.2, 0.2, (road,), PLATE), Layer(0.5, 0.3, (), half)))
    result = measure(build, window=10)
    assert result.area[:, 0] == pytest.approx([100, 100 * 0.2 / 0.5])
    assert result.solid[0, 0] == pytest.approx(10 * BEAD / (100 * 0.5))
    assert np.isnan(result.solid[1, 0])
    assert result.mean_solid == pytest.approx(10 * BEAD / (200 * 0.2 + 100 * 0.3))
    assert measure(build, window=10, outline=PLATE).kept.all()


def test_compare_with_exact_means():
    result = measure(plate(Road([(0, 5.5), (20, 5.5)], 0.4)), window=5)
    comparison = compare(result, lambda x, y: 0.5 + 0.01 * x + 0.001 * y**2)
    centre = 0.5 + 0.01 * np.array([2.5, 7.5, 12.5, 17.5])
    rows = 0.001 * np.array([25 / 3, (1000 - 125) / 15])
    assert comparison.asked == pytest.approx(centre[:, None] + rows, abs=1e-12)
    assert comparison.error == pytest.approx(result.porosity - comparison.asked)
    assert comparison.rms == pytest.approx(np.sqrt((comparison.error**2).mean()))
    assert comparison.largest == pytest.approx(np.abs(comparison.error).max())
    assert comparison.mean_asked == pytest.approx(0.6 + 0.1 / 3)
    assert comparison.mean_got == pytest.approx(1 - 20 * BEAD / 40)
    assert comparison.mean_error == pytest.approx(comparison.mean_got - comparison.mean_asked)


def test_compare_in_windows_cut_by_the_outline():
    result = measure(plate(outline=box(0, 0, 8, 10)), window=5)
    comparison = compare(result, lambda x, y: x / 10)
    assert comparison.asked[:, 0] == pytest.approx([0.25, 0.65], abs=1e-12)
    disc = measure(plate(outline=Point(5, 5).buffer(5, quad_segs=64)), window=5)
    asked = compare(disc, lambda x, y: x / 10).asked
    # Mean x of a quarter disc about (5, 5): 5 -+ 4 r / (3 pi).
    assert asked[:, 0] == pytest.approx(0.5 + np.array([-1, 1]) * 2 / (3 * np.pi), abs=5e-3)
    assert compare(disc, lambda x, y: 0.3).mean_asked == pytest.approx(0.3)


@pytest.mark.parametrize("at", [2.5, 3.1, 6.2])
def test_a_step_counts_where_it_is(at):
    result = measure(plate(outline=box(0, 0, 8, 10)), window=5)
    asked = compare(result, lambda x, y: np.where(x < at, 0.6, 0.8)).mean_asked
    # To half a step between points.
    assert asked == pytest.approx(0.8 - 0.2 * at / 8, abs=0.2 * 5 / 64 / 2 / 8)


def test_deposits_outside_count_in_the_mean_alone():
    skirt = Road([(-3, -3), (23, -3)], 0.4)
    result = measure(plate(skirt), window=5)
    assert result.volume.sum() == 0
    assert result.mean_solid == pytest.approx(26 * BEAD / 40)


def test_degenerate_builds():
    dot = Road([(1, 1), (1, 1)], 0.4)
    assert measure(plate(dot), window=5).volume.sum() == 0
    assert (measure(plate(), window=5).porosity == 1).all()
    with pytest.raises(InputError, match="no layers"):
        measure(Build(()), window=5)
    with pytest.raises(InputError, match="no outline"):
        measure(plate(outline=None), window=5)
    with pytest.raises(InputError, match="half inside"):
        measure(plate(), window=50)
    with pytest.raises(InputError, match="positive"):
        measure(plate(), window=0)
    with pytest.raises(InputError, match="not finite"):
        compare(measure(plate(), window=5), lambda x, y: x * np.nan)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), window=st.floats(0.8, 2))
def test_windows_are_clipped_to_several_polygons(seed, window):
    rng = np.random.default_rng(seed)
    parts = [Point(*rng.uniform(2, 8, 2)).buffer(rng.uniform(2, 4)) - Point(5, 5).buffer(1)]
    parts += [Point(24, 6).buffer(4).difference(Point(24, 6).buffer(2)), box(30, 0, 37, 3)]
    pair = MultiPolygon([p for p in parts if p.geom_type == "Polygon"])
    other = MultiPolygon(parts[1:])
    build = Build((Layer(0.3, 0.3, (), pair), Layer(0.4, 0.1, (), other)))
    result = measure(build, window=window)
    x, y = result.x, result.y
    windows = box(x[:-1, None], y[None, :-1], x[1:, None], y[None, 1:])
    exact = [[intersection(outline, w).area for w in windows.ravel()] for outline in (pair, other)]
    assert result.area.ravel() == pytest.approx(np.average(exact, 0, [0.3, 0.1]), abs=1e-9)
    bounds = [intersection(pair, w).bounds for w in windows.ravel()]
    bounds = [
        b if w.intersection(pair).area else (np.nan,) * 4
        for b, w in zip(bounds, windows.ravel(), strict=True)
    ]
    np.testing.assert_allclose(result.clips[0].bounds.reshape(-1, 4), bounds, atol=1e-9)


def test_many_small_windows_beside_the_polygons_are_left_out():
    pair = MultiPolygon([box(0, 0, 5, 5), box(15, 0, 20, 5)])
    result = measure(plate(Road([(0, 1), (20, 1)], 0.4), outline=pair), window=5)
    assert result.kept[:, 0].tolist() == [True, False, False, True]
    assert result.mean_solid == pytest.approx(20 * BEAD / (50 * 0.2))


def test_a_target_that_varies_in_z_is_averaged_over_the_layers_within_their_outlines():
    layers = (Layer(0.2, 0.2, (), PLATE), Layer(0.5, 0.3, (), box(0, 0, 10, 10)))
    result = measure(Build((*layers, Layer(0.6, 0.1, (), PLATE))), window=10)
    comparison = compare(result, lambda x, y, z: z)
    both = 0.2 * 0.1 + 0.1 * 0.55
    assert comparison.asked[0, 0] == pytest.approx((both + 0.3 * 0.35) / 0.6)
    whole = (200 * both + 100 * 0.3 * 0.35) / (200 * 0.3 + 100 * 0.3)
    assert comparison.mean_asked == pytest.approx(whole)
    flat = compare(result, lambda x, y: x / 40)
    same = compare(result, lambda x, y, z: x / 40 + 0 * z)
    assert same.asked == pytest.approx(flat.asked, nan_ok=True, abs=1e-14)
    with pytest.raises(InputError, match=r"not finite at \(.*, 0\.35\)"):
        compare(result, lambda x, y, z: np.where(abs(z - 0.35) < 0.01, np.nan, x * 0))


def test_layers_alike_are_clipped_once():
    build = plate(layers=5)
    result = measure(
        build.replace(layers=(*build.layers, Layer(1.2, 0.2, (), box(0, 0, 20, 10)))), window=5
    )
    assert len(result.filled) == len(result.clips) == 1
    assert result.filled[0].middles == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9, 1.1])


def test_a_layer_takes_polygons_only_and_off_their_grid():
    with pytest.raises(InputError, match="outline is a Point; a Polygon or MultiPolygon"):
        Layer(0.2, 0.2, (), Point(0, 0))  # type: ignore[arg-type]
    coarse = measure(plate(outline=set_precision(box(0, 0, 20, 10), 1.0)), window=2.5)
    assert coarse.area == pytest.approx(np.full((8, 4), 6.25))
