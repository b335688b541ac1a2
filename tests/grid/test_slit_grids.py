"""Elliptic C-grids: cut open from the outline to a hole, and smooth across the cut."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import evaluate, quick_jit
from shapely import Polygon, box

from fdjax.grid import bspline
from fdjax.grid.base import Sides, tangents
from fdjax.grid.elliptic import Elliptic
from fdjax.grid.solvers import Newton
from fdjax.part.contour import circle
from fdjax.part.curve import polyline_at, spline
from fdjax.part.slit import Slit

NODES = (9, 25)
OFF = Polygon(box(0, 0, 80, 80).exterior, [circle((46, 30), 11).exterior])


def sides(polygon, place=None):
    slit = Slit.of(polygon, "it", place, steps=NODES[1] - 1)
    return Sides(slit.bottom, slit.right, slit.top, slit.left), round(slit.tail * (NODES[1] - 1))


@partial(quick_jit, static_argnums=0)
def solved(tail, walls, controls=(0.0, 0.0)):
    phi, psi = controls
    grid = Elliptic(walls, phi=phi, psi=psi, nodes=NODES, solver=Newton(1e-13, tail=tail))
    return grid.map()


def controls(seed, size):
    """phi and psi at the nodes, one at the other's place across the cut but for the sign."""
    found = []
    for values in size * np.random.default_rng(seed).normal(size=(2, 6, 7)):
        field = bspline.folded(jnp.asarray(values), -1.0)
        xi, eta = jnp.linspace(0, 1, NODES[0])[:-1, None], jnp.linspace(0, 1, NODES[1])[None, 1:-1]
        found.append(bspline.field(field, xi, eta))
    return tuple(found)


def test_a_field_goes_on_across_the_cut_as_itself_turned():
    values = jnp.asarray(np.random.default_rng(0).normal(size=(6, 7)))
    run = jnp.linspace(0, 1, 9)[None]
    for sign in (1.0, -1.0):
        field = bspline.folded(values, sign)

        @quick_jit
        def at(xi, field=field):
            return jax.jvp(lambda xi: bspline.field(field, xi, run), (xi,), (jnp.ones_like(xi),))

        value, slope = at(jnp.zeros((1, 1)))
        np.testing.assert_allclose(value, sign * value[:, ::-1], atol=1e-14)
        np.testing.assert_allclose(slope, -sign * slope[:, ::-1], atol=1e-13)


def test_parabolas_around_a_slit_are_found_with_their_cut():
    """z = w^2 is conformal, and central differences are exact for it: no error but rounding.

    The hole is flat here, from z = 0 to where the cut begins; of the cut only its ends are given,
    and a wrong place for the rest, to start from.
    """
    wide, high, tail = 3.0, 2.0, 7
    run = np.linspace(0, 1, NODES[1])

    def exact(xi, eta):
        z = (wide * (1 - 2 * eta) + 1j * high * xi) ** 2
        return np.stack([z.real, z.imag], -1)

    xi = np.linspace(0, 1, NODES[0])
    left = exact(0.0, run)
    cut_off = [0, *range(tail, NODES[1] - tail), NODES[1] - 1]
    walls = Sides(
        spline(exact(xi, 0.0), xi),
        spline(exact(1.0, run), run),
        spline(exact(xi, 1.0), xi),
        polyline_at(run[cut_off], left[cut_off]),
    )
    grid, report = solved(tail, walls)
    assert report.converged
    nodes = evaluate(grid, jnp.asarray(xi)[:, None], jnp.asarray(run)[None])
    np.testing.assert_allclose(nodes, exact(xi[:, None], run), atol=1e-9)
    # Between the nodes the cut is a cubic spline, which a parabola is.
    fine = np.linspace(0, tail / (NODES[1] - 1), 40)
    np.testing.assert_allclose(evaluate(grid, jnp.zeros(40), fine), exact(0.0, fine), atol=1e-9)


@pytest.mark.parametrize("size", [0.0, 1.5])
def test_both_sides_of_the_cut_are_one_and_lines_go_straight_on(size):
    walls, tail = sides(OFF)
    grid, report = solved(tail, walls, controls(1, size))
    assert report.converged
    assert not report.folded
    eta = jnp.linspace(0, tail / (NODES[1] - 1), 40)
    one, other = (evaluate(grid, jnp.zeros(40), each) for each in (eta, 1 - eta))
    np.testing.assert_allclose(one, other, atol=1e-10)
    # It is none of the straight line that it began as.
    assert np.ptp(np.asarray(one)[:, 1]) > 0.2
    # Tangents turn round across it: at the nodes exactly, between them as far as the hole is.
    columns = jnp.arange(tail) / (NODES[1] - 1)
    _, here = tangents(grid, jnp.zeros(tail), columns)
    _, beyond = tangents(grid, jnp.zeros(tail), 1 - columns)
    np.testing.assert_allclose(here.xi, -beyond.xi, atol=1e-9)
    between = columns[:2] + 0.5 / (NODES[1] - 1)
    _, here = tangents(grid, jnp.zeros(2), between)
    _, beyond = tangents(grid, jnp.zeros(2), 1 - between)
    for a, b in zip(here, beyond, strict=True):
        np.testing.assert_allclose(a, -b, atol=0.05 * np.abs(a).max())


def test_gradients_of_a_c_grid_are_those_of_central_differences():
    weight = np.random.default_rng(1).normal(size=(9, 13, 2))
    lattice = jnp.linspace(0, 1, 9)[:, None], jnp.linspace(0, 1, 13)[None]
    walls, tail = sides(OFF)
    left = walls.left

    def plain(phi, psi, shift):
        """Of the hole and the tail moved, the cut's end on the outline as it is."""
        begin, end = jnp.asarray(left.coefficients[0]), jnp.asarray(left.coefficients[-1])
        first = jnp.array([1.0, 0.0, 0.0, 0.0])[:, None] * shift
        slope = jnp.array([0.0, 1.0, 0.0, 0.0])[:, None] * shift
        length = left.breaks[1]
        moved = [
            (begin + slope / length)[None],
            left.coefficients[1:-1] + first,
            (end + first - slope / length)[None],
        ]
        pieces: Any = jnp.concatenate(moved)
        side = type(left)(left.breaks, pieces, True)
        grid = Elliptic(
            walls._replace(left=side), phi=phi, psi=psi, nodes=NODES,
            solver=Newton(1e-13, tail=tail),
        ).map()[0]  # fmt: skip
        return (weight * grid(*lattice)).sum()

    at = (*controls(2, 0.5), jnp.zeros(2))
    ways = [(*controls(3, 1.0), jnp.zeros(2)), (0 * at[0], 0 * at[1], jnp.array([0.6, -0.8]))]
    value = quick_jit(plain)
    gradient = quick_jit(jax.grad(plain, argnums=(0, 1, 2)))(*at)
    pushed = quick_jit(lambda at, ways: jax.jvp(plain, at, ways)[1])
    for way, step in zip(ways, (1e-4, 1e-4), strict=True):
        ends = [
            value(*(each + sign * step * w for each, w in zip(at, way, strict=True)))
            for sign in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2 * step)
        reverse = sum(float((g * w).sum()) for g, w in zip(gradient, way, strict=True))
        assert slope == pytest.approx(reverse, rel=1e-6)
        assert float(pushed(at, tuple(way))) == pytest.approx(reverse, rel=1e-9)
