"""The grid equations: against a map whose Laplacians are known, and their linearisation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import SHAPE, controls, dense, linearised, places, quick_jit, random_case

from fdjax.grid import winslow
from fdjax.grid.operators import corner_jacobians
from fdjax.grid.transfer import planes
from fdjax.grid.winslow import ControlFunctions

residual = quick_jit(winslow.residual)


def quadratic(u):
    """A curved, skewed map that central differences treat exactly."""
    xi, eta = u
    return jnp.stack(
        [3 * xi + 0.8 * eta + 0.2 * xi**2 - 0.3 * xi * eta, 2 * eta + 0.5 * xi - 0.4 * eta**2]
    )


@quick_jit
@jax.vmap
def laplacians(u):
    """lap(xi), lap(eta) of the inverse of `quadratic`, and its A, C and J, at (xi, eta)."""

    def gradients(u):
        return jnp.linalg.inv(jax.jacfwd(quadratic)(u))

    # d/dx_a of dxi_k/dx_a, by the chain rule through u.
    laplacian = jnp.einsum("kam,ma->k", jax.jacfwd(gradients)(u), gradients(u))
    tangent = jax.jacfwd(quadratic)(u)
    a, c = (tangent[:, 1] ** 2).sum(), (tangent[:, 0] ** 2).sum()
    return laplacian, a, c, jnp.linalg.det(tangent)


@pytest.mark.parametrize("space", ["physical", "computational"])
def test_a_map_solves_the_equations_of_its_own_laplacians(space):
    ni, nj = 6, 5
    xi, eta = np.broadcast_arrays(*places(ni, nj))
    lattice = np.stack(quadratic((xi, eta)), -1)
    inner = np.stack([xi, eta], -1)[1:-1, 1:-1].reshape(-1, 2)
    laplacian, a, c, jacobian = map(np.asarray, laplacians(inner))
    p, q = laplacian.T
    if space == "physical":
        fields = {"p": p * (ni - 1), "q": q * (nj - 1)}
    else:
        # phi = P J^2 / A and psi = Q J^2 / C on the unit square.
        phi, psi = p * jacobian**2 / a, q * jacobian**2 / c
        fields = {"phi": phi / (ni - 1), "psi": psi / (nj - 1)}
    inside = (ni - 2, nj - 2)
    fields = {name: values.reshape(inside) for name, values in fields.items()}
    found = residual(lattice, controls((ni, nj), **fields))
    without = residual(lattice, controls((ni, nj)))
    assert np.abs(found).max() < 1e-12 * np.abs(without).max()


@quick_jit
def derivative(lattice, functions):
    def of_interior(interior):
        moved = jnp.asarray(lattice).at[1:-1, 1:-1].set(interior)
        return winslow.residual(moved, functions)

    return jax.jacfwd(of_interior)(lattice[1:-1, 1:-1])


linearise = quick_jit(linearised)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_linearisation_is_the_derivative_of_the_residual(seed):
    lattice, functions = random_case((6, 5), seed)

    expected = np.asarray(derivative(lattice, functions)).reshape(24, 24)
    got = dense(linearise(lattice, functions))
    np.testing.assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


def test_the_equations_do_not_mind_exchanging_xi_and_eta():
    lattice, f = random_case(SHAPE, 3)
    turned = ControlFunctions(f.psi.T, f.phi.T, f.q.T, f.p.T)
    exchanged = residual(lattice.swapaxes(0, 1), turned)
    np.testing.assert_allclose(
        residual(lattice, f), np.asarray(exchanged).swapaxes(0, 1), atol=1e-11
    )


def test_one_relaxation_of_a_node_is_equation_6():
    lattice, functions = random_case((3, 3), 4)
    functions = functions._replace(p=np.zeros((1, 1)), q=np.zeros((1, 1)))
    phi, psi = functions.phi.item(), functions.psi.item()
    (sw, w, nw), (s, here, n), (se, e, ne) = lattice
    a = ((n - s) ** 2).sum() / 4
    c = ((e - w) ** 2).sum() / 4
    b = -((e - w) * (n - s)).sum() / 4
    along_xi = a * (w + e + phi / 2 * (e - w))
    along_eta = c * (s + n + psi / 2 * (n - s))
    # The two products of B added: the scanned equation's minus is a fault of the scan.
    relaxed = (along_xi + b / 2 * (sw - se - nw + ne) + along_eta) / (2 * (a + c))
    got = here + quick_jit(winslow.correction)(lattice, functions)[0, 0]
    np.testing.assert_allclose(got, relaxed, atol=1e-13)


def test_side_controls_make_a_stretched_product_grid_a_solution():
    # Curved spacings along x and y of a rectangle, opposite sides alike.
    x, y = places(9, 7)
    x, y = 3 * (x + 0.4 * x**2 - 0.2 * x**3), 2 * (y - 0.3 * y**2)
    lattice = np.stack(np.broadcast_arrays(x, y), -1)
    phi, psi = quick_jit(winslow.boundary_controls)(lattice)
    found = residual(lattice, controls((9, 7), phi=phi, psi=psi))
    np.testing.assert_allclose(found, 0, atol=1e-14)
    assert np.abs(residual(lattice, controls((9, 7)))).max() > 1e-4


def test_corner_jacobians_are_twice_the_corner_triangles():
    lattice = np.stack(np.broadcast_arrays(*(4 * t for t in places(5, 5))), -1)
    np.testing.assert_allclose(corner_jacobians(planes(lattice)), 1)
    # A node moved across its neighbours' diagonal makes one corner of one cell concave.
    lattice[2, 2] = 1.4, 1.4
    assert (np.asarray(corner_jacobians(planes(lattice))) <= 0).sum() == 1
