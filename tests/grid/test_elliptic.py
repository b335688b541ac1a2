"""Elliptic grids of known maps, and domains that are hard for them."""

from dataclasses import dataclass, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import (
    SHAPE,
    bumped,
    chevron,
    circle,
    controls,
    places,
    quick_jit,
    solved,
    stretched,
    transfinite,
)

from fdjax.errors import InputError
from fdjax.grid import elliptic, winslow
from fdjax.grid.algebraic import Spacings
from fdjax.grid.base import Sides
from fdjax.grid.elliptic import Elliptic
from fdjax.grid.solvers import AbstractSolver, Newton
from fdjax.grid.winslow import ControlFunctions
from fdjax.part.contour import contour
from fdjax.part.curve import polyline
from fdjax.part.patch import cosine_top, from_curves, from_polygon, rectangle

EXACT = Newton(tolerance=1e-12)
REFINED = [(9, 9), SHAPE]


def error(lattice, functions, start):
    """Largest distance of the solved grid from the exact lattice with the same boundary."""
    first = lattice.copy()
    first[1:-1, 1:-1] = start[1:-1, 1:-1]
    got, report = solved(EXACT, first, functions)
    assert report.converged
    assert not report.folded
    return np.hypot(*(np.asarray(got) - lattice).T).max()


def test_a_sheared_parallelogram_is_the_affine_map():
    xi, eta = places(*SHAPE)
    lattice = np.stack([60 * xi + 25 * eta, 5 * xi + 30 * eta], -1)
    assert error(lattice, controls(SHAPE), bumped(lattice, 1.5)) < 1e-11


def test_constant_controls_on_a_rectangle_stretch_it_exponentially():
    # x'' + phi x' = 0 and y'' + psi y' = 0; central differences of it have a closed form too.
    phi, psi, errors = 1.5, -0.9, []
    for ni, nj in REFINED:
        xi, eta = places(ni, nj)
        uniform = np.stack(np.broadcast_arrays(60 * xi, 40 * eta), -1)
        functions = controls((ni, nj), phi / (ni - 1), psi / (nj - 1))
        continuous = np.stack(
            np.broadcast_arrays(60 * stretched(xi, phi), 40 * stretched(eta, psi)), -1
        )
        errors.append(error(continuous, functions, uniform))
        of_x, of_y = (
            -np.log((1 - step / 2) / (1 + step / 2)) * (n - 1)
            for step, n in ((phi / (ni - 1), ni), (psi / (nj - 1), nj))
        )
        discrete = np.stack(
            np.broadcast_arrays(60 * stretched(xi, of_x), 40 * stretched(eta, of_y)), -1
        )
        assert error(discrete, functions, uniform) < 1e-10
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def test_an_annulus_sector_is_the_polar_map():
    # log r and theta are harmonic, so xi = log(r / 20) / log 3 and eta = 2 theta / pi are.
    errors = []
    for shape in REFINED:
        xi, eta = places(*shape)
        radius, theta = 20 * 3**xi, np.pi / 2 * eta
        polar = np.stack([radius * np.cos(theta), radius * np.sin(theta)], -1)
        evenly = (20 + 40 * xi)[..., None] * np.stack([np.cos(theta), np.sin(theta)], -1)
        errors.append(error(polar, controls(shape), evenly))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


def test_controls_of_physical_space_are_those_of_computational_space():
    # P = phi A / J^2 and Q = psi C / J^2 at the nodes give the same grid.
    start = transfinite(cosine_top())
    by_phi, _ = solved(EXACT, start, controls(SHAPE, phi=0.08, psi=-0.05))
    by_phi = np.asarray(by_phi)
    along_xi = (by_phi[2:, 1:-1] - by_phi[:-2, 1:-1]) / 2
    along_eta = (by_phi[1:-1, 2:] - by_phi[1:-1, :-2]) / 2
    jacobian = along_xi[..., 0] * along_eta[..., 1] - along_xi[..., 1] * along_eta[..., 0]
    p = 0.08 * (along_eta**2).sum(-1) / jacobian**2
    q = -0.05 * (along_xi**2).sum(-1) / jacobian**2
    by_p, report = solved(EXACT, start, controls(SHAPE, p=p, q=q))
    assert report.converged
    np.testing.assert_allclose(by_p, by_phi, atol=1e-9)


def test_vertical_lines_stay_vertical_on_the_paper_domain():
    # x = 100 + 3000 xi solves the equations of eq. (8)'s domain without controls.
    start = transfinite(cosine_top())
    grid, _ = solved(EXACT, start, controls(SHAPE))
    np.testing.assert_allclose(grid[..., 0], start[..., 0], atol=1e-11)
    assert np.abs(grid[..., 1] - start[..., 1]).max() > 5


def insole():
    path = Path(__file__).parents[2] / "examples" / "insole.geojson"
    corners = [[21.8, 6.05], [55.61, 9.0], [52.7, 191.03], [9.03, 192.49]]
    return from_polygon(contour(path), corners=corners)


def crescent():
    """A moon with a deep hollow, its two horns cut off."""
    t = np.linspace(0, np.pi, 60)
    outer = np.stack([-40 * np.cos(t), 40 * np.sin(t)], 1)
    inner = np.stack([-25 * np.cos(t), 32 * np.sin(t) ** 2], 1)
    return from_curves(
        polyline(inner),
        polyline([inner[-1], outer[-1]]),
        polyline(outer),
        polyline([inner[0], outer[0]]),
    )


@pytest.mark.parametrize("follow_sides", [False, True])
@pytest.mark.parametrize("domain", [chevron, circle, insole, crescent, cosine_top])
def test_hard_domains_converge_unfolded(domain, follow_sides):
    start = transfinite(domain())
    phi, psi = boundary_controls(start) if follow_sides else (0.0, 0.0)
    _, report = solved(EXACT, start, controls(SHAPE, phi, psi))
    assert report.converged
    assert not report.folded


boundary_controls = quick_jit(winslow.boundary_controls)


@dataclass(frozen=True)
class Shows(AbstractSolver):
    """Puts the controls that it is given where the lattice's interior should be."""

    names: tuple[str, str]

    def solve(self, start, controls, warm=False):
        shown = jnp.stack([getattr(controls, name) for name in self.names], -1)
        return start.at[1:-1, 1:-1].set(shown), None


def test_unit_square_controls_are_the_papers_per_index_step():
    # phi = 0.03 on 51 nodes is 1.5 on the unit square, psi = 0.03 on 31 nodes is 0.9.
    @quick_jit
    def shown():
        given = Elliptic(Sides.of(cosine_top()), Spacings(), 1.5, 0.9, 0.02, 0.03, (51, 31))
        return [replace(given, solver=Shows(names)).solve()[0] for names in NAMES]

    computational, physical = (np.asarray(each)[1:-1, 1:-1] for each in shown())
    np.testing.assert_allclose(computational, np.full((49, 29, 2), 0.03), rtol=1e-15)
    np.testing.assert_allclose(physical, np.broadcast_to([1.0, 0.9], (49, 29, 2)), rtol=1e-15)


NAMES = ("phi", "psi"), ("p", "q")


def test_float32_and_too_few_nodes_are_refused():
    sides = Sides.of(cosine_top())
    with pytest.raises(ValueError, match="at least 5 each way"):
        Elliptic(sides, nodes=(41, 4))
    with jax.enable_x64(False), pytest.raises(InputError, match="float64"):
        Elliptic(sides).solve()


# --- what is no problem to solve ---


@pytest.fixture
def problem():
    shape = (6, 5)
    start = transfinite(cosine_top(), shape)
    return jnp.asarray(start), ControlFunctions(*(jnp.zeros((4, 3)),) * 4)


def spoilt(start, functions, what):
    if what == "controls":
        return start, functions._replace(psi=functions.psi.at[1, 1].set(jnp.nan))
    if what == "repeated":
        return start.at[3, -1].set(start[2, -1]), functions
    if what == "few":
        return start[:2], functions
    if what == "float32":
        return start.astype(jnp.float32), functions
    return start, functions._replace(phi=functions.phi[:2])


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("controls", "psi are not all finite"),
        ("repeated", "nodes 2 and 3 of the top side coincide"),
        ("few", r"shape \(2, 5, 2\)"),
        ("float32", "nodes are float32; float64"),
        ("shape", r"phi has shape \(2, 3\)"),
    ],
)
def test_bad_input_is_refused_before_anything_is_compiled(problem, what, says):
    with pytest.raises(InputError, match=says):
        elliptic.solve(Newton(), *spoilt(*problem, what))


def test_sides_that_do_not_meet_and_controls_that_are_not_finite_are_refused():
    sides = Sides.of(cosine_top())
    apart = sides._replace(left=Sides.of(rectangle(5, 5)).left)
    with pytest.raises(InputError, match=r"bottom and left do not meet: they are .* mm apart"):
        Elliptic(apart)
    with pytest.raises(InputError, match="phi is not finite"):
        Elliptic(sides, phi=float("inf"))
    with pytest.raises(InputError, match="at least 5"):
        Elliptic(sides, nodes=(4, 9))


def test_controls_per_index_step_are_the_papers_numbers():
    sides, nodes = Sides.of(cosine_top()), (13, 11)

    @quick_jit
    def lattice(elliptic):
        return elliptic.solve()[0]

    solver = Newton()
    unit = lattice(Elliptic(sides, phi=0.36, psi=-0.3, nodes=nodes, solver=solver))
    stepped = Elliptic(sides, phi_index=0.03, psi_index=-0.03, nodes=nodes, solver=solver)
    np.testing.assert_allclose(lattice(stepped), unit, atol=1e-10)
