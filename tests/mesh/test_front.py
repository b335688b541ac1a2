"""Triangulations by an advancing front: the region once, with sides as asked."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.errors import InputError
from fdjax.mesh.front import ORDERS, Rules, advanced
from fdjax.mesh.size import SizeField

PLATE = shapely.box(0, 0, 60, 40).difference(shapely.box(22, 14, 36, 26))
DISC = shapely.Point(20, 20).buffer(20, quad_segs=24).difference(shapely.Point(14, 24).buffer(4))
TWO = shapely.MultiPolygon([shapely.box(0, 0, 20, 20), shapely.box(25, 5, 50, 15)])
L = shapely.Polygon([(0, 0), (40, 0), (40, 12), (12, 12), (12, 40), (0, 40)])


def made(region, size, rules=None, phase=0.3):
    field = SizeField.over(region, size)
    return field, advanced(region, field, rules, phase)


def even(x, y):
    return 2 + 0 * x


def graded(x, y):
    return 1.2 + 2 * x / 60


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("region", [PLATE, DISC, TWO, L])
@pytest.mark.parametrize("size", [even, graded])
def test_a_region_is_filled_once_with_the_sides_that_are_asked(region, size, order):
    field, mesh = made(region, size, Rules(order))
    faces = shapely.polygons(mesh.xy[mesh.triangles])
    assert shapely.coverage_is_valid(faces)
    # Bent walls are met by chords.
    straight = region is not DISC
    assert shapely.area(faces).sum() == pytest.approx(region.area, rel=1e-9 if straight else 5e-3)
    rim = shapely.linestrings(mesh.xy[mesh.edges[~mesh.inner]])
    assert shapely.area(shapely.union_all(faces)) == pytest.approx(shapely.area(faces).sum())
    if straight:
        assert shapely.length(rim).sum() == pytest.approx(region.length)
    assert len(mesh.triangles) == pytest.approx(2 * field.count(region), rel=0.2)
    ends = mesh.xy[mesh.edges]
    asked = np.hypot(*(ends[:, 1] - ends[:, 0]).T) / field.at(ends.mean(1))
    assert asked.mean() == pytest.approx(1, abs=0.06)
    assert np.percentile(asked, [1, 99]) == pytest.approx([0.75, 1.35], abs=0.15)
    angles = mesh.angles.min(1)
    assert angles.min() > 20
    assert np.median(angles) > 48


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), order=st.sampled_from(ORDERS))
def test_any_outline_is_closed(seed, order):
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 12))
    turn = turn[np.append(np.diff(turn), turn[0] + 2 * np.pi - turn[-1]) > 0.05]
    reach = rng.uniform(8, 30, len(turn))
    star = shapely.Polygon(np.stack([reach * np.cos(turn), reach * np.sin(turn)], 1))
    region = star.buffer(0.5).difference(shapely.Point(0, 0).buffer(1.5, quad_segs=4))
    region = max(shapely.get_parts(region), key=shapely.area)
    _, mesh = made(region, lambda x, y: 1.0 + 0.3 * np.sin(x), Rules(order))
    faces = shapely.polygons(mesh.xy[mesh.triangles])
    assert shapely.coverage_is_valid(faces)
    assert shapely.area(faces).min() > 0
    assert shapely.area(faces).sum() == pytest.approx(region.area, rel=0.02)


def test_the_rules_shape_the_mesh():
    _, plain = made(PLATE, even)
    _, low = made(PLATE, even, Rules(height=0.8))
    _, high = made(PLATE, even, Rules(height=1.2))
    assert len(high.triangles) < len(plain.triangles) < len(low.triangles)
    _, rough = made(PLATE, even, Rules(sweeps=0))
    assert rough.angles.min() < plain.angles.min()
    _, other = made(PLATE, even, phase=0.8)
    assert len(other.xy) != len(plain.xy) or np.abs(other.xy - plain.xy).max() > 0.1


def test_rules_out_of_range_are_refused():
    with pytest.raises(InputError, match='order: "random" is not one of shortest, oldest'):
        Rules(order="random")
    with pytest.raises(InputError, match=r"height: 2; it must be 0\.5 to 1\.5"):
        Rules(height=2.0)
