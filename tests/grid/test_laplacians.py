"""Laplacians of xi and eta from a lattice of nodes."""

import numpy as np
import pytest

from fdjax.grid.base import Sides
from fdjax.grid.elliptic import Elliptic
from fdjax.grid.laplacians import laplacians
from fdjax.grid.solvers import Newton
from fdjax.part.patch import cosine_top


def square(ni, nj):
    return np.meshgrid(np.linspace(0, 1, ni), np.linspace(0, 1, nj), indexing="ij")


def test_a_conformal_map_has_none():
    xi, eta = square(201, 201)
    r = np.stack([np.exp(xi) * np.cos(eta), np.exp(xi) * np.sin(eta)], -1)
    p, q = laplacians(r)
    assert max(np.abs(p).max(), np.abs(q).max()) < 1e-4


def test_they_are_of_second_order_in_the_distance_of_nodes():
    # xi = ln(r)^2 on an annulus: lap(xi) = 2 / r^2.
    errors = []
    for nodes in (51, 101):
        xi, eta = square(nodes, nodes)
        radius = np.exp(np.sqrt(1 + xi))
        p, q = laplacians(np.stack([radius * np.cos(eta), radius * np.sin(eta)], -1))
        errors.append(np.abs(p - 2 / radius[1:-1, 1:-1] ** 2).max())
        assert np.abs(q).max() < 1e-9
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)


def test_an_elliptic_grid_has_those_it_was_solved_for():
    p, q = 2e-4, -1e-4
    nodes, report = Elliptic(
        Sides.of(cosine_top()), p=p, q=q, nodes=(61, 41), solver=Newton()
    ).solve()
    assert report.converged
    got = laplacians(np.asarray(nodes))
    np.testing.assert_allclose(got[0], p, rtol=1e-6)
    np.testing.assert_allclose(got[1], q, rtol=1e-6)


def test_where_a_grid_is_flat_they_are_not_finite():
    xi, eta = square(5, 5)
    p, _ = laplacians(np.stack([xi, 0 * eta], -1))
    assert np.isnan(p).all()
