"""Sub-domains with rasters: how a region is cut, what is laid in each, and what is refused."""

from itertools import pairwise

import jax
import numpy as np
import pytest
import shapely
from scipy.spatial import KDTree

from fdjax.app import config
from fdjax.errors import InputError
from fdjax.formats import profile, ssl
from fdjax.part.part import Part
from fdjax.part.region import Region
from fdjax.pattern import raster_paths, subdomains
from fdjax.pattern.raster_paths import contours, length_of, raster, raster_lengths
from fdjax.pattern.raster_pattern import Fill
from fdjax.pattern.rasters import Rasters
from fdjax.pattern.zigzag import Sides
from fdjax.plan.check import check
from fdjax.plan.measure import solid_shares
from fdjax.plan.trace import lay
from fdjax.road.bead import section_area
from fdjax.target.target import expression

MARLIN = profile.load("marlin-0.4")
LINEAR = expression("0.2 + 0.25*x/40", quantity="solid")
PLATE = shapely.box(0, 0, 40, 30)
HOLED = PLATE.difference(shapely.Point(18, 14).buffer(5))


def begun(outline=HOLED, target=LINEAR, layers=6, **settings):
    part = Part.plate(outline, layers=layers, height=0.2)
    return part, Rasters(**settings).begin(part, target, MARLIN.limits, 5.0)


def laid(part, pattern):
    strokes = pattern.strokes(pattern.gaps)
    return lay(strokes, part, lift_length=4.0, least_road=1.0, tolerance=4e-3)


WAYS = {
    "one": None,
    "grid": {"grid": (2, 2)},
    "sites": {"sites": ((8.0, 8.0), (30.0, 6.0), (20.0, 26.0))},
    "levels": {"levels": (0.28, 0.36)},
    "polygons": {
        "polygons": (((0, 0), (25, 0), (15, 30), (0, 30)), ((25, 0), (40, 0), (40, 30), (15, 30)))
    },
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("perimeters", [0, 2])
def test_each_subdomain_holds_the_mean_that_is_asked(way, perimeters):
    part, pattern = begun(
        domains=WAYS[way], perimeters=perimeters, fills=("raster", "contour"), angles=(0.0, 30.0)
    )
    build = laid(part, pattern)
    outlines = [fill.outline for fill in pattern.fills]
    assert shapely.union_all(outlines).area == pytest.approx(HOLED.area, rel=1e-6)
    assert sum(each.area for each in outlines) == pytest.approx(HOLED.area, rel=1e-6)
    for fill, got in zip(pattern.fills, solid_shares(build, outlines), strict=True):
        xy = np.random.default_rng(0).uniform((0, 0), (40, 30), (40_000, 2))
        inside = shapely.contains_xy(fill.outline, *xy.T)
        mean = float(np.mean(0.2 + 0.25 * xy[inside, 0] / 40))
        assert fill.asked == pytest.approx(mean, rel=0.01)
        assert got == pytest.approx(fill.asked, rel=0.005)
    found = check(build.replace(origin=(50, 50)), MARLIN.limits)
    assert [each for each in found if each.severity == "error"] == []


def test_lines_have_their_angle_and_spacing_and_turn_on_the_next_layer():
    part, pattern = begun(PLATE, angles=(30.0,), perimeters=0, air_gaps=(1.6,), layers=2)
    directions = []
    for layer in laid(part, pattern).layers:
        steps = np.concatenate([np.diff(road.xy, axis=0) for road in layer.roads])
        longest = steps[np.hypot(*steps.T) > 15]
        directions.append(np.degrees(np.arctan2(longest[:, 1], longest[:, 0])) % 180)
    assert directions[0] == pytest.approx(np.full(len(directions[0]), 30.0), abs=0.01)
    assert directions[1] == pytest.approx(np.full(len(directions[1]), 120.0), abs=0.01)
    path = raster(shapely.box(0, 0, 10, 9), 0.0, 2.0, 0.5)
    assert sorted({float(y) for xy in path for y in xy[:, 1].round(9)}) == [1, 3, 5, 7, 9]
    assert len(path) == 1


def test_lines_that_a_hole_or_a_corner_just_cuts_keep_apart():
    # The hole reaches .02 mm over the line at y = 5, the notch as far over that at y = 3.
    room = shapely.box(0, 0, 20, 10).difference(shapely.Point(6, 7).buffer(2.02, quad_segs=32))
    room = room.difference(shapely.Polygon([(12, 2.98), (10, 0), (14, 0)]))
    paths = raster(room, 0.0, 2.0, 0.5, apart=0.4)
    lines = shapely.linestrings([xy for path in paths for xy in pairwise(path)])
    i, j = np.triu_indices(len(lines), 1)
    lengths = shapely.distance(lines[i], lines[j])
    meet = lengths == 0
    # What meets are the sides of a path's corners.
    assert meet.sum() == sum(len(path) - 2 for path in paths)
    assert lengths[~meet].min() > 0.4 - 1e-9
    assert sum(shapely.length(lines)) > 90


ROOMS = [
    shapely.box(0, 0, 4, 4),
    shapely.Polygon([(0, 0), (5, 1), (6, 4), (2, 6), (-1, 3)]),
    shapely.Polygon([(0, 0), (9, 0.3), (8, 2), (1, 2)]),
    shapely.Point(3, 3).buffer(4),
    shapely.Polygon([(0, 0), (6, 0), (6, 6), (3, 3), (0, 6)]),
    shapely.box(0, 0, 6, 6).difference(shapely.box(2, 2, 3, 3)),
]


@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize("angle", [0.0, 3.0, 45.0, 90.0, 117.0])
@pytest.mark.parametrize("spacing", [0.6, 1.0, 9.0])
def test_paths_of_convex_rooms_are_those_of_any_other(monkeypatch, room, angle, spacing):
    phases = [0.1, 0.5, 0.9]
    found = [raster(room, angle, spacing, phase, apart=0.4) for phase in phases]
    lengths = raster_lengths(room, angle, spacing, phases, apart=0.4)
    monkeypatch.setattr(Sides, "of", lambda outline: None)
    raster_paths._turned.cache_clear()
    expected = [raster(room, angle, spacing, phase, apart=0.4) for phase in phases]
    raster_paths._turned.cache_clear()
    for one, other, length in zip(found, expected, lengths, strict=True):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert a == pytest.approx(b, abs=1e-9)
        assert length == pytest.approx(sum(map(length_of, other)), abs=1e-9)


@pytest.mark.parametrize("angle", [45.0, 63.0, 135.0, 160.0])
def test_holes_and_corners_within_subdomains_are_no_fault(angle):
    outline = shapely.Polygon([(0, 0), (40, 0), (40, 17), (16, 17), (16, 40), (0, 40)])
    outline = outline.difference(shapely.Point(13, 12).buffer(4))
    flat = expression("0.3", quantity="solid")
    part, pattern = begun(outline, flat, domains={"grid": (3, 3)}, angles=(angle,), layers=10)
    found = check(laid(part, pattern).replace(origin=(50, 50)), MARLIN.limits)
    assert [each for each in found if each.severity == "error"] == []


def test_perimeters_that_hold_a_little_too_much_are_laid_thinner():
    part, pattern = begun(PLATE, perimeters=4, layers=2)
    (fill,) = pattern.fills
    held = fill.at(1e3).laid_at(0.4)
    share = held.lengths(pattern.ways[:1])[0] * section_area(0.4, 0.2) / (PLATE.area * 0.2)
    little = expression(f"{0.98 * share}", quantity="solid")
    part, pattern = begun(PLATE, little, perimeters=4, layers=2)
    (got,) = solid_shares(laid(part, pattern), [PLATE])
    assert got == pytest.approx(0.98 * share, rel=1e-3)


def test_contours_lie_at_equal_distances():
    rings = contours(shapely.box(0, 0, 20, 20), 0.4, 2.0, 0.5)
    assert [float(xy[:, 0].min().round(9)) for xy in rings] == [1, 3, 5, 7, 9]


def test_gradients_of_the_deposit_are_those_of_the_spacing():
    _, pattern = begun(domains={"grid": (2, 1)})

    def total(gaps):
        return pattern.deposit(pattern.realise(gaps)).volume.sum()

    slope = jax.grad(total)(pattern.gaps)
    step = 1e-4
    for k in range(2):
        up, down = (float(total(pattern.gaps.at[k].add(d))) for d in (step, -step))
        assert float(slope[k]) == pytest.approx((up - down) / (2 * step), rel=1e-5)


def test_the_deposit_of_many_subdomains_is_no_longer_program_than_of_few():
    lengths = []
    for many in (1, 5):
        _, pattern = begun(PLATE, perimeters=0, domains={"grid": (many, many)})
        program = jax.make_jaxpr(lambda gaps, p=pattern: p.deposit(p.realise(gaps)).volume)
        lengths.append(len(program(pattern.gaps).eqns))
        deposit = pattern.deposit(pattern.realise(pattern.gaps))
        asked = sum(fill.asked * fill.outline.area for fill in pattern.fills) * 1.2
        assert float(deposit.volume.sum()) == pytest.approx(asked, rel=1e-6)
        assert np.unique(deposit.xyz[:, 2]) == pytest.approx(np.arange(0.1, 1.2, 0.2))
    assert lengths[0] == lengths[1]


def test_the_slice_file_keeps_what_each_subdomain_is_filled_with():
    part, pattern = begun(domains=WAYS["sites"], angles=(10.0, -20.0), road_widths=(0.4, 0.5))
    build = laid(part, pattern)
    text = ssl.write(build)
    again = ssl.read(text)
    assert len(again.layers) == 6
    for layer in again.layers:
        assert layer.outline.area == pytest.approx(HOLED.area, rel=1e-5)
        for one, other in zip(layer.subdomains, build.layers[0].subdomains, strict=True):
            assert one.outline.symmetric_difference(other.outline).area < 1e-3
            assert (one.fill, one.angle, one.perimeters) == (other.fill, other.angle, 1)
            assert one.road_width == pytest.approx(other.road_width, abs=1e-6)
            assert one.air_gap == pytest.approx(other.air_gap, abs=1e-6)
    plain = ssl.write(build, extended=False)
    assert "PROPERTIES" not in plain
    assert ssl.read(plain).layers[0].outline.area == pytest.approx(HOLED.area, rel=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("GAP=", "GIP=", "needs ANGLE, FILL, GAP"),
        ("PERIMETERS=1", "PERIMETERS=x", "must be numbers"),
        ("PROPERTIES(", "PROPERTIES", "two numbers|needs ANGLE"),
    ],
)
def test_damaged_properties_are_an_error_with_the_line(old, new, words):
    part, pattern = begun(PLATE, layers=1)
    text = ssl.write(laid(part, pattern)).replace(old, new, 1)
    with pytest.raises(InputError, match=f"SSL line 6.*({words})"):
        ssl.read(text)


def test_cells_of_voronoi_are_sound_on_regular_sites():
    turn = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    sites = [(20 + 8 * np.cos(a), 15 + 8 * np.sin(a)) for a in turn]
    cells = subdomains.voronoi(Region.of(PLATE), sites)
    assert sum(cell.area for cell in cells) == pytest.approx(PLATE.area)
    for site, cell in zip(sites, cells, strict=True):
        assert cell.contains(shapely.Point(site))


def test_cells_of_many_sites_are_those_of_the_nearest_one():
    sites = np.random.default_rng(1).uniform((-10, -5), (40, 35), (600, 2))
    cells = subdomains.voronoi(Region.of(HOLED), sites.tolist())
    assert sum(cell.area for cell in cells) == pytest.approx(HOLED.area, rel=1e-5)
    xy = np.random.default_rng(2).uniform((0, 0), (40, 30), (20_000, 2))
    nearest = KDTree(sites).query(xy)[1]
    place, cell = shapely.STRtree(cells).query(shapely.points(xy), predicate="within")
    inside = shapely.contains_xy(HOLED, *xy.T)
    assert len(place) == len(np.unique(place))
    assert len(place) == pytest.approx(inside.sum(), abs=3)
    # One cell a site: the nearest.
    pairs = np.unique(np.stack([nearest[place], cell]), axis=1)
    assert len(pairs.T) == len(np.unique(pairs[0])) == len(np.unique(pairs[1]))


LEFT, RIGHT = ((0, 0), (20, 0), (20, 30), (0, 30)), ((20, 0), (40, 0), (40, 30), (20, 30))


@pytest.mark.parametrize(
    ("settings", "target", "words"),
    [
        ({"domains": {"polygons": (LEFT, LEFT)}}, LINEAR, "sub-domains 1 and 2 overlap at"),
        ({"domains": {"polygons": (LEFT,)}}, LINEAR, r"leave a gap at \("),
        ({"domains": {"sites": ((5.0, 5), (9, 9), (5, 5))}}, LINEAR, r"two sites at \(5, 5\)"),
        ({"domains": {"levels": (0.4, 0.3)}}, LINEAR, "levels must rise"),
        ({}, expression("0.99", quantity="solid"), "sub-domain 1: a solid share of 0.990"),
        ({"perimeters": 20}, expression("0.1", quantity="solid"), "its perimeters alone"),
        # A ring in a cell of 5/3 mm, .212 mm from its sides.
        (
            {"domains": {"grid": (24, 18)}},
            LINEAR,
            "sub-domain 1: .* its perimeters alone hold 0.639",
        ),
        ({"road_widths": (0.4, 0.1)}, LINEAR, "road_widths: 0.1 mm; the machine lays 0.3 to 0.8"),
        ({"domains": {"grid": (100, 100)}}, LINEAR, "sub-domain 1: has no room for roads"),
    ],
)
def test_what_cannot_be_filled_is_refused(settings, target, words):
    with pytest.raises(InputError, match=words) as caught:
        begun(PLATE, target, **settings)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        ({"domains": {"grid": [2, 2], "sites": [[1, 1]]}}, "one of grid, sites"),
        ({"domains": {"grids": [2, 2]}}, 'did you mean "grid"'),
        ({"domains": {"sites": []}}, "1 or more are needed"),
        ({"fills": ["rasters"]}, 'did you mean "raster"'),
        ({"angles": 30}, "must be a list"),
    ],
)
def test_a_job_says_what_is_wrong(pattern, words):
    table = {
        "part": {"shape": "cosine_top"},
        "target": {"porosity": 0.7},
        "pattern": {"kind": "rasters"} | pattern,
    }
    with pytest.raises(InputError, match=words):
        config.parse(table)


def test_an_air_gap_is_found_in_a_few_looks(monkeypatch):
    looks = []
    lengths = Fill.lengths
    monkeypatch.setattr(Fill, "lengths", lambda fill, ways: looks.append(1) or lengths(fill, ways))
    part = Part.plate(shapely.box(0, 0, 30, 30), layers=10, height=0.2)
    pattern = Rasters(domains={"grid": (6, 6)}, perimeters=0, angles=(0.0, 30.0)).begin(
        part, expression("0.25 + 0.2*x/30", quantity="solid"), MARLIN.limits, 5.0
    )
    assert len(looks) <= 36 * 20
    for fill in pattern.fills:
        held = fill.lengths(pattern.ways).sum() * float(section_area(fill.laid, 0.2))
        assert held == pytest.approx(fill.asked * fill.outline.area * 2.0, rel=1e-6)
