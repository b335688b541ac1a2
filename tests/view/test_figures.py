"""Figures: what they show, that they are quick, and that nothing global is touched."""

import subprocess
import sys

import numpy as np
import pytest
import shapely
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.colors import to_hex
from PIL import Image

from fdjax.errors import InputError
from fdjax.plan.toolpath import Layer, Road
from fdjax.view import figures
from fdjax.view.strips import strips

PLATE = shapely.box(0, 0, 40, 20)
HOLED = PLATE.difference(shapely.Point(12, 10).buffer(5))
ISLANDS = shapely.MultiPolygon([shapely.box(0, 0, 9, 9), shapely.box(20, 0, 40, 20)])
EDGES = np.arange(0, 41.0, 5), np.arange(0, 21.0, 5)
ASKED = np.linspace(0.3, 0.7, 8)[:, None] + np.zeros(4)


def meshes(figure):
    return [c for axes in figure.axes for c in axes.collections
            if isinstance(c, QuadMesh) and c.get_array().size == ASKED.size]  # fmt: skip


@pytest.mark.parametrize("outline", [PLATE, HOLED, ISLANDS], ids=["plate", "holed", "islands"])
def test_asked_and_got_share_one_scale_and_the_error_is_symmetric(outline):
    got = ASKED + 0.01
    got[7, 3] = 0.78
    figure = figures.porosity_figure(*EDGES, ASKED, got, outline=outline, title="plate")
    asked_mesh, got_mesh, error_mesh = meshes(figure)
    assert asked_mesh.norm is got_mesh.norm
    assert asked_mesh.get_clim() == (0.3, 0.78)
    assert error_mesh.get_clim() == pytest.approx((-0.08, 0.08))
    # axis 0 of the arrays is x, which matplotlib wants along columns
    np.testing.assert_allclose(np.ravel(asked_mesh.get_array()), ASKED.T.ravel())
    np.testing.assert_allclose(np.ravel(error_mesh.get_array()), (got - ASKED).T.ravel())
    words = [text.get_text() for text in figure.texts]
    assert words == ["plate", "RMS error 0.0172, largest +0.0800"]


def test_windows_left_out_are_blank_and_weigh_nothing():
    got, area = ASKED + 0.02, np.ones_like(ASKED)
    got[0, 0] = np.nan
    area[0, 0], got[1, 0], area[1, 0] = np.nan, ASKED[1, 0], 0.0
    figure = figures.porosity_figure(*EDGES, ASKED, got, outline=PLATE, weights=area)
    for mesh in meshes(figure):
        assert np.ma.getmaskarray(mesh.get_array()).sum() == 1
    assert figure.texts[1].get_text() == "RMS error 0.0200, largest +0.0200"
    with pytest.raises(InputError, match="no window"):
        figures.porosity_figure(*EDGES, ASKED * np.nan, got, outline=PLATE)


def test_an_even_porosity_looks_even():
    flat = np.full_like(ASKED, 0.65)
    low, high = meshes(figures.porosity_figure(*EDGES, flat, flat, outline=PLATE))[0].get_clim()
    assert (low, high) == pytest.approx((0.625, 0.675))


@pytest.mark.parametrize(
    "size", [(80, 80), (10, 300), (300, 10), (1000, 800)], ids=lambda size: f"{size[0]}x{size[1]}"
)
def test_figures_of_any_proportion_keep_everything_inside(tmp_path, size):
    outline = shapely.box(0, 0, *size)
    x, y = np.linspace(0, size[0], 41), np.linspace(0, size[1], 41)
    asked = 0.5 + 0.2 * np.sin(np.arange(1600.0)).reshape(40, 40)
    lines = [np.stack([np.full(200, c), np.linspace(1, size[1] - 1, 200)], 1) for c in x[1:-1]]
    figure = figures.porosity_figure(x, y, asked, asked + 1e-3, outline=outline, title="strip")
    figures.save(figure, tmp_path / "p.png")
    layer = layer_of(*(Road(line, 0.4) for line in lines), outline=outline)
    figures.save(figures.roads_figure([layer], title="strip"), tmp_path / "g.png")
    for name in ("p.png", "g.png"):
        with Image.open(tmp_path / name) as picture:
            pixels = np.asarray(picture.convert("L"))
        rim = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        assert (rim > 250).all()


def layer_of(*roads, z=0.2, outline=PLATE):
    return Layer(z, 0.2, roads, outline)


def covered(road):
    whole = shapely.Polygon()
    for path in strips(road):
        rings = [shapely.LinearRing(ring) for ring in path.to_polygons()]
        shells, holes = ([r for r in rings if r.is_ccw is ccw] for ccw in (True, False))
        shape = shapely.union_all([shapely.Polygon(shell) for shell in shells])
        whole |= shape.difference(shapely.union_all([shapely.Polygon(hole) for hole in holes]))
    return whole


def test_a_strip_covers_what_the_road_does():
    turns = np.array([(0, 0), (10, 0), (10, 1), (0, 1)])
    expected = shapely.LineString(turns).buffer(0.25)
    assert covered(Road(turns, 0.5)).symmetric_difference(expected).area < 0.01
    closed = Road(np.array([(0, 0), (10, 0), (10, 10), (0, 10)]), 0.5, closed=True)
    assert covered(closed).area == pytest.approx(40 * 0.5 - 4 * 0.25**2 * (1 - np.pi / 4), abs=0.01)


def test_a_strip_follows_the_width_and_the_length_of_a_road():
    x = np.linspace(0, 100, 501)
    width = np.where(x[:-1] < 50, 0.4, 0.8)
    road = Road(np.stack([x, np.sin(x / 5)], 1), width)
    whole = covered(road)
    assert whole.geom_type == "Polygon"
    assert whole.area == pytest.approx(float((road.segment_lengths * width).sum()), rel=0.01)


def test_roads_figure_draws_each_layer_with_its_own_roads_travel_and_start():
    first = layer_of(
        Road(np.array([(2, 0.5), (2, 19.5)]), 0.4, family="xi"),
        Road(np.array([(4, 19.5), (4, 0.5)]), 0.4, family="xi"),
    )
    second = layer_of(Road(np.array([(1, 3), (39, 3)]), 0.6, family="eta"), z=0.4, outline=HOLED)
    figure = figures.roads_figure([first, second], title="plate")
    left, right = figure.axes
    assert left.get_title(loc="left") == "z 0.2 mm: 2 roads, 2 mm travel"
    assert right.get_title(loc="left") == "z 0.4 mm: 1 road"
    assert left.get_xlim() == right.get_xlim() == (0, 40)
    beads = [c for c in right.collections if isinstance(c, PathCollection)]
    ((strip,),) = [bead.get_paths() for bead in beads]
    np.testing.assert_allclose(strip.get_extents().extents, (0.7, 2.7, 39.3, 3.3))
    (travel,) = [c for c in left.collections if isinstance(c, LineCollection)]
    np.testing.assert_allclose(travel.get_segments(), [[(2, 19.5), (4, 19.5)]])
    (start,) = [line for line in left.lines if line.get_marker() == "o"]
    assert start.get_xydata().tolist() == [[2, 0.5]]
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["ξ roads", "η roads", "travel", "start"]


def test_roads_without_family_or_outline_are_drawn_too():
    layer = layer_of(Road(np.array([(0, 0), (10, 0), (10, 4)]), 0.5), outline=None)
    (axes,) = figures.roads_figure([layer]).axes
    assert (*axes.get_xlim(), *axes.get_ylim()) == (-0.25, 10.25, -0.25, 4.25)
    with pytest.raises(InputError, match="no roads"):
        figures.roads_figure([layer_of()])


def test_functions_share_a_scale_about_zero_that_a_few_values_do_not_pale():
    x, y = np.linspace(0, 40, 81), np.linspace(0, 20, 41)
    tame = np.linspace(-1, 1, 81)[:, None] + np.zeros(41)
    wild = tame.copy()
    wild[40, 20] = 100
    across, up = np.meshgrid(x, y, indexing="ij")
    figure = figures.functions_figure(
        [("P = one", x, y, tame), ("Q = other", across, up, wild)], outline=PLATE, unit="1/mm²"
    )
    first, second = (
        c for axes in figure.axes[:2] for c in axes.collections if isinstance(c, QuadMesh)
    )
    assert first.norm.vmax == second.norm.vmax == -first.norm.vmin == pytest.approx(1, abs=0.03)
    np.testing.assert_allclose(np.ravel(first.get_array()), tame.ravel())
    assert "Q from −0.975 to 100 1/mm²" in figure.texts[1].get_text()


def test_functions_that_are_not_finite_somewhere_stay_blank_there():
    x = np.linspace(0, 40, 9)
    values = np.ones((9, 9))
    values[0, 0] = np.inf
    figure = figures.functions_figure([("P", x, x / 2, values)], outline=PLATE)
    mesh = figure.axes[0].collections[0]
    assert np.ma.getmaskarray(mesh.get_array()).sum() == 1


def test_nothing_global_is_loaded():
    code = "import sys, fdjax.view.figures; assert 'matplotlib.pyplot' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_pictures_that_cannot_be_written(tmp_path):
    figure = figures.porosity_figure(*EDGES, ASKED, ASKED, outline=PLATE)
    for name in ("g", "g.docx", "g.txt"):
        with pytest.raises(InputError, match=r"is written as \.png"):
            figures.save(figure, tmp_path / name)
    with pytest.raises(InputError, match="cannot be written"):
        figures.save(figure, tmp_path / "nowhere" / "g.png")


def test_the_errors_scale_is_the_tolerance_and_the_largest_is_told():
    got = ASKED.copy()
    got[1, 0] += 0.3
    figure = figures.porosity_figure(*EDGES, ASKED, got, outline=PLATE, tolerance=0.05)
    mesh = meshes(figure)[2]
    assert mesh.get_clim() == (-0.05, 0.05)
    colours = mesh.get_cmap()
    assert to_hex(colours(2.0)) == figures.FAR_OVER
    assert to_hex(colours(-1.0)) == figures.FAR_UNDER
    x, y = (edges[k] + edges[k + 1] for edges, k in zip(EDGES, (1, 0), strict=True))
    size = EDGES[0][1] - EDGES[0][0]
    end = f" at ({x / 2:g}, {y / 2:g}) mm, windows of {size:g} mm"
    assert figure.texts[1].get_text().endswith(end)
    small = figures.porosity_figure(*EDGES, ASKED, ASKED + 1e-3, outline=PLATE, tolerance=0.05)
    assert meshes(small)[2].get_clim() == (-0.05, 0.05)


def test_windows_left_out_are_hatched(tmp_path):
    def greys(got):
        figure = figures.porosity_figure(*EDGES, ASKED, got, outline=PLATE, tolerance=1.0)
        figures.save(figure, tmp_path / "p.png")
        with Image.open(tmp_path / "p.png") as picture:
            return np.asarray(picture.convert("RGB"), int)

    gap = ASKED.copy()
    gap[0, 0] = np.nan
    changed = np.abs(greys(ASKED) - greys(gap)).sum(2) > 30
    bare = greys(gap)[changed]
    assert len(bare) > 100
    dark = (bare < 200).all(1)
    assert 0.05 < dark.mean() < 0.8  # lines on white, three times
