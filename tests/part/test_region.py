"""Regions: several polygons from every source, mended points, insets and thin places."""

import json

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from outlines import OUTLINES
from shapely import MultiPolygon, Point, Polygon, box

from fdjax.errors import InputError
from fdjax.part.contour import circle
from fdjax.part.region import Region
from fdjax.part.ring import JOINED

PAIR = MultiPolygon([box(0, 0, 4, 4) - box(1, 1, 2, 2), box(6, 0, 9, 3)])
PARTS = [shapely.geometry.mapping(part) for part in PAIR.geoms]
FEATURES = [{"type": "Feature", "properties": {}, "geometry": part} for part in PARTS]
GEOJSON = [
    {"type": "MultiPolygon", "coordinates": [part["coordinates"] for part in PARTS]},
    {"type": "FeatureCollection", "features": FEATURES},
]


@pytest.mark.parametrize(
    "source", [PAIR, PAIR.wkt, "SRID=1;" + PAIR.wkt.lower(), *map(json.dumps, GEOJSON)]
)
def test_several_polygons_come_from_every_source(source, tmp_path):
    region = Region.of(source)
    assert region.geometry.equals(PAIR)
    assert region.notes == ()
    assert all(part.exterior.is_ccw for part in region.polygons)
    assert Region.of(region) is region
    if isinstance(source, str):
        (tmp_path / "plate.txt").write_text(source)
        assert Region.of(tmp_path / "plate.txt").geometry.equals(PAIR)
        document = json.loads(source) if source.startswith("{") else source
        assert Region.of(document, unit="cm").area == pytest.approx(100 * PAIR.area)


def test_holes_go_to_the_polygon_they_lie_in():
    region = Region.of(PAIR, holes=[circle((7.5, 1.5), 0.5), circle((3, 3), 0.2)])
    assert [len(part.interiors) for part in region.polygons] == [2, 1]
    with pytest.raises(InputError, match=r"more hole 1: lies in no polygon, at \(5, 1\)"):
        Region.of(PAIR, holes=[box(4.5, 0.5, 5.5, 1.5)])
    with pytest.raises(InputError, match="more hole 1: touches or leaves the outline at"):
        Region.of(PAIR, holes=[box(7, 1, 9, 2)])
    with pytest.raises(InputError, match="hole 1: touches or leaves the outline at"):
        Region.of(box(0, 0, 4, 4), holes=[box(3, 1, 5, 2)])


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (box(3, 3, 5, 5), r"polygons 1 and 2 overlap at \(3.5, 3.5\); unite"),
        (box(4, 1, 6, 3), r"polygons 1 and 2 touch along an edge at \(4, 1\); unite"),
        (box(1, 1, 2, 2), "polygons 1 and 2 overlap"),
        (Polygon([(5, 5), (7, 7), (7, 5), (5, 7)]), r"polygon 2: crosses itself at \(6, 6\)"),
        (box(9, 9, 9, 10), "polygon 2: has 2 distinct points|no area"),
    ],
)
def test_polygons_must_lie_apart(other, message):
    with pytest.raises(InputError, match=message) as caught:
        Region.of(MultiPolygon([box(0, 0, 4, 4), other]))
    assert "\n" not in str(caught.value)


def test_polygons_may_touch_in_a_point_or_lie_in_a_hole():
    assert Region.of(MultiPolygon([box(0, 0, 4, 4), box(4, 4, 5, 5)])).area == 17
    island = MultiPolygon([box(0, 0, 9, 9) - box(2, 2, 7, 7), box(3, 3, 6, 6)])
    assert Region.of(island).area == 81 - 25 + 9


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (Point(0, 0), "a Point; a Polygon or MultiPolygon is needed"),
        (Polygon(), "is empty"),
        (MultiPolygon(), "is empty"),
        ("MULTIPOLYGON EMPTY", "is not a WKT POLYGON"),
        ("MULTIPOLYGON (((0 0, 1 0, 1 1)))", "does not close"),
        ({"type": "FeatureCollection", "features": []}, "holds 0 polygons"),
        (None, "outline: "),
    ],
)
def test_what_is_no_region_is_named(source, message):
    with pytest.raises(InputError, match=message):
        Region.of(source)


@pytest.mark.parametrize("start", range(4))
def test_repeated_and_collinear_points_are_left_out_and_said(start):
    corners = np.roll([(0.0, 0.0), (9.0, 1.0), (7.0, 8.0), (-1.0, 6.0)], start, 0)
    share = np.array([0.0, 0.25, 0.5, 0.5 + 1e-8])[:, None]
    sides = [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    region = Region.of(np.roll(np.vstack(sides), 2, 0))
    assert region.notes == ("outline: 4 repeated and 8 collinear points left out",)
    assert len(region.polygons[0].exterior.coords) == 5
    assert region.area == pytest.approx(Polygon(corners).area, rel=1e-12)
    holed = Region.of(box(-9, -9, 20, 20), holes=[np.vstack([corners, corners[-1:]])])
    assert holed.notes == ("outline, hole 1: 1 repeated point left out",)


@settings(max_examples=30, deadline=None)
@given(st.integers(3, 20000), st.floats(1e-2, 1e3), st.floats(-1e4, 1e4))
def test_mending_never_moves_an_outline(points, radius, shift):
    angle = 2 * np.pi * np.arange(points) / points
    xy = shift + radius * np.stack([np.cos(angle), np.sin(angle)], 1)
    mended = Region.of(xy).geometry.exterior
    off = shapely.distance(mended, shapely.points(xy)).max()
    assert off <= 2e-9 * 2 * radius + 1.5e-6 * (2 * np.pi * radius / points < 1e-6)


def test_a_spike_of_no_width_is_a_fault_and_not_mended():
    with pytest.raises(InputError, match="itself at"):
        Region.of([(0, 0), (4, 0), (4, 2), (8, 2), (4, 2), (4, 4), (0, 4)])


def test_a_precision_grid_stays_behind():
    coarse = shapely.set_precision(box(0, 0, 10, 10), 1.0)
    region = Region.of(coarse)
    assert shapely.get_precision(region.geometry) == 0
    assert region.inset(0.2).area == pytest.approx(9.6**2)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.1, 2))
def test_insets_keep_the_margin_and_leave_out_little_more(seed, margin):
    rng = np.random.default_rng(seed)
    count = rng.integers(4, 14)
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(0, 0.8, count)) / count
    radius = rng.uniform(4, 40, count)
    region = Region.of(radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1))
    try:
        room = region.inset(margin)
    except InputError:
        assert region.geometry.buffer(-margin * 1.001).is_empty
        return
    walls = region.geometry.boundary
    assert region.geometry.contains(room)
    assert walls.distance(room) >= margin * (1 - 1e-9)
    # The corners left by cutting at 1.5 margins from a needle's tip lie at hypot(1.5, 1).
    left_out = region.geometry.buffer(-1.81 * margin, quad_segs=64).difference(room)
    assert left_out.area < 1e-9


@pytest.mark.parametrize("name", OUTLINES)
def test_straight_sides_keep_their_corners_in_an_inset(name):
    region = Region.of(OUTLINES[name]())
    assert region.inset(0) is region.geometry
    room = region.inset(0.25)
    exact = region.geometry.buffer(-0.25, quad_segs=64)
    assert room.area == pytest.approx(exact.area, rel=2e-4)
    assert region.necks(0.5) == []


def test_a_region_without_room_names_its_widest_place():
    with pytest.raises(InputError, match=r"a road 0\.4 mm wide; its widest .* is 0\.3 mm wide"):
        Region.of(box(0, 0, 10, 0.3)).inset(0.2)
    for margin in (-1, float("nan")):
        with pytest.raises(InputError, match=r"margin: .* must not be negative"):
            Region.of(PAIR).inset(margin)
    with pytest.raises(InputError, match=r"width: .* must be positive"):
        Region.of(PAIR).necks(0)


SQUARES = box(0, 0, 10, 10) | box(16, 0, 26, 10)
HOURGLASS = Polygon([(0, 0), (10, 0), (5.2, 5), (10, 10), (0, 10), (4.8, 5)])
WAIST = box(0, 0, 20, 10) - Point(10, 0).buffer(4.85) - Point(10, 10).buffer(4.85)
LENSES = box(0, 0, 10, 10) - Point(3, 5).buffer(2) - Point(7.3, 5).buffer(2)


@pytest.mark.parametrize(
    ("shape", "place", "width"),
    [
        (SQUARES | box(9, 4.85, 17, 5.15), (13, 5), 0.3),
        (HOURGLASS, (5, 5), 0.4),
        (WAIST, (10, 5), 0.3),
        (LENSES, (5.15, 5), 0.3),
        (box(0, 0, 10, 10) | box(9, 4, 15, 4.3), (12.5, 4.15), 0.3),
        (box(0, 0, 10, 0.3), (5, 0.15), 0.3),
        (MultiPolygon([box(0, 0, 5, 5), box(9, 0, 9.3, 4)]), (9.15, 2), 0.3),
    ],
    ids=["bridge", "points", "bows", "holes", "arm", "strip", "other polygon"],
)
@pytest.mark.parametrize("turn", [0, 33])
def test_necks_say_where_and_how_wide(shape, place, width, turn):
    turned = shapely.affinity.rotate(shape, turn, origin=(0, 0))
    [neck] = Region.of(turned).necks(0.5)
    x, y = shapely.get_coordinates(shapely.affinity.rotate(Point(place), turn, origin=(0, 0)))[0]
    assert neck.width == pytest.approx(width, rel=5e-3)
    # A passage or an arm alike along its length is named anywhere on it.
    assert np.hypot(neck.x - x, neck.y - y) < 6
    assert turned.contains(Point(neck.x, neck.y))
    assert Region.of(turned).necks(0.55 * width) == []


def test_corners_are_no_arms_and_long_spikes_are():
    assert Region.of([(0, 0), (10, 0), (5, 9)]).necks(0.5) == []
    [spike] = Region.of([(0, 0), (10, 0), (10, 1)]).necks(0.5)
    assert spike.x < 5
    # From the tip to a disc of the road's width between two walls.
    half = np.arctan2(1, 10) / 2
    assert spike.depth == pytest.approx(0.25 / np.sin(half) - 0.25, rel=0.02)
    [passage] = Region.of(box(0, 0, 4, 4) | box(4, 1, 6, 1.3) | box(6, 0, 9, 3)).necks(0.5)
    assert passage.depth == np.inf


def test_a_hundred_thousand_points_work():
    angle = 2 * np.pi * np.arange(100_000) / 100_000
    radius = 40 + np.sin(50 * angle) + 0.3 * np.sin(300 * angle)
    region = Region.of(radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1))
    assert region.geometry.boundary.distance(region.inset(0.25)) == pytest.approx(0.25)


SQUARE = "[[[0,0],[4,0],[4,3],[0,3],[0,0]]]"
POLYGON = f'{{"type":"Polygon","coordinates":{SQUARE}}}'
LABEL = '{"type":"Feature","properties":{},"geometry":{"type":"Point","coordinates":[1,1]}}'
SHAPE = f'{{"type":"Feature","properties":{{}},"geometry":{POLYGON}}}'
WKT = "POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0))"


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + POLYGON,
        "\ufeff" + WKT,
        f'{{"type":"FeatureCollection","features":[{LABEL},{SHAPE}]}}',
        f'{{"type":"FeatureCollection","features":[{SHAPE},{LABEL},{LABEL}]}}',
        f'{{"type":"GeometryCollection","geometries":[{POLYGON}]}}',
        f'{{"type":"Feature","geometry":{{"type":"GeometryCollection","geometries":[{POLYGON}]}}}}',
        f"[{SHAPE}]",
        f"[{LABEL}, {POLYGON}]",
        '{"type":"FeatureCollection","features":[{"type":"Feature","geometry":null},'
        + SHAPE
        + "]}",
        "MULTIPOLYGON (((0 0, 4 0, 4 3, 0 3, 0 0)))",
        f"GEOMETRYCOLLECTION ({WKT})",
        f"geometrycollection(POINT (1 1), {WKT}, LINESTRING (0 0, 1e0 -1))",
        "SRID=4326; GEOMETRYCOLLECTION (MULTIPOLYGON (((0 0, 4 0, 4 3, 0 3, 0 0))))",
    ],
)
@pytest.mark.parametrize("as_file", [False, True])
def test_odd_but_valid_texts_hold_one_polygon(tmp_path, text, as_file):
    source = text
    if as_file:
        source = tmp_path / "outline"
        source.write_text(text)
    assert Region.of(source).area == 12


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"type":"LineString","coordinates":[[0,0],[1,0]]}', "type 'LineString'; a Polygon"),
        (f"[{LABEL},{LABEL}]", "GeoJSON holds 2 Point; a Polygon"),
        ("[]", "holds 0 polygons"),
        ("[3]", "GeoJSON is no object"),
        ('{"coordinates":[]}', "GeoJSON has no type"),
        ('{"type":"Feature","geometry":null}', "Feature without geometry"),
        ("GEOMETRYCOLLECTION (POINT (1 1), LINESTRING (0 0, 1 1))", "1 POINT, 1 LINESTRING is not"),
        (f"GEOMETRYCOLLECTION ({WKT}, CIRCLE (1 1))", "is not a WKT GEOMETRYCOLLECTION"),
        ("LINESTRING (0 0, 4 0, 4 3, 0 0)", "1 LINESTRING is not a WKT POLYGON"),
    ],
)
def test_what_holds_no_polygon_says_what_it_holds(text, words):
    with pytest.raises(InputError, match=words):
        Region.of(text)


@pytest.mark.parametrize("near", [1e-4, 0.002, 0.019])
def test_points_within_a_share_of_a_road_are_joined_and_said(near):
    points = [(0, 0), (4, 0), (4, 1), (4 - near, 1 + near / 2), (4, 3), (0, 3)]
    region = Region.of(points, merged=JOINED * 0.4)
    assert len(region.geometry.exterior.coords) == 5
    assert region.notes[0].startswith("outline: 1 repeated and 1 collinear points left out, the")
    assert f"at ({4 - near:g}, {1 + near / 2:g}) close to another" in region.notes[0]
    far = Region.of([*points[:3], (3.9, 1.05), *points[4:]], merged=JOINED * 0.4)
    assert not far.notes


def test_an_outline_within_the_tolerance_is_none():
    with pytest.raises(InputError, match=r"1 distinct points further apart than 0\.02"):
        Region.of([(0, 0), (0.01, 0), (0.01, 0.01)], merged=0.02)


def test_a_precision_grid_does_not_rule(tmp_path):
    plain = box(0, 0, 20, 20)
    gridded = shapely.set_precision(plain, 0.5)
    for region in (Region.of(gridded), Region((gridded,))):
        assert region.inset(0.175).area == pytest.approx((20 - 0.35) ** 2)
    assert Region.of(plain, holes=[shapely.set_precision(box(5, 5, 7, 7), 1)]).inset(
        0.1
    ).area == pytest.approx(19.8**2 - 2.2**2)


@pytest.mark.parametrize("amplitude", [5e-4, 2e-3, 5e-3, 0.02])
def test_a_noisy_wall_is_no_neck_and_hides_none(amplitude) -> None:
    # As scans and slices of meshes have them: edges far shorter than a road is wide.
    angle = 2 * np.pi * np.arange(20_000) / 20_000
    noise = amplitude * np.random.default_rng(3).normal(size=len(angle))
    radius = 35 + 5 * np.sin(5 * angle) + noise
    flower = Polygon(np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1))
    assert Region.of(flower).necks(0.4) == []
    bridged = shapely.union_all([flower, box(30, -0.15, 60, 0.15), box(50, -5, 60, 5)])
    (place,) = Region.of(bridged).necks(0.4)
    assert 40 < place.x < 50
    assert place.width == pytest.approx(0.3)
