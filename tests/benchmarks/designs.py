"""The designs of examples/cosine_targets.py: least squares against quasi-Newton on SciPy.

    python tests/benchmarks/designs.py [TARGET ...] [--cap SECONDS] [--pairs PAIRS]

One objective, that of the cells' porosity on the domain of eq. (8) with a solver of 51 x 31 nodes,
minimised in three ways:

- fdjax: `fdjax.optimise.least_squares.optimise`, Levenberg-Marquardt with a whole Jacobian a step;
- sparse: SciPy's L-BFGS-B; the grid by Newton's method with SuperLU, the gradient by an adjoint
  with the same factors, everything else compiled by JAX;
- adjoint: SciPy's L-BFGS-B with fdjax's own compiled value and gradient.

fdjax runs to its end, three times, of which the median is taken. The other two run until they reach
its objective, or to the cap; when they reach its RMS error of porosity is told too. Each is checked
against central differences. Compiling is excluded and told apart. Needs SciPy.
"""

import argparse
import contextlib
import importlib.util
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

try:
    from scipy.optimize import minimize
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu
except ImportError:
    sys.exit("designs.py compares with SciPy, which is not installed: pip install scipy")

import fdjax
from fdjax.grid import operators, winslow
from fdjax.grid.elliptic import NodeMap
from fdjax.grid.transfer import planes
from fdjax.optimise.least_squares import optimise
from fdjax.optimise.objective import Objective
from fdjax.pattern.maps import elliptic

jax.config.update("jax_enable_x64", True)

NODES = (51, 31)
TOLERANCE = 1e-10
SMOOTHNESS = 3e-5
SAME = 1.01
"""What counts as the same error: within a hundredth."""

FAILED = 1.0
"""Value of a trial that could not be made: its error is that of no porosity at all."""


def cosine_targets():
    """The example, as a module."""
    path = Path(__file__).parents[2] / "examples" / "cosine_targets.py"
    spec = importlib.util.spec_from_file_location("cosine_targets", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def objective_of(example, name: str) -> Objective:
    """The objective of an example's design, where the design begins."""
    target = fdjax.expression(example.TARGETS[name], unit="mil")
    machine = fdjax.load_machine("stratasys-fdm1650")
    begun = fdjax.design(
        example.PART,
        target,
        limits=machine.limits,
        pattern=fdjax.MapLines(
            map="elliptic",
            lines=(51, 31),
            road_width=0.028 * example.INCH,
            controls=("spacing", "phi", "psi", "width"),
            nodes=NODES,
            knots=10,
        ),
        window=example.WINDOW,
        objective="cells",
        smoothness=SMOOTHNESS,
        iterations=0,
        span_limit=False,
    )
    return begun.objective


def _value(residuals) -> tuple[jax.Array, jax.Array]:
    """The objective, and the RMS error of porosity in it."""
    kinds = [sum((part**2).sum() for part in jax.tree.leaves(kind)) for kind in residuals]
    return sum(kinds), jnp.sqrt(kinds[0])


class Trial(NamedTuple):
    """One evaluation: seconds since the start, root of the objective, RMS error of porosity."""

    seconds: float
    root: float
    error: float


class Sparse:
    """The objective and its gradient by SciPy's sparse direct solver.

    Newton's method from the last lattice, moved by the transfinite interpolation of what the
    boundary has moved; the factors of a step are kept while they bring the correction down to a
    tenth, and serve the adjoint, refined once.
    """

    def __init__(self, objective: Objective, unravel: Callable) -> None:
        pattern = objective.pattern
        ni, nj = (count - 2 for count in NODES)
        self.factored = self.solved = 0
        self.lattice = self.start = self.goal = None

        def problem(free):
            return elliptic(pattern, unravel(free)).problem()

        def value(nodes, free):
            controls = unravel(free)
            grid = elliptic(pattern, controls)
            through = NodeMap.through(nodes, grid.sides, grid.spacings)
            realised = pattern.over(through, jnp.asarray(True), controls)
            return _value(objective.residuals(realised, controls))

        def assembled(nodes, controls):
            terms = operators.derivative(planes(nodes), operators.equations_of(controls))
            blocks = operators.stencil(terms).blocks
            return jnp.stack([jnp.stack(row) for row in blocks])

        def pulled_back(nodes, free, adjoint, by_nodes):
            """What the equations and the moving boundary add to the gradient in `free`."""

            def along(free):
                start, controls = problem(free)
                held = start.at[1:-1, 1:-1].set(nodes[1:-1, 1:-1])
                inside = (adjoint * winslow.residual(held, controls)).sum()
                return (by_nodes.at[1:-1, 1:-1].set(0.0) * start).sum() - inside

            return jax.grad(along)(free)

        self.problem, self.assembled = jax.jit(problem), jax.jit(assembled)
        self.value = jax.jit(jax.value_and_grad(value, argnums=(0, 1), has_aux=True))
        self.pulled_back = jax.jit(pulled_back)
        self.residual = jax.jit(
            lambda r, c: (
                winslow.residual(r, c),
                operators.mean_correction(operators.equations_of(c), planes(r)),
            )
        )
        self.folded = jax.jit(lambda r: operators.folded(planes(r)))
        # Where each entry of the stencil's blocks lies in the matrix, once and for all.
        di, dj, i, j, row, column = np.indices((3, 3, ni, nj, 2, 2)).reshape(6, -1)
        k, m = i + di - 1, j + dj - 1
        self.used = np.flatnonzero((k >= 0) & (k < ni) & (m >= 0) & (m < nj))
        rows, columns = (i * nj + j) * 2 + row, (k * nj + m) * 2 + column
        self.places = rows[self.used], columns[self.used]
        self.size = 2 * ni * nj
        # A matrix of entry numbers, so that later ones only take their values in its order.
        numbered = csc_array((np.arange(1, len(self.used) + 1), self.places), (self.size,) * 2)
        self.order = self.used[numbered.data - 1]
        self.pattern = numbered.indices, numbered.indptr

    def matrix(self, nodes, controls):
        entries = np.asarray(self.assembled(nodes, controls)).ravel()[self.order]
        return csc_array((entries, *self.pattern), shape=(self.size,) * 2)

    def solve(self, start, controls):
        """The lattice, the last matrix's factors, and whether it is made."""
        first = float(self.residual(start, controls)[1])
        goal = TOLERANCE * first
        r = start if self.lattice is None else moved(self.lattice, start)
        residual, size = self.residual(r, controls)
        factors, last = None, np.inf
        for _ in range(40):
            if size <= goal and factors is not None:
                break
            if factors is None or size > 0.1 * last:
                factors = splu(self.matrix(r, controls), permc_spec=ORDER)
                self.factored += 1
            change = np.zeros_like(r)
            change[1:-1, 1:-1] = factors.solve(-np.asarray(residual).ravel()).reshape(
                r.shape[0] - 2, r.shape[1] - 2, 2
            )
            share, last = 1.0, float(size)
            while share > 1e-4:
                trial = r + share * change
                residual, size = self.residual(trial, controls)
                if size < last:
                    break
                share /= 2
            r = trial
        return r, factors, bool(size <= goal) and not bool(self.folded(r))

    def __call__(self, free):
        start, controls = jax.device_get(self.problem(free))
        r, factors, made = self.solve(start, controls)
        self.solved += 1
        if not made:
            return FAILED, FAILED, np.zeros_like(free)
        self.lattice = r
        (value, error), (by_nodes, by_free) = jax.device_get(self.value(r, free))
        inside = by_nodes[1:-1, 1:-1].ravel()
        adjoint = factors.solve(inside, "T")
        matrix = self.matrix(r, controls)
        adjoint += factors.solve(inside - matrix.T @ adjoint, "T")
        more = self.pulled_back(r, free, adjoint.reshape(r.shape[0] - 2, -1, 2), by_nodes)
        return float(value), float(error), by_free + np.asarray(more)


ORDER = "MMD_AT_PLUS_A"


def moved(lattice, start):
    """A lattice moved to other boundary nodes: their change, interpolated between the sides."""
    step = start - lattice
    f, g = (np.linspace(0, 1, n) for n in NODES)
    f, g = f[:, None, None], g[None, :, None]
    between = (1 - g) * step[:, :1] + g * step[:, -1:] + (1 - f) * step[:1] + f * step[-1:]
    corners = (1 - f) * ((1 - g) * step[0, 0] + g * step[0, -1])
    corners = corners + f * ((1 - g) * step[-1, 0] + g * step[-1, -1])
    return lattice + between - corners


def adjoint_of(objective: Objective, unravel: Callable) -> Callable:
    """The objective and its gradient as fdjax compiles them."""

    def value(free):
        residuals, made = objective(unravel(free))
        value, error = _value(residuals)
        return value, (error, made)

    compiled = jax.jit(jax.value_and_grad(value, has_aux=True))

    def call(free):
        (value, (error, made)), gradient = jax.device_get(compiled(free))
        if not made:
            return FAILED, FAILED, np.zeros_like(free)
        return float(value), float(error), gradient

    return call


def quasi_newton(call: Callable, free, goal: float, cap: float, pairs: int) -> list[Trial]:
    """Evaluations of L-BFGS-B until the root of the objective is `goal`, or `cap` seconds."""
    trials, began = [], time.perf_counter()

    class Done(Exception):
        pass

    def scaled(free):
        value, error, gradient = call(free)
        trials.append(Trial(time.perf_counter() - began, value**0.5, error))
        if trials[-1].root <= goal or trials[-1].seconds > cap:
            raise Done
        # In units in which the solver's own tolerances are out of the way.
        return SCALE * value, SCALE * gradient

    options = {"maxcor": pairs, "maxiter": 10**6, "maxfun": 10**6, "ftol": 0.0, "gtol": 0.0}
    with contextlib.suppress(Done):
        minimize(scaled, free, jac=True, method="L-BFGS-B", options=options)
    return trials


SCALE = 1e4


def gradient_error(call: Callable, free) -> float:
    """Of the gradient in a random direction, against central differences; relative."""
    way = np.random.default_rng(3).normal(size=free.shape)
    step = 1e-4
    ahead, behind = call(free + step * way)[0], call(free - step * way)[0]
    slope = (ahead - behind) / (2 * step)
    return abs(call(free)[2] @ way - slope) / abs(slope)


def compare(example, name: str, cap: float, pairs: int) -> None:
    objective = objective_of(example, name)
    first = objective.pattern.first
    free, unravel = ravel_pytree(first)
    free = np.asarray(free)
    began = time.perf_counter()
    optimise(objective, first, steps=1)
    compiling = time.perf_counter() - began
    runs, improvements = [], []
    for _ in range(3):
        improvements.clear()
        runs.append(
            optimise(objective, first, steps=80, patience=0.01, progress=improvements.append)
        )
    ours = runs[0]._replace(seconds=statistics.median(each.seconds for each in runs))
    best = min(improvements, key=lambda each: each.objective)
    print(
        f"{name}: {len(free)} controls; {compiling:.1f} s of compiling\n"
        f"  {'fdjax':8} {ours.seconds:8.2f} s  {ours.steps:5} evaluations  "
        f"RMS error {ours.error:.6f}  objective {best.objective:.6f}",
        flush=True,
    )
    ways = {"sparse": Sparse(objective, unravel), "adjoint": adjoint_of(objective, unravel)}
    for way, call in ways.items():
        began = time.perf_counter()
        call(free)
        compiling = time.perf_counter() - began
        wrong = gradient_error(call, free)
        trials = quasi_newton(call, free, SAME * best.objective, cap, pairs)
        least = min(trials, key=lambda each: each.root)
        reached = [
            next((trial.seconds for trial in trials if met(trial)), None)
            for met in (
                lambda trial: trial.root <= SAME * best.objective,
                lambda trial: trial.error <= SAME * ours.error,
            )
        ]
        says = [
            "not reached" if at is None else f"{at:.2f} s, ratio {at / ours.seconds:.1f}"
            for at in reached
        ]
        print(
            f"  {way:8} {trials[-1].seconds:8.2f} s  {len(trials):5} evaluations  RMS error "
            f"{least.error:.6f}  objective {least.root:.6f}; the same objective: {says[0]}; the "
            f"same RMS error: {says[1]}; {compiling:.1f} s of compiling, gradient to {wrong:.0e}",
            flush=True,
        )
        if way == "sparse":
            print(f"  {'':8} {call.factored} factorisations in {call.solved} solves")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    example = cosine_targets()
    parser.add_argument("targets", nargs="*", default=list(example.TARGETS))
    parser.add_argument("--cap", type=float, default=120)
    parser.add_argument("--pairs", type=int, default=50)
    arguments = parser.parse_args()
    print(f"{sys.platform}, {jax.devices()[0].platform}, JAX {jax.__version__}; {NODES} nodes")
    for name in arguments.targets:
        compare(example, name, arguments.cap, arguments.pairs)


if __name__ == "__main__":
    main()
