"""Soft windows: they share out every amount once, exactly, and smoothly."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.part.part import Part
from fdjax.road.deposit import Points, Raster
from fdjax.road.window import SoftWindows

PLATE = shapely.box(2, -1, 32, 21)
L_SHAPE = shapely.Polygon([(0, 0), (30, 0), (30, 12), (14, 12), (14, 26), (0, 26)])
RING = shapely.Point(0, 0).buffer(20).difference(shapely.Point(3, 2).buffer(6))
OVERLAP = 4
"""Windows that hold each place, unless there are more steps: two along x, two along y."""


def half(x, y):
    return 0.5 + 0 * x


def over(outline, solid, size, steps=2):
    """Windows of a plate one millimetre high, so that volumes are areas."""
    part = Part.plate(outline, layers=1, height=1.0)
    return SoftWindows.over(part, lambda x, y, z: solid(x, y), size, flat=True, steps=steps)


def summed(windows, xy, amounts):
    """Amounts at points of the plane in each window, (nx, ny)."""
    xp = jnp if isinstance(xy, jax.Array) else np
    xyz = xp.concatenate([xy, xp.full((len(xy), 1), 0.5)], 1)
    return windows.sums(Points(xyz, amounts))[..., 0]


def random_points(outline, count=400, seed=1):
    x0, y0, x1, y1 = outline.bounds
    return np.random.default_rng(seed).uniform((x0, y0), (x1, y1), (count, 2))


@settings(max_examples=40, deadline=None)
@given(
    size=st.floats(1.5, 40),
    width=st.floats(5, 50),
    height=st.floats(5, 50),
    u=st.floats(0, 1),
    v=st.floats(0, 1),
    steps=st.sampled_from([2, 4, 6]),
)
def test_every_place_counts_once_along_each_of_the_overlapping_windows(
    size, width, height, u, v, steps
):
    outline = shapely.box(-3, 4, width - 3, height + 4)
    windows = over(outline, half, size, steps)
    point = np.array([[-3 + u * width, 4 + v * height]])
    sums = summed(windows, point, np.ones(1))
    assert windows.times == steps**2
    assert sums.sum() == pytest.approx(steps**2, rel=1e-9)
    # Windows a whole size apart share it out among themselves.
    for i, j in np.ndindex(steps, steps):
        assert sums[i::steps, j::steps].sum() == pytest.approx(1, rel=1e-9)
    assert sums.min() >= 0


@pytest.mark.parametrize("steps", [2, 4])
@pytest.mark.parametrize("outline", [PLATE, L_SHAPE, RING])
def test_areas_add_up_to_the_outline(outline, steps):
    windows = over(outline, half, 5.0, steps)
    assert windows.room.sum() == pytest.approx(steps**2 * outline.area, rel=1e-9)
    assert windows.total == pytest.approx(0.5 * outline.area, rel=1e-9)
    assert np.allclose(windows.target[windows.room > 0], 0.5)
    assert not windows.target[windows.room == 0].any()


def test_a_window_inside_has_its_own_area_and_the_linear_target_of_its_middle():
    windows = over(PLATE, lambda x, y: 0.1 + 0.01 * x + 0.005 * y, 5.0)
    x0, y0, x1, y1 = PLATE.bounds
    nx, ny, _ = windows.room.shape
    x, y = x0 + 2.5 * np.arange(nx), y0 + 2.5 * np.arange(ny)
    # Softened edges reach a quarter of a window beyond their middles.
    reach = 2.5 + 1.25
    inside = np.ix_((x > x0 + reach) & (x < x1 - reach), (y > y0 + reach) & (y < y1 - reach))
    expected = (0.1 + 0.01 * x[:, None] + 0.005 * y)[inside]
    assert expected.size > 20
    np.testing.assert_allclose(windows.target[..., 0][inside], expected, rtol=2e-4)
    np.testing.assert_allclose(windows.room[..., 0][inside], 25, rtol=2e-3)
    assert windows.total == pytest.approx(30 * 22 * (0.1 + 0.01 * 17 + 0.005 * 10), rel=1e-12)


def test_with_more_steps_windows_are_nearer_to_those_with_sharp_edges():
    points = random_points(PLATE)
    amounts = np.ones(len(points))
    strayed = []
    for steps in (2, 4, 8):
        windows = over(PLATE, half, 5.0, steps)
        nx, ny, _ = windows.room.shape
        # Middles of the windows: the first holds one step of the part.
        x, y = ((np.arange(n) + 1) * 5.0 / steps - 2.5 for n in (nx, ny))
        sharp = (
            (np.abs(points[:, 0] - 2 - x[:, None]) < 2.5)[:, None]
            & (np.abs(points[:, 1] + 1 - y[:, None]) < 2.5)
        ).sum(-1)
        strayed.append(np.abs(summed(windows, points, amounts) - sharp).mean())
    # Of random points the share that lies under an edge falls as a root of its width.
    assert strayed[0] > 1.25 * strayed[1] > 1.25**2 * strayed[2] > 0


@pytest.mark.parametrize("at", [0.0, 0.1, 0.15])
def test_a_step_is_asked_for_where_it_is_and_not_at_the_nearest_cell(at):
    # Cells are 0.3125 mm wide, or, across one more or less of them, one has its middle at 0.
    for wide in (10.0, 10.3125):
        outline = shapely.box(-wide / 2, 0, wide / 2, 10)
        windows = over(outline, lambda x, y: np.where(x < at, 0.2, 0.4), 5.0)
        exact = 10 * (0.2 * (wide / 2 + at) + 0.4 * (wide / 2 - at))
        assert windows.total == pytest.approx(exact, rel=5e-4)


def test_a_small_outline_has_windows_all_the_same():
    windows = over(shapely.box(0, 0, 1, 2), half, 5.0)
    assert windows.room.shape == (2, 2, 1)
    assert windows.room.sum() == pytest.approx(OVERLAP * 2)


@pytest.mark.parametrize("steps", [2, 4])
@pytest.mark.parametrize("outline", [PLATE, RING])
def test_sums_of_numpy_and_jax_agree(outline, steps):
    windows = over(outline, half, 6.0, steps)
    points = random_points(outline)
    amounts = np.random.default_rng(2).uniform(0, 3, len(points))
    exact = summed(windows, points, amounts)
    np.testing.assert_allclose(
        jax.jit(lambda xy, amounts: summed(windows, xy, amounts))(
            jnp.asarray(points), jnp.asarray(amounts)
        ),
        exact,
        atol=1e-12,
    )
    assert exact.sum() == pytest.approx(steps**2 * amounts.sum())


TALL = SoftWindows.over(
    Part.stack([PLATE, L_SHAPE] * 20, 0.25), lambda x, y, z: 0.3 + 0 * x, 4.0, flat=False
)


@pytest.mark.parametrize(
    "windows",
    [over(PLATE, half, 5.0), over(PLATE, half, 5.0, 4), TALL],
    ids=["flat", "steps", "tall"],
)
def test_sums_differentiate_as_central_differences_say(windows):
    assert (windows.room.shape[2] > 1) == (windows is TALL)
    rng = np.random.default_rng(3)
    points = jnp.asarray(rng.uniform((2, -1, 0), (32, 21, 10), (60, 3)))
    amounts = jnp.asarray(rng.uniform(0, 1, 60))
    weight = jnp.asarray(rng.normal(size=windows.room.shape))

    @jax.jit
    def value(points, amounts):
        return (weight * windows.sums(Points(points, amounts))).sum()

    gradient = jax.jit(jax.grad(value, argnums=(0, 1)))(points, amounts)
    for axis in range(3):
        way = rng.normal(size=points.shape) * (np.arange(3) == axis), rng.normal(size=60)
        step = 1e-5
        ahead = value(points + step * way[0], amounts + step * way[1])
        back = value(points - step * way[0], amounts - step * way[1])
        slope = sum(float((g * w).sum()) for g, w in zip(gradient, way, strict=True))
        assert slope == pytest.approx(float(ahead - back) / (2 * step), rel=1e-6)


def test_a_point_that_slides_over_an_edge_makes_no_jump():
    windows = over(PLATE, half, 5.0)
    x = np.linspace(2, 32, 3001)
    share = np.stack([summed(windows, np.array([[at, 10.0]]), np.ones(1)).ravel() for at in x])
    # At most the steepest rise of the smooth step, 1.5 over half a window, in each direction.
    assert np.abs(np.diff(share, axis=0)).max() <= 1.01 * 1.5 / 2.5 * (x[1] - x[0])


def test_volumes_of_a_raster_are_summed_as_those_of_its_points_also_along_z():
    part = Part.stack([PLATE, L_SHAPE, RING] * 20, 0.2)
    windows = SoftWindows.over(part, lambda x, y, z: 0.3 + 0.01 * z + 0 * x, 5.0, flat=False)
    assert windows.room.shape[2] == 6
    # Each place lies in two windows along each axis.
    assert windows.room.sum() == pytest.approx(8 * part.volume, rel=1e-9)
    rng = np.random.default_rng(5)
    axes = [np.sort(rng.uniform(a, b, n)) for a, b, n in ((-20, 32, 9), (-20, 26, 7), (0, 12, 11))]
    raster = Raster(*axes, rng.uniform(0, 1, (9, 7, 11)))
    np.testing.assert_allclose(
        windows.sums(raster), windows.sums(raster.points), rtol=1e-12, atol=1e-12
    )
    # A target that rises is met by windows whose mean height it is.
    seen = windows.target[windows.room > 0.9 * windows.full]
    assert (np.diff(np.unique(seen.round(6))) > 0).all()
    assert windows.total == pytest.approx(
        sum(s.region.area * 0.2 * (0.3 + 0.01 * (s.z - 0.1)) for s in part.slabs), rel=1e-9
    )
