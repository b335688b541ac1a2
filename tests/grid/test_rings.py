"""Rings: polar maps, elliptic O-grids, and maps whose lines are spaced anew."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import evaluate, quick_jit
from shapely import Polygon, box

from fdjax.errors import InputError
from fdjax.grid import bspline
from fdjax.grid.algebraic import Cartesian, Transfinite
from fdjax.grid.base import Sides, tangents
from fdjax.grid.elliptic import Elliptic
from fdjax.grid.polar import Polar
from fdjax.grid.respaced import Respaced, SpacingField
from fdjax.grid.solvers import Newton
from fdjax.grid.spacing import DensitySpacing
from fdjax.part.annulus import Annulus, Circle, between_circles
from fdjax.part.contour import circle

EXACT = Newton(tolerance=1e-13, closed=True)
SQUARE = Annulus.of(Polygon(box(0, 0, 80, 80).exterior, [circle((30, 45), 12).exterior]), "it")
LATTICE = jnp.linspace(0, 1, 9)[:, None], jnp.linspace(0, 1, 13)[None]


def sides(annulus, start=0.0):
    """The sides of an annulus, cut where eta is `start` instead."""
    hole, outline = (
        turned(curve, start) if start else curve for curve in (annulus.hole, annulus.outline)
    )
    cut = jnp.stack([hole.start, outline.start])
    straight = type(annulus.cut)(
        np.array([0.0, 1.0]), np.stack([[cut[0], cut[1] - cut[0], 0 * cut[0], 0 * cut[0]]])
    )
    return Sides(straight, outline, straight, hole)


def turned(curve, start):
    """The closed polyline begun at another of its breaks."""
    k = int(np.argmin(np.abs(curve.breaks - start)))
    breaks = np.concatenate([curve.breaks[k:] - curve.breaks[k], curve.breaks[1 : k + 1]])
    breaks[len(curve.breaks) - k :] += 1 - curve.breaks[k]
    return type(curve)(breaks, np.roll(curve.coefficients, -k, axis=0), corners=True)


def circles(inner=15.0, outer=40.0):
    middle = np.array([3.0, -2.0])
    return between_circles(Circle(middle, inner), Circle(middle, outer))


def plain_o_grid(phi, psi, p, q, walls):
    return Elliptic(walls, phi=phi, psi=psi, p=p, q=q, nodes=(13, 16), solver=EXACT).map()


o_grid = quick_jit(plain_o_grid)


def test_polar_lines_are_circles_and_rays():
    grid = Polar(jnp.array([3.0, -2.0]), 15.0, 40.0)
    xy = np.asarray(evaluate(grid, *LATTICE)) - [3.0, -2.0]
    radius, angle = np.hypot(*xy.T).T, np.unwrap(np.arctan2(xy[..., 1], xy[..., 0]))
    np.testing.assert_allclose(radius, np.broadcast_to(15 + 25 * LATTICE[0], radius.shape))
    np.testing.assert_allclose(angle, np.broadcast_to(2 * np.pi * LATTICE[1], angle.shape))
    _, along = tangents(grid, *LATTICE)
    np.testing.assert_allclose(along.jacobian, 2 * np.pi * 25 * radius)


@pytest.mark.parametrize("around", [16, 32, 64])
def test_the_elliptic_annulus_is_that_of_the_logarithm(around):
    """lap(xi) = lap(eta) = 0 between circles: r = inner (outer / inner)^xi; of second order."""
    walls = sides(circles())

    @quick_jit
    def solved(walls):
        return Elliptic(walls, nodes=(around // 2 + 1, around), solver=EXACT).map()

    grid, report = solved(walls)
    assert report.converged
    assert not report.folded
    xi = jnp.linspace(0, 1, 11)
    # At nodes around: between them a wall of 256 sides is kept, and not a circle.
    xy = np.asarray(evaluate(grid, xi[:, None], jnp.arange(16)[None] / 16)) - [3.0, -2.0]
    exact = 15 * (40 / 15) ** np.asarray(xi)
    error = np.abs(np.hypot(*xy.T) - exact).max()
    assert error < 1.05 * 0.143 * (16 / around) ** 2


def test_the_cut_leaves_no_trace():
    """The same grid wherever it is cut: nodes, tangents across the cut, and the map between."""
    shift = 0.25
    walls, other = sides(circles()), sides(circles(), start=shift)
    controls = 0.4 * np.cos(2 * np.pi * np.arange(16) / 16) + np.zeros((11, 1))
    grid, _ = o_grid(controls, 0.5 * controls, 0.0, 0.0, walls)
    rolled = np.roll(controls, -4, axis=1)
    moved, report = o_grid(rolled, 0.5 * rolled, 0.0, 0.0, other)
    assert report.converged
    xi, eta = LATTICE
    np.testing.assert_allclose(
        evaluate(moved, xi, eta), evaluate(grid, xi, (eta + shift) % 1.0), atol=1e-9
    )
    _, along = tangents(grid, xi, jnp.array([[0.0, 1.0]]))
    # The walls themselves have corners, one of them at the cut.
    for each in along:
        np.testing.assert_allclose(each[2:-2, 0], each[2:-2, 1], atol=1e-8)


def test_gradients_of_an_o_grid_are_those_of_central_differences():
    weight = np.random.default_rng(1).normal(size=(9, 13, 2))
    places = np.random.default_rng(2)
    phi, psi = places.normal(size=(2, 11, 16))
    p, q = 1e-4 * places.normal(size=(2, 11, 16))
    hole = SQUARE.hole.coefficients

    walls = sides(SQUARE)
    cut_still = walls.bottom

    def plain(phi, psi, p, q, shift):
        first = jnp.array([[1.0], [0.0], [0.0], [0.0]])
        moved = type(walls.left)(walls.left.breaks, hole + shift * first, True)
        ends = shift * jnp.array([[1.0], [-1.0], [0.0], [0.0]])
        cut = type(cut_still)(cut_still.breaks, cut_still.coefficients + ends, True)
        grid, _ = plain_o_grid(phi, psi, p, q, Sides(cut, walls.right, cut, moved))
        return (weight * grid(*LATTICE)).sum()

    at = (phi, psi, p, q, jnp.zeros(2))
    value = quick_jit(plain)
    gradient = quick_jit(jax.grad(plain, argnums=tuple(range(5))))(*at)
    pushed = quick_jit(lambda at, ways: jax.jvp(plain, at, ways)[1])
    random = np.random.default_rng(3)
    for k, (size, step) in enumerate([(1, 1e-4), (1, 1e-4), (1e-4, 1e-8), (1e-4, 1e-8), (1, 1e-4)]):
        way = random.normal(size=np.shape(at[k]))
        way = way / np.linalg.norm(way)
        ends = [
            value(*(each + sign * step * way if j == k else each for j, each in enumerate(at)))
            for sign in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2 * step)
        norm = np.linalg.norm(gradient[k])
        assert abs(slope - (gradient[k] * way).sum()) < 1e-6 * norm, (k, size)
        ways = tuple(way if j == k else jnp.zeros_like(each) for j, each in enumerate(at))
        assert abs(pushed(at, ways) - (gradient[k] * way).sum()) < 1e-9 * norm


def test_a_ring_needs_one_hole():
    for holes in ([], [circle((20, 20), 5).exterior, circle((60, 60), 5).exterior]):
        with pytest.raises(InputError, match=f"has {len(holes)} holes; it needs"):
            Annulus.of(Polygon(box(0, 0, 80, 80).exterior, holes), "it")


def test_a_ring_that_rays_meet_twice_is_parted_by_length():
    bent = Polygon([(0, 0), (60, 0), (60, 60), (40, 60), (40, 20), (0, 20)])
    ring = Annulus.of(Polygon(bent.exterior, [circle((8, 10), 4).exterior]), "it")
    halves = [curve(np.array([0.0, 0.5, 1.0])) for curve in (ring.hole, ring.outline)]
    for half in halves:
        np.testing.assert_allclose(half[0], half[2], atol=1e-9)
    gap = np.hypot(*(ring.hole.start - ring.outline.start))
    assert gap == pytest.approx(bent.exterior.distance(circle((8, 10), 4)), rel=1e-6)
    assert Polygon(ring.outline.polyline()).area == pytest.approx(bent.area)


def test_rays_of_equal_eta_point_the_same_way():
    middle = np.array([30.0, 45.0])
    for eta in (0.0, 0.125, 0.4, 0.9):
        for curve in (SQUARE.hole, SQUARE.outline):
            x, y = curve(np.array(eta)) - middle
            off = np.arctan2(y, x) - 2 * np.pi * eta
            assert np.cos(off) == pytest.approx(1, abs=2e-4)


# --- lines spaced anew ---


def rows(count, knots, seed=0, closed=False):
    values = jnp.asarray(np.random.default_rng(seed).normal(size=(count, knots)))
    values = bspline.closed(values, 1) if closed else values
    return jax.vmap(DensitySpacing.of)(values)


def test_a_spacing_field_rises_from_0_to_1_everywhere():
    field = SpacingField(rows(5, 7))
    s = np.asarray(evaluate(field, jnp.linspace(0, 1, 101)[:, None], jnp.linspace(0, 1, 21)[None]))
    assert s.shape == (101, 21)
    assert (np.diff(s, axis=0) > 0).all()
    np.testing.assert_allclose(s[[0, -1]], [[0.0] * 21, [1.0] * 21], atol=1e-12)
    assert np.ptp(s, axis=1).max() > 0.05
    # A lattice, lines of points and the transposed lattice say the same.
    t, a = jnp.linspace(0, 1, 5)[:, None], jnp.linspace(0, 1, 4)[None]
    lattice = evaluate(field, t, a)
    np.testing.assert_allclose(lattice, evaluate(field, *jnp.broadcast_arrays(t, a)), atol=1e-13)
    np.testing.assert_allclose(lattice.T, evaluate(field, t.T, a.T), atol=1e-13)


def test_a_spacing_around_a_ring_has_neither_beginning_nor_end():
    field = SpacingField(rows(3, 6, closed=True), closed_along=True, closed_across=True)
    t, a = jnp.array([[0.0], [1.0]]), jnp.linspace(0, 1, 5)[None]
    s = np.asarray(evaluate(field, t, a))
    np.testing.assert_allclose(s[1] - s[0], 1.0)
    np.testing.assert_allclose(s[:, 0], s[:, -1])
    slope = quick_jit(lambda t: jax.jvp(lambda t: field(t, a), (t,), (jnp.ones_like(t),))[1])(t)
    np.testing.assert_allclose(slope[0], slope[1], rtol=2e-3)
    turn = evaluate(field, jnp.arange(64)[:, None] / 64, a) - jnp.arange(64)[:, None] / 64
    np.testing.assert_allclose(turn.mean(0), 0.0, atol=1e-13)


def test_a_map_spaced_anew_keeps_its_walls_and_says_its_own_tangents():
    grid = Respaced(
        Cartesian(jnp.zeros(2), jnp.array([4.0, 3.0])),
        SpacingField(rows(4, 5)),
        SpacingField(rows(4, 5, seed=1)),
    )
    ends, run = jnp.array([0.0, 1.0]), jnp.linspace(0, 1, 7)
    xy = evaluate(grid, ends[:, None], run[None])
    np.testing.assert_allclose(xy[..., 0], [[0.0] * 7, [4.0] * 7], atol=1e-12)
    xi, eta = jnp.array([0.3, 0.71]), jnp.array([0.44, 0.1])
    _, along = tangents(grid, xi, eta)
    step = 1e-6
    for tangent, (i, j) in zip(along, ((1, 0), (0, 1)), strict=True):
        ahead, behind = (evaluate(grid, xi + s * i, eta + s * j) for s in (step, -step))
        np.testing.assert_allclose(tangent, (ahead - behind) / (2 * step), rtol=1e-7, atol=1e-8)


def test_a_ring_between_its_walls_is_interpolated_straight():
    grid = Respaced(Transfinite(sides(SQUARE)), closed=True)
    xi, eta = LATTICE
    hole, outline = (evaluate(curve, eta[0, :-1]) for curve in (SQUARE.hole, SQUARE.outline))
    xy = evaluate(grid, xi, eta[:, :-1])
    np.testing.assert_allclose(xy, (1 - xi[..., None]) * hole + xi[..., None] * outline, atol=1e-12)
