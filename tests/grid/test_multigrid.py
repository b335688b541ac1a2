"""Multigrid: its operators, its transfers, and that its cycles solve what they should."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import (
    chevron,
    circle,
    controls,
    mean_correction,
    quick_jit,
    random_case,
    solved,
    transfinite,
)
from random_outlines import bent_strip, smooth_controls, star

from fdjax.grid import (
    batches,
    block_tridiagonal,
    elliptic,
    multigrid,
    operators,
    solvers,
    transfer,
    winslow,
)
from fdjax.grid.solvers import CONVERGED, TOO_LONG, Multigrid, Newton
from fdjax.part.patch import cosine_top


def padded(values):
    """Values at the interior nodes as planes with zeros on the walls."""
    return transfer.planes(jnp.pad(jnp.asarray(values), ((1, 1), (1, 1), (0, 0))))


def interior(pair):
    return np.asarray(transfer.points(pair))[1:-1, 1:-1]


def zeros(shape):
    return (jnp.zeros(shape),) * 2


# --- operators ---


@quick_jit
def applied(lattice, functions, change):
    """Residual, derivative and transposed derivative, by multigrid's operators and by JAX."""
    equations, nodes = operators.equations_of(functions), transfer.planes(lattice)
    terms = operators.derivative(nodes, equations)
    none = zeros(lattice.shape[:2])
    inside = transfer.points(change)
    _, forward = jax.jvp(lambda r: winslow.residual(r, functions), (lattice,), (inside,))
    _, back = jax.vjp(lambda r: winslow.residual(r, functions), lattice)
    return (
        equations.residual(nodes, none),
        operators.Linearised(terms).residual(change, none),
        operators.Transposed(terms).residual(change, none),
    ), (winslow.residual(lattice, functions), forward, back(inside[1:-1, 1:-1])[0][1:-1, 1:-1])


def test_operators_are_the_equations_their_derivative_and_its_transpose():
    lattice, functions = random_case((9, 12), 3)
    change = padded(np.random.default_rng(4).normal(size=(7, 10, 2)))
    for got, expected in zip(*applied(lattice, functions, change), strict=True):
        np.testing.assert_allclose(interior(got), expected, atol=1e-12 * np.abs(expected).max())


def test_the_mean_correction_and_folds_are_those_of_winslow():
    lattice, functions = random_case((9, 12), 5)
    nodes = transfer.planes(jnp.asarray(lattice))
    got = operators.mean_correction(operators.equations_of(functions), nodes)
    assert float(got) == pytest.approx(float(mean_correction(lattice, functions)))
    assert not operators.folded(nodes)
    turned = lattice[::-1]
    assert operators.folded(transfer.planes(jnp.asarray(turned)))


# --- transfers ---


@pytest.mark.parametrize("halvings", [1, 2])
@pytest.mark.parametrize("shape", [(17, 33), (18, 20), (31, 9), (51, 6)])
def test_transfers_keep_bilinear_functions_and_means(shape, halvings):
    xi, eta = np.linspace(0, 1, shape[0])[:, None], np.linspace(0, 1, shape[1])
    plane = jnp.asarray(1 + 2 * xi - eta + 3 * xi * eta)
    smaller = shape
    for _ in range(halvings):
        smaller = transfer.halved(smaller)
    coarse = transfer.restricted(plane, smaller)
    assert max(coarse.shape) < max(shape)
    u, v = np.linspace(0, 1, coarse.shape[0])[:, None], np.linspace(0, 1, coarse.shape[1])
    np.testing.assert_allclose(coarse, 1 + 2 * u - v + 3 * u * v, atol=1e-13)
    np.testing.assert_allclose(transfer.prolonged(coarse, shape), plane, atol=1e-13)
    mean = np.asarray(transfer.restricted_residual(jnp.ones(shape), smaller))[1:-1, 1:-1]
    steps = np.prod([(n - 1) / (m - 1) for n, m in zip(shape, coarse.shape, strict=True)])
    np.testing.assert_allclose(mean, steps**2)


# --- linear solutions ---


@pytest.mark.parametrize("shape", [(18, 15), (40, 6), (66, 70)])
def test_linear_solutions_are_those_of_elimination(shape):
    start = transfinite(cosine_top(), shape)
    functions = controls(shape, 0.02, -0.03)
    rhs = np.random.default_rng(6).normal(size=(shape[0] - 2, shape[1] - 2, 2))

    @quick_jit
    def both(start, functions, rhs):
        nodes, equations = transfer.planes(start), operators.equations_of(functions)
        terms = operators.derivative(nodes, equations)
        factors = block_tridiagonal.factor(operators.stencil(terms))
        found = [
            multigrid.solve_linear(operator, multigrid.linear_levels(operator), padded(rhs))
            for operator in (operators.Linearised(terms), operators.Transposed(terms))
        ]
        return found, (
            block_tridiagonal.solve(factors, rhs),
            block_tridiagonal.solve_transposed(factors, rhs),
        )

    for got, expected in zip(*both(jnp.asarray(start), functions, rhs), strict=True):
        np.testing.assert_allclose(interior(got), expected, atol=1e-8 * np.abs(expected).max())


def test_derivatives_by_cycles_and_by_elimination_agree(monkeypatch):
    shape = (19, 16)
    start, functions = transfinite(circle(), shape), controls(shape, 0.03, 0.02)
    weight = np.random.default_rng(8).normal(size=start.shape)

    def gradients():
        def scalar(start, functions):
            return (weight * elliptic.solve(Multigrid(1e-13), start, functions)[0]).sum()

        return quick_jit(jax.grad(scalar, argnums=(0, 1)))(start, functions)

    eliminated = gradients()
    monkeypatch.setattr(elliptic, "ELIMINATED", 0)
    cycled = gradients()
    for one, other in zip(jax.tree.leaves(eliminated), jax.tree.leaves(cycled), strict=True):
        np.testing.assert_allclose(other, one, atol=1e-8 * np.abs(one).max() + 1e-14)


# --- solutions ---


@pytest.mark.parametrize(
    ("domain", "shape", "pull"),
    [(cosine_top, (23, 18), 0.05), (circle, (20, 17), -0.04), (chevron, (17, 26), 0.03)],
)
def test_it_finds_what_newton_finds(domain, shape, pull):
    start, functions = transfinite(domain(), shape), controls(shape, pull, -pull)
    exact, _ = solved(Newton(1e-13), start, functions)
    found, report = solved(Multigrid(1e-12), start, functions)
    assert report.converged
    assert not report.folded
    assert int(report.reason) == CONVERGED
    np.testing.assert_allclose(found, exact, atol=1e-9 * np.abs(exact).max())


def test_cycles_stay_as_many_when_the_lattice_is_refined():
    counts = []
    # On 17 nodes, to which 33 are coarsened, this domain is hardly itself any more.
    for side in (65, 129, 257):
        shape = (side, side)
        functions = controls(shape, 0.03 * 50 / (side - 1), -0.03 * 50 / (side - 1))
        _, report = solved(Multigrid(1e-8), transfinite(cosine_top(), shape), functions)
        assert report.converged
        counts.append(int(report.iterations))
    assert max(counts) <= 1.5 * min(counts)


def test_the_history_is_told():
    shape = (23, 18)
    start, functions = transfinite(cosine_top(), shape), controls(shape)
    _, report = solved(Multigrid(1e-12, max_cycles=3), start, functions)
    assert not report.converged
    assert int(report.reason) == TOO_LONG
    history = np.asarray(report.history)
    assert history[0] == 1
    assert (np.diff(history[:4]) < 0).all()
    assert np.isnan(history[4:]).all()
    assert float(report.correction) == pytest.approx(history[3])


def test_many_lattices_are_solved_at_once_as_each_alone():
    shape = (15, 12)
    start = transfinite(cosine_top(), shape)
    starts = jnp.stack([start, start * jnp.array([1.0, 0.8]), start * jnp.array([1.0, 1.3])])
    functions = jax.tree.map(
        lambda *each: jnp.stack(each),
        *(controls(shape, pull, -pull) for pull in (0.0, 0.05, -0.08)),
    )
    together, report = quick_jit(jax.vmap(Multigrid(1e-11).solve))(starts, functions)
    assert report.converged.all()
    for k in range(3):
        alone, _ = solved(
            Multigrid(1e-11), starts[k], jax.tree.map(lambda field, k=k: field[k], functions)
        )
        np.testing.assert_allclose(together[k], alone, atol=1e-7)


@pytest.fixture
def few_lanes(monkeypatch):
    """Lots of two lattices of 12 x 9, sorted anew after every second cycle."""
    monkeypatch.setattr(batches, "AT_ONCE", 2 * 12 * 9)
    monkeypatch.setattr(solvers, "IN_A_ROUND", 2)


@pytest.mark.usefixtures("few_lanes")
def test_lattices_of_a_batch_run_as_long_as_each_alone():
    """In several lots, in two nested maps, one argument the same for all."""
    shape = (12, 9)
    start, functions = jnp.asarray(transfinite(cosine_top(), shape)), controls(shape, 0.05)
    heights = jnp.array([[1.0, 0.4, 1.3], [2.5, 1.2, 0.8]])
    starts = start * jnp.stack([jnp.ones_like(heights), heights], -1)[:, :, None, None]
    solve = Multigrid(1e-11).solve
    by_row = jax.vmap(solve, in_axes=(0, None))
    together, report = quick_jit(jax.vmap(by_row, in_axes=(0, None)))(starts, functions)
    flat, _ = quick_jit(by_row)(starts.reshape(6, *start.shape)[:5], functions)
    assert report.converged.all()
    assert len(set(np.asarray(report.iterations).ravel())) > 1
    for k in range(6):
        place = divmod(k, 3)
        alone, own = solved(Multigrid(1e-11), starts[place], functions)
        assert int(report.iterations[place]) == int(own.iterations)
        np.testing.assert_allclose(report.history[place], own.history, rtol=1e-3, atol=1e-12)
        np.testing.assert_allclose(together[place], alone, atol=1e-7)
        if k < 5:
            np.testing.assert_allclose(flat[k], alone, atol=1e-7)


@pytest.mark.usefixtures("few_lanes")
def test_a_lattice_that_fails_leaves_its_neighbours_alone():
    shape = (12, 9)
    start, functions = jnp.asarray(transfinite(cosine_top(), shape)), controls(shape, 0.05)
    none = start.at[5, 4].set(jnp.nan)
    starts = jnp.stack([start, none, start])
    found, report = quick_jit(jax.vmap(Multigrid(1e-11).solve, in_axes=(0, None)))(
        starts, functions
    )
    np.testing.assert_array_equal(report.converged, [True, False, True])
    alone, own = solved(Multigrid(1e-11), start, functions)
    for k in (0, 2):
        assert int(report.iterations[k]) == int(own.iterations)
        np.testing.assert_allclose(found[k], alone, atol=1e-7)


@pytest.mark.usefixtures("few_lanes")
def test_warm_starts_in_a_batch():
    """One that is solved takes no iteration, whether all others are warm or one is not."""
    shape = (12, 9)
    cold, functions = jnp.asarray(transfinite(cosine_top(), shape)), controls(shape, 0.05)
    exact, own = solved(Multigrid(1e-11), cold, functions)
    near = exact + 1e-3 * (cold - exact)
    starts = jnp.stack([exact, near, near])
    solve = quick_jit(jax.vmap(Multigrid(1e-11).solve, in_axes=(0, None, 0)))
    for warm in (jnp.full(3, True), jnp.array([True, False, True])):
        found, report = solve(starts, functions, warm)
        assert report.converged.all()
        assert int(report.iterations[0]) == 0
        assert (report.iterations[1:] >= 1).all()
        assert not warm.all() or report.iterations[1] < own.iterations
        np.testing.assert_allclose(found, np.broadcast_to(exact, found.shape), atol=1e-7)


# --- any domain ---

OUTLINES, LATTICE = 150, (41, 31)


@pytest.fixture(scope="module")
def solve_any():
    return quick_jit(Multigrid(1e-8).solve)


def inverted(lattice):
    """Whether each cell has a corner that is not convex."""
    return (np.asarray(operators.corner_jacobians(transfer.planes(lattice))) <= 0).any(0)


@pytest.mark.parametrize("kind", [star, bent_strip])
def test_random_outlines_with_random_controls_converge_and_say_where_they_fold(solve_any, kind):
    """All converge. Those that fold do so where the outline itself leaves no other way.

    A star folds in the cells at its four corners, where the outline turns by more than 180
    degrees within a cell; a bent strip beside its inner corner, which lies within a side.
    """
    counts = {"unfolded": 0, "folded": 0}
    for seed in range(OUTLINES):
        rng = np.random.default_rng(1000 + seed)
        start = kind(rng, LATTICE)
        found, report = solve_any(start, smooth_controls(rng, LATTICE))
        assert report.converged, seed
        counts["folded" if report.folded else "unfolded"] += 1
        cells = inverted(found)
        assert bool(report.folded) == cells.any()
        if kind is star:
            cells[:: LATTICE[0] - 2, :: LATTICE[1] - 2] = False
        else:
            cells[LATTICE[0] // 2 - 2 : LATTICE[0] // 2 + 2, -2:] = False
        assert not cells.any(), seed
    print(kind.__name__, counts)
    assert counts["unfolded"] > 0.75 * OUTLINES
