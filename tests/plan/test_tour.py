"""Space-filling curves as roads: one in each piece of a region, within it, and crossing nothing."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from isolines import random_region
from outlines import OUTLINES

from fdjax.errors import InputError
from fdjax.pattern.curve_order import NAMES, rank
from fdjax.plan.check import check
from fdjax.plan.toolpath import Build, Layer
from fdjax.plan.tour import lay_curve
from fdjax.road.stroke import Curve


def curve_of(name, bounds, step=1.3, turn=0.3, **changes):
    """A curve on a turned square lattice that covers a box."""
    x0, y0, x1, y1 = bounds
    reach = np.hypot(x1 - x0, y1 - y0) / 2 + 2 * step
    count = int(np.ceil(reach / step)) * 2
    at = (np.arange(count) - count / 2) * step
    u, v = np.meshgrid(at, at, indexing="ij")
    x = (x0 + x1) / 2 + np.cos(turn) * u - np.sin(turn) * v
    y = (y0 + y1) / 2 + np.sin(turn) * u + np.cos(turn) * v
    half = count // 2
    values = {"width": np.full((count, count), 0.4), "family": "curve"} | changes
    return Curve(np.stack([x, y], -1), rank(name, (half, half)), **values)


def split(curve, name, masks):
    """A curve on a straight lattice whose squares are split where masks say, depth by depth."""
    if not masks:
        return curve
    mask, *more = masks
    xy = curve.xy
    first, u, v = (xy[i, j] for i, j in ((0, 0), (1, 0), (0, 1)))
    k, m = np.meshgrid(*(np.arange(2 * n) / 2 - 0.25 for n in xy.shape[:2]), indexing="ij")
    finer = first + k[..., None] * (u - first) + m[..., None] * (v - first)
    whole = np.repeat(np.repeat(mask, 2, 0), 2, 1)
    narrow = np.full(finer.shape[:2], 0.4)
    below = split(Curve(finer, rank(name, whole.shape), narrow, "curve"), name, more)
    fine = np.where(np.repeat(np.repeat(whole, 2, 0), 2, 1)[..., None], below.xy, np.nan)
    below = replace(below, xy=fine)
    return replace(curve, xy=np.where(whole[..., None], np.nan, xy), finer=below)


def errors(roads, region):
    build = Build((Layer(0.2, 0.2, tuple(roads), region),), origin=(100.0, 100.0))
    return [each for each in check(build) if each.severity == "error"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(16, 16), (27, 27)])
def test_curves_go_through_each_square_once(name, shape):
    order = rank(name, shape)
    assert len(np.unique(order)) == order.size
    at = np.stack(np.unravel_index(np.argsort(order.ravel()), shape), 1)
    steps = np.diff(at, axis=0)
    if name == "gosper":
        # A window of the curve: some steps are ways round outside. Else to one of six neighbours.
        near = (np.abs(steps).max(1) == 1) & (np.abs(steps.sum(1)) <= 1)
        assert near.mean() > 0.9
    elif shape[0] == (27 if name == "peano" else 16):
        # Sierpinski's goes from square to square across corners, too.
        assert set((np.abs(steps).max if name == "sierpinski" else np.abs(steps).sum)(1)) == {1}
        closes = np.abs(at[-1] - at[0]).sum() == 1
        assert closes == (name in ("moore", "sierpinski"))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("outline", OUTLINES)
def test_one_road_fills_every_outline(name, outline):
    region = OUTLINES[outline]()
    curve = curve_of(name, region.bounds)
    laid = lay_curve(curve, region, tolerance=2e-3, least_road=1.0)
    assert errors(laid.roads, region) == []
    (road,) = laid.roads
    assert road.closed
    # A node for each step squared, each with a step of road.
    free = region.buffer(-0.2, join_style="mitre")
    assert road.length == pytest.approx(free.area / 1.3, rel=0.05)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("outline", ["square", "star", "three holes"])
def test_one_road_goes_through_squares_of_three_sizes(name, outline):
    region = OUTLINES[outline]()
    curve = curve_of(name, region.bounds, step=2.6)
    middle = curve.xy.reshape(len(curve.rank), 2, -1, 2, 2).mean((1, 3))
    masks = [np.hypot(*(middle - [38, 44]).T).T < 27, None]
    finer = split(curve, name, masks[:1]).finer.xy
    middle = finer.reshape(2 * len(curve.rank), 2, -1, 2, 2).mean((1, 3))
    masks[1] = np.hypot(*(middle - [38, 44]).T).T < 14
    curve = split(curve, name, masks)
    laid = lay_curve(curve, region, tolerance=2e-3, least_road=1.0)
    assert errors(laid.roads, region) == []
    (road,) = laid.roads
    assert road.closed
    # As dense as each depth's steps are short, at a place of each.
    for place, step in (((38, 44), 0.65), ((38, 24), 1.3), ((20, 6), 2.6)):
        window = shapely.Point(place).buffer(4.5) & region.buffer(-0.2)
        length = shapely.LinearRing(road.xy).intersection(window).length
        assert length == pytest.approx(window.area / step, rel=0.3)


@pytest.mark.parametrize("seed", range(10))
def test_squares_split_anyhow_are_still_one_road(seed):
    rng = np.random.default_rng(seed)
    region = shapely.Point(15, 15).buffer(15)
    curve = curve_of("hilbert", region.bounds, step=rng.uniform(1.2, 2), turn=rng.uniform(0, 6))
    curve = split(curve, "hilbert", [rng.random(curve.rank.shape) < rng.random()])
    laid = lay_curve(curve, region, tolerance=2e-3, least_road=20.0)
    assert errors(laid.roads, region) == []
    assert len(laid.roads) == 1
    assert sum(road.length for road in laid.left_out) < 0.02 * laid.roads[0].length


@pytest.mark.parametrize("seed", range(20))
def test_random_regions(seed):
    rng = np.random.default_rng(seed)
    region = random_region(rng, 30)
    curve = curve_of("hilbert", region.bounds, step=rng.uniform(0.5, 2), turn=rng.uniform(0, 6))
    assert errors(lay_curve(curve, region, tolerance=2e-3).roads, region) == []


def test_arrays_that_do_not_fit_are_refused():
    curve = curve_of("hilbert", (0, 0, 9, 9))
    square = shapely.box(0, 0, 9, 9)
    with pytest.raises(InputError, match="need nodes and widths of shape"):
        lay_curve(Curve(curve.xy[1:], curve.rank, curve.width, "curve"), square)
    with pytest.raises(InputError, match="must be positive"):
        lay_curve(Curve(curve.xy, curve.rank, 0 * curve.width, "curve"), square)
    with pytest.raises(InputError, match="what is finer than"):
        lay_curve(replace(curve, finer=curve), square)
