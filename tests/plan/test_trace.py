"""From a pattern's lines to a build: inside the walls, joined, and layers laid alike once."""

import numpy as np
import pytest
import shapely

from fdjax.errors import InputError
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.plan.check import check
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.plan.trace import lay, trim, trim_subdomains
from fdjax.road.bead import section_area
from fdjax.road.stroke import Lines, Subdomain

PLATE = shapely.box(0, 0, 20, 10)
WIDTH, HEIGHT = 0.4, 0.2
AREA = section_area(WIDTH, HEIGHT)


def upright(places, points=65, parity=0, width=WIDTH, bend=0.0):
    """Lines along y at these x, from wall to wall of the plate."""
    y = np.linspace(0, 10, points)
    xy = [np.stack([x + bend * np.sin(y / 3), y], 1) for x in places]
    return Lines("xi", parity, np.arange(len(xy)), xy, [np.full(points - 1, width)] * len(xy))


def level(places, points=65, parity=0):
    x = np.linspace(0, 20, points)
    xy = [np.stack([x, np.full(points, y)], 1) for y in places]
    return Lines("eta", parity, np.arange(len(xy)), xy, [np.full(points - 1, WIDTH)] * len(xy))


def laid(*layers, outline=PLATE, **more):
    part = Part.plate(outline, layers=len(layers), height=HEIGHT)
    return lay(layers, part, lift_length=4.0, **more)


def test_one_family_is_one_road_back_and_forth_half_a_road_inside():
    build = laid([upright([2, 5, 8])], name="plate")
    assert build.name == "plate"
    (layer,) = build.layers
    (road,) = layer.roads
    expected = [(2, 0.2), (2, 9.8), (5, 9.8), (5, 0.2), (8, 0.2), (8, 9.8)]
    assert {tuple(road.xy[0].round(6)), tuple(road.xy[-1].round(6))} == {expected[0], expected[-1]}
    assert shapely.equals_exact(
        shapely.LineString(road.xy).normalize(), shapely.LineString(expected).normalize(), 2e-3
    )
    assert road.family == "xi"
    assert shapely.equals(layer.outline, PLATE)
    assert build.volume == pytest.approx(AREA * (3 * 9.6 + 2 * 3), rel=1e-6)


def test_parity_says_which_wall_has_the_first_turn():
    first, second = (laid([upright([2, 5], parity=p)]).layers[0].roads[0].xy for p in (0, 1))
    assert first[1:3, 1] == pytest.approx(9.8)
    assert second[1:3, 1] == pytest.approx(0.2)


def test_layers_rise_and_take_the_families_given():
    a, b = upright([2, 5, 8]), level([3, 6])
    build = laid([a], [b], [a], [a, b])
    assert [layer.z for layer in build.layers] == [0.2, 0.4, 0.6, 0.8]
    assert {layer.height for layer in build.layers} == {HEIGHT}
    assert [[road.family for road in layer.roads] for layer in build.layers] == [
        ["xi"], ["eta"], ["xi"], ["xi", "eta"]
    ]  # fmt: skip
    # What repeats is laid once.
    assert build.layers[0].roads is build.layers[2].roads


def test_points_on_a_straight_road_are_dropped_to_the_tolerance():
    places = np.array([4.0, 9, 14])
    bent = upright(places, points=201, bend=0.5)
    fine, coarse = (laid([bent], tolerance=t).layers[0].roads[0] for t in (1e-9, 0.02))
    assert len(coarse.xy) < len(fine.xy) / 10
    distance = shapely.hausdorff_distance(
        shapely.LineString(fine.xy), shapely.LineString(coarse.xy)
    )
    assert distance <= 0.02
    assert len(laid([upright(places)]).layers[0].roads[0].xy) == 6


def test_clearance_keeps_beads_further_from_every_wall():
    holed = shapely.Polygon(PLATE.exterior, [shapely.Point(10, 5).buffer(2).exterior])
    for clearance in (0.0, 0.1):
        build = laid([upright(np.arange(1, 20, 1.5))], outline=holed, clearance=clearance)
        reach = min(
            shapely.distance(holed.boundary, shapely.LineString(road.xy))
            for road in build.layers[0].roads
        )
        assert reach == pytest.approx(WIDTH / 2 + clearance, abs=5e-3)
        assert shapely.equals(build.layers[0].outline, holed)


def test_an_outline_too_narrow_for_the_clearance_is_refused():
    with pytest.raises(InputError, match=r"nothing is left when shrunk by 0\.1 mm"):
        laid([upright([2, 5])], outline=shapely.box(0, 0, 20, 0.15), clearance=0.1)


def test_a_region_that_falls_apart_has_roads_in_each_part():
    dumbbell = shapely.union_all(
        [shapely.box(0, 0, 8, 10), shapely.box(12, 0, 20, 10), shapely.box(7, 5, 13, 5.1)]
    )
    build = laid([upright([2, 5, 15, 18])], outline=dumbbell, clearance=0.1)
    assert len(build.layers[0].roads) == 2


def test_layers_of_a_part_may_differ():
    other = shapely.MultiPolygon([shapely.box(0, 0, 6, 10), shapely.box(9, 0, 20, 10)])
    part = Part.stack([PLATE, other, PLATE], [0.2, 0.3, 0.2])
    strokes = upright(np.arange(1, 20, 1.5))
    build = lay(iter([[strokes]] * 3), part, lift_length=4)
    assert [layer.z for layer in build.layers] == [0.2, 0.5, 0.7]
    assert [layer.height for layer in build.layers] == [0.2, 0.3, 0.2]
    assert [len(layer.roads) for layer in build.layers] == [1, 2, 1]
    assert isinstance(build.layers[1].outline, shapely.MultiPolygon)


def test_strokes_must_fit_the_part():
    part = Part.plate(PLATE, layers=2)
    for layers, text in (
        ([[upright([2])]], "strokes for 1 layers; the part has 2"),
        ([[upright([2])]] * 3, "more layers than the part's 2"),
        ([["line"]] * 2, "str is not one of Lines"),
    ):
        with pytest.raises(InputError, match=text):
            lay(layers, part, lift_length=4)


def test_what_crowds_is_left_out_and_counted():
    build = laid([upright([2, 2.3, 2.6, 5])])
    assert build.layers[0].thinned == pytest.approx(AREA * 9.6, rel=1e-6)
    assert build.thinned == build.layers[0].thinned
    assert laid([upright([2, 2.5, 3, 5])]).thinned == 0


def test_what_is_laid_passes_the_checks():
    a, b = upright(np.arange(1.5, 20, 2)), level(np.arange(1, 10, 2))
    limits = Limits(road_width=(0.3, 0.8), longest_span=5.0, least_road=5.0)
    assert check(laid([a], [b], [a]), limits) == ()


# --- trim ---


def test_trim_scales_all_sections_alike():
    wide = upright([12, 15, 18], width=0.7)
    build = laid([upright([2, 5, 8]), wide], [level([3, 6])])
    trimmed = trim(build, 1.1 * build.volume)
    assert trimmed.volume == pytest.approx(1.1 * build.volume, rel=1e-12)
    pairs = [
        (road, new)
        for layer, after in zip(build.layers, trimmed.layers, strict=True)
        for road, new in zip(layer.roads, after.roads, strict=True)
    ]
    assert len(pairs) == 3
    for road, new in pairs:
        np.testing.assert_array_equal(new.xy, road.xy)
        share = section_area(new.width, HEIGHT) / section_area(road.width, HEIGHT)
        np.testing.assert_allclose(share, 1.1)


def test_trim_minds_the_heights_of_the_layers():
    road = Road([(0, 0), (10, 0)], 0.4)
    build = Build((Layer(0.2, 0.2, (road,)), Layer(0.5, 0.3, (road,))))
    assert trim(build, 2.0).volume == pytest.approx(2.0)


def test_trim_scales_sections_that_a_file_told():
    road = Road([(0, 0), (10, 0), (10, 5)], 0.4, section=[0.07, 0.12])
    build = Build((Layer(0.2, 0.2, (road,)),))
    trimmed = trim(build, 1.5 * build.volume)
    assert trimmed.volume == pytest.approx(1.5 * build.volume)
    np.testing.assert_allclose(trimmed.layers[0].roads[0].section, [0.105, 0.18])


def test_trim_of_nothing_is_refused():
    with pytest.raises(InputError, match="no roads"):
        trim(Build((Layer(0.2, 0.2, ()),)), 1.0)


def test_subdomains_are_trimmed_each_to_its_own_volume():
    left, right = (
        Subdomain(shapely.box(x, 0, x + 10, 10), "raster", 0.0, WIDTH, 1.0, 0) for x in (0, 10)
    )
    roads = Road([(12, 1), (18, 1)], WIDTH), Road([(1, 1), (9, 1)], WIDTH)
    layer = Layer(HEIGHT, HEIGHT, roads, PLATE, 0.0, (left, right))
    trimmed = trim_subdomains(Build((layer, layer)), [16.4 * AREA, 13.0 * AREA], most=0.05)
    volumes = [road.segment_volumes(HEIGHT).sum() for road in trimmed.layers[0].roads]
    # 12 mm to 13 is more than 5 %.
    assert volumes == pytest.approx([1.05 * 6 * AREA, 8.2 * AREA], rel=1e-9)
