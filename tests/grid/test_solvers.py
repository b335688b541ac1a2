"""Solvers: how they converge, that they agree, and that they own up."""

import numpy as np
import pytest
from grid_samples import (
    SHAPE,
    bumped,
    chevron,
    controls,
    mean_correction,
    solved,
    transfinite,
)

from fdjax.grid.operators import corner_jacobians
from fdjax.grid.solvers import SOR, Newton
from fdjax.grid.transfer import planes
from fdjax.part.patch import cosine_top, rectangle
from fdjax.units import MICROSTEP

EXACT = Newton(tolerance=1e-12)
ONE_STEP, ONE_SWEEP = Newton(max_steps=1), SOR(max_sweeps=1)

PAPER = (51, 31)
"""Nodes of the paper's Figure 6."""


@pytest.fixture(scope="module")
def paper_start():
    return transfinite(cosine_top(), PAPER)


def newton_steps(start, functions):
    """Lattices after each step of Newton's method, and their mean corrections."""
    lattices, sizes = [start], [float(mean_correction(start, functions))]
    while sizes[-1] > 1e-10 * sizes[0]:
        lattice, report = solved(ONE_STEP, lattices[-1], functions)
        assert report.iterations == 1
        lattices.append(np.asarray(lattice))
        sizes.append(float(mean_correction(lattice, functions)))
    return lattices, np.array(sizes)


def sor_counts(start, exact, goals):
    """Sweeps until the mean change of a node per sweep is below each goal, and the error then.

    A change is |dx| + |dy|, w times the correction; both in microsteps.
    """
    functions, lattice = controls(start.shape), start
    result = []
    for sweep in range(1, 1000):
        before = lattice
        lattice = np.asarray(solved(ONE_SWEEP, before, functions)[0])
        change = np.abs(lattice - before)[1:-1, 1:-1].sum(-1).mean() / MICROSTEP
        while goals and change < goals[0]:
            error = np.hypot(*(lattice - exact).T).max() / MICROSTEP
            result.append((sweep, pytest.approx(float(error), rel=0.02)))
            goals = goals[1:]
        if not goals:
            return result
    raise AssertionError(f"{result} after 1000 sweeps")


@pytest.mark.parametrize(("phi", "psi"), [(0, 0), (0.03, 0), (0.03, 0.03)])
def test_newton_is_quadratic_on_the_grids_of_figure_6(paper_start, phi, psi):
    _, sizes = newton_steps(paper_start, controls(PAPER, phi, psi))
    assert len(sizes) - 1 in (6, 7)
    # e_{k+1} <= c e_k^2 with one c, and halves or better all the way.
    last = sizes[-4:-1] / sizes[0]
    assert (last[1:] < 10 * last[:-1] ** 2).all()
    assert (np.diff(np.log2(sizes)) < -1).all()


def test_sor_counts_and_errors_on_the_paper_domain(paper_start):
    goals = [1, 0.1, 0.001]
    paper_grid = newton_steps(paper_start, controls(PAPER))[0][-1]
    # Exchanging xi and eta exchanges the two orders of a lexicographic sweep.
    turned = sor_counts(paper_start.swapaxes(0, 1), paper_grid.swapaxes(0, 1), goals)
    assert turned == [(57, 38.1), (99, 3.81), (183, 0.0380)]
    assert sor_counts(paper_start, paper_grid, goals) == [(52, 35.9), (91, 3.70), (171, 0.0360)]


def test_newton_and_sor_reach_the_same_grid():
    start, functions = transfinite(cosine_top()), controls(SHAPE, phi=0.1, psi=-0.05)
    by_newton, _ = solved(EXACT, start, functions)
    by_sor, report = solved(SOR(omega=1.7, tolerance=1e-12), start, functions)
    assert report.converged
    np.testing.assert_allclose(by_sor, by_newton, atol=1e-10)


def test_sor_stops_at_its_tolerance_and_where_rounding_begins():
    start, functions = transfinite(cosine_top()), controls(SHAPE)
    solver = SOR(omega=1.7, tolerance=1e-12)
    _, report = solved(solver, start, functions)
    assert 1e-13 < report.correction <= 1e-12
    # The uniform grid of a rectangle is the solution: what is left is rounding alone.
    uniform = transfinite(rectangle(70, 30))
    for each in (solver, EXACT):
        lattice, report = solved(each, uniform, functions)
        assert report.converged
        assert report.iterations == 0
        np.testing.assert_array_equal(lattice, uniform)


@pytest.mark.parametrize("solver", [ONE_STEP, ONE_SWEEP], ids=["newton", "sor"])
def test_an_unconverged_solve_says_so(solver, paper_start):
    lattice, report = solved(solver, paper_start, controls(PAPER))
    assert report.iterations == 1
    assert not report.converged
    assert report.correction > 0.01
    np.testing.assert_array_equal(np.asarray(lattice)[[0, -1]], paper_start[[0, -1]])


@pytest.mark.parametrize("strength", [0.1, 0.6, 1.5])
@pytest.mark.parametrize("patch", [cosine_top, chevron])
def test_newton_from_an_unfolded_start_never_folds_silently(patch, strength):
    random = np.random.default_rng(int(100 * strength))
    start = transfinite(patch())
    phi, psi = strength * random.normal(size=(2, SHAPE[0] - 2, SHAPE[1] - 2))
    lattice, report = solved(EXACT, start, controls(SHAPE, phi, psi))
    folded = np.asarray(corner_jacobians(planes(np.asarray(lattice)))).min() <= 0
    assert report.folded == folded
    started_folded = np.asarray(corner_jacobians(planes(start))).min() <= 0
    assert started_folded or not folded
    assert np.isfinite(lattice).all()
    left = mean_correction(lattice, controls(SHAPE, phi, psi)) / mean_correction(
        start, controls(SHAPE, phi, psi)
    )
    assert report.correction == pytest.approx(float(left), abs=1e-13)


def test_a_folded_start_unfolds():
    start = bumped(transfinite(rectangle(40, 40)), 12)
    assert np.asarray(corner_jacobians(planes(start))).min() < 0
    lattice, report = solved(EXACT, start, controls(SHAPE))
    assert report.converged
    assert not report.folded
    np.testing.assert_allclose(lattice, transfinite(rectangle(40, 40)), atol=1e-10)
