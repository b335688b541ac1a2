"""What counts as solid, window by window, against unions of beads as geometry."""

import numpy as np
import pytest
import shapely

from fdjax.errors import InputError
from fdjax.mesh.triangulation import delaunay
from fdjax.plan.counted import Counted, deposits, total
from fdjax.plan.coverage import coverage
from fdjax.plan.measure import measure
from fdjax.plan.toolpath import Build, Layer, Road
from fdjax.plan.trace import trim

PLATE = shapely.box(0, 0, 40, 40)


def tangle(seed=1, layers=1):
    mesh = delaunay(np.random.default_rng(seed).uniform(1, 39, (150, 2)))
    roads = [Road(mesh.xy[edge], 0.4, family="mesh") for edge in mesh.edges]
    return Build(tuple(Layer(0.2 * (k + 1), 0.2, roads, PLATE) for k in range(layers)))


def test_windows_count_the_union_of_the_beads():
    build = tangle()
    got = measure(build, window=5.0, count="coverage")
    beads = [shapely.LineString(r.xy).buffer(0.2, quad_segs=128) for r in build.layers[0].roads]
    union = shapely.union_all(beads)
    x, y = np.meshgrid(got.x[:-1], got.y[:-1], indexing="ij")
    exact = shapely.area(shapely.intersection(union, shapely.box(x, y, x + 5, y + 5))) / 25
    assert np.sqrt(np.mean((got.solid - exact) ** 2)) < 5e-4
    assert got.solid == pytest.approx(exact, abs=2e-3)
    assert got.mean_solid == pytest.approx(union.area / PLATE.area, rel=2e-4)
    assert got.mean_solid == pytest.approx(coverage(build), rel=1e-4)


def test_pieces_hold_what_the_whole_does():
    build = tangle(layers=3)
    for count in ("volume", "coverage"):
        places, volumes = deposits(build, 1.25, count)
        assert volumes.sum() == pytest.approx(total(build, count))
        assert np.unique(places[:, 2]) == pytest.approx([0.1, 0.3, 0.5])
    assert total(build, "volume") == pytest.approx(build.volume)
    start, end, _ = Counted.of(build.layers[0], "coverage")
    assert np.hypot(*(end - start).T).min() >= 0
    assert len(deposits(Build((Layer(0.2, 0.2, ()),)), 1.0, "coverage")[1]) == 0


def test_roads_are_trimmed_until_they_cover_what_is_asked():
    build = tangle(layers=2)
    for share in (0.9, 1.05):
        asked = share * total(build, "coverage")
        assert total(trim(build, asked, count="coverage"), "coverage") == pytest.approx(
            asked, rel=2e-6
        )
    with pytest.raises(InputError, match="no width of the roads covers"):
        trim(build, 1e5, count="coverage")
    with pytest.raises(InputError, match='count: "weight" is not one of volume, coverage'):
        measure(build, window=5.0, count="weight")
