"""Outlines: the same polygon from every source, and every fault named with its place."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LinearRing, Polygon

from fdjax.errors import InputError
from fdjax.part.contour import circle, contour

SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
HOLE = [(2.0, 2.0), (2.0, 4.0), (4.0, 4.0), (4.0, 2.0)]
POLYGON = {
    "type": "Polygon",
    "coordinates": [[list(p) for p in (*ring, ring[0])] for ring in (SQUARE, HOLE)],
}
FEATURE = {"type": "Feature", "properties": {"corners": []}, "geometry": POLYGON}
WKT = Polygon(SQUARE, [HOLE]).wkt


@pytest.mark.parametrize(
    "source",
    [
        WKT,
        "SRID=4326;" + WKT.lower(),
        "POLYGON Z ((0 0 1, 10 0 1, 10 10 1, 0 10 1, 0 0 1), (2 2 1, 2 4 1, 4 4 1, 4 2 1, 2 2 1))",
        POLYGON,
        FEATURE,
        {"type": "MultiPolygon", "coordinates": [POLYGON["coordinates"]]},
        {"type": "FeatureCollection", "features": [FEATURE]},
        json.dumps(FEATURE),
        Polygon(SQUARE[::-1], [HOLE]),
    ],
)
def test_every_source_gives_the_same_polygon(source, tmp_path: Path) -> None:
    polygon = contour(source)
    assert polygon.equals(Polygon(SQUARE, [HOLE]))
    assert polygon.exterior.is_ccw
    assert not polygon.interiors[0].is_ccw
    if isinstance(source, str):
        file = tmp_path / "outline (1).txt"
        file.write_text(source + "\n")
        assert contour(file).equals(polygon)
        assert contour(str(file)).equals(polygon)


def test_points_may_close_repeat_and_run_clockwise() -> None:
    for points in (SQUARE, [*SQUARE, SQUARE[0]], SQUARE[::-1], [SQUARE[0], *SQUARE]):
        assert len(contour(points).exterior.coords) == 5
        assert contour(np.array(points)).area == 100


def test_holes_come_as_polygons_points_rings_and_circles() -> None:
    plate = contour(SQUARE, holes=[HOLE, circle((7, 7), 1), LinearRing([(6, 1), (8, 1), (7, 3)])])
    assert plate.area == pytest.approx(100 - 4 - np.pi - 2, abs=1e-12)


def test_units_scale_outline_and_holes() -> None:
    assert contour(SQUARE, holes=[HOLE], unit="in").area == pytest.approx(96 * 25.4**2)
    assert contour(WKT, unit="mil").bounds == pytest.approx((0, 0, 0.254, 0.254))


@given(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), st.floats(0.01, 100))
@settings(max_examples=20, deadline=None)
def test_circle_has_the_area_of_the_disc_and_lies_by_its_edge(centre, radius) -> None:
    disc = circle(centre, radius)
    assert disc.area == pytest.approx(np.pi * radius**2, rel=1e-9)
    xy = np.asarray(disc.exterior.coords)
    for points in (xy, (xy[1:] + xy[:-1]) / 2):
        assert np.abs(np.hypot(*(points - centre).T) / radius - 1).max() < 1e-4


FAULTS = [
    ([(0, 0), (10, 10), (10, 0), (0, 10)], r"crosses itself at \(5, 5\)"),
    ([(0, 0), (10, 0), (10, 10), (5, 0), (0, 10)], r"touches itself at \(5, 0\)"),
    ([(0, 0), (10, 0), (10, 0), (0, 0)], "2 distinct points"),
    ([(0, 0), (10, 0), (10, 1e-13), (0, 0)], "2 distinct points"),
    ([(1, 1), (1, 1), (1, 1)], "1 distinct points"),
    ([(0, 0), (10, 0), (20, 0)], "no area"),
    ([(0, 0), (10, 0), (float("inf"), 10)], "point 2 is not finite"),
    ([(0, 0), (10, 0), (10**400, 10)], "pairs of numbers"),
    ([(0, 0), (10, 0), (10, 10, 3)], "pairs of numbers"),
    ("POLYGON ((0 0, 10 0, 10 10))", r"does not close: .* \(0, 0\) and ends at \(10, 10\)"),
    ("POLYGON ((0 0, 10 0, 10 10", "not a WKT POLYGON"),
    ("POLYGON EMPTY", "not a WKT POLYGON"),
    ("LINESTRING (0 0, 10 0, 10 10)", "not a WKT POLYGON"),
    ("POLYGON ((0 0, 10 x, 10 10, 0 0))", "'x' in the WKT is no number"),
    ("POLYGON ((0 0, 10, 10 10, 0 0))", "pairs of numbers"),
    ("POLYGON ((0 0, 10 nan, 10 10, 0 0))", "point 1 is not finite"),
    ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1]]]}', "does not close"),
    ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 0]}', "not JSON: .* line 1, column 52"),
    ('{"type": "Polygon", "coordinates": [[0, 1], [1, 0]]}', "lists of two numbers"),
    ('{"type": "Polygon", "coordinates": []}', "is empty"),
    ('{"type": "Polygon"}', 'without a list of "coordinates"'),
    ('{"type": "Point", "coordinates": [0, 1]}', "type 'Point'; a Polygon is needed"),
    ('{"type": "Feature", "geometry": null}', "a Polygon is needed"),
    ({"type": "FeatureCollection", "features": []}, "holds 0 polygons"),
    ({"type": "FeatureCollection", "features": [FEATURE, FEATURE]}, "holds 2 polygons"),
    ("no_such_file.geojson", 'outline "no_such_file.geojson": cannot be read'),
]


@pytest.mark.parametrize(("source", "message"), FAULTS)
def test_bad_outlines_are_named_in_one_line(source, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        contour(source)
    assert "\n" not in str(caught.value)


def test_bad_files_are_named(tmp_path: Path) -> None:
    file = tmp_path / "outline.geojson"
    for content, message in (
        (b"\xff\xfe\x00", "no text file"),
        (b"x, y\n0, 0\n", "neither WKT nor GeoJSON"),
        (b"", "neither WKT nor GeoJSON"),
        (b'{"type": ', "not JSON"),
        (b'{"type": "Point"}', "a Polygon is needed"),
        (WKT.replace("(0 0,", "(0 1,").encode(), "does not close"),
    ):
        file.write_bytes(content)
        with pytest.raises(InputError, match=message) as caught:
            contour(file)
        assert "outline.geojson" in str(caught.value)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="cannot be read"):
        contour(tmp_path)


@pytest.mark.parametrize(
    ("holes", "message"),
    [
        ([circle((9.5, 5), 1)], r"hole 1: touches or leaves the outline at \(1\d"),
        ([HOLE, circle((20, 5), 1)], "hole 2: touches or leaves"),
        ([[(0, 2), (2, 2), (2, 4)]], r"hole 1: touches or leaves the outline at \(0, 2\)"),
        ([HOLE, [(4, 3), (6, 3), (6, 5)]], r"holes 1 and 2 touch or overlap at \(4, 3\)"),
        ([circle((5, 5), 3), circle((5, 5), 1)], "holes 1 and 2 touch or overlap"),
        ([[(2, 2), (4, 4), (4, 2), (2, 4)]], r"hole 1: crosses itself at \(3, 3\)"),
        ([Polygon(SQUARE, [HOLE])], "hole 1: has holes itself"),
    ],
)
def test_bad_holes_are_named(holes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        contour(SQUARE, holes=holes)


def test_bad_unit_and_radius_are_named() -> None:
    with pytest.raises(InputError, match='unknown unit "inc"'):
        contour(SQUARE, unit="inc")
    with pytest.raises(InputError, match="radius -1; it must be positive"):
        circle((0, 0), -1)
    with pytest.raises(InputError, match="circle: point 0 is not finite"):
        circle((0, float("nan")), 1)
