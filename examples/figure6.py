"""Figure 6 of the paper: four elliptic grids on the domain of its eq. (8).

    python examples/figure6.py [--out DIR]

Writes `figure6.png` and `figure6.svg` to DIR (default `out/figure6`) and prints, for each grid,
how many sweeps the paper's solver takes (point SOR at w = 1.8, until the mean correction is under
0.1 % of its value on the starting grid), how far the nodes then still are from the solution, and
in how many steps Newton's method gets there.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fdjax.errors import DesignError
from fdjax.grid.base import Sides
from fdjax.grid.elliptic import Elliptic
from fdjax.grid.solvers import SOR, AbstractSolver, Newton, Report
from fdjax.part.patch import cosine_top
from fdjax.units import MICROSTEP

NODES = (51, 31)
CASES = {
    "a": ("no clustering", 0.0, 0.0),
    "b": ("φ = 0.03", 0.03, 0.0),
    "c": ("ψ = 0.03", 0.0, 0.03),
    "d": ("φ = ψ = 0.03", 0.03, 0.03),
}
"""Title, and the controls per index step along xi and eta as the paper gives them."""


@dataclass(frozen=True)
class Grid:
    """One panel: converged nodes in microsteps, shape (51, 31, 2), and how SOR got near them."""

    title: str
    nodes: np.ndarray
    steps: int
    sweeps: int
    errors: np.ndarray
    """Distance from SOR's nodes to the converged ones, interior nodes only, microsteps."""


@jax.jit
def solve(grid: Elliptic) -> tuple[jax.Array, Report]:
    return grid.solve()


def solved(solver: AbstractSolver, phi: float, psi: float) -> tuple[np.ndarray, int]:
    """Nodes in microsteps and the solver's iterations, from the transfinite starting grid."""
    ni, nj = NODES
    nodes, report = solve(
        Elliptic(
            Sides.of(cosine_top()),
            # On the unit square controls are per unit of xi and eta, not per index step.
            phi=phi * (ni - 1),
            psi=psi * (nj - 1),
            nodes=NODES,
            solver=solver,
        )
    )
    if not report.converged or report.folded:
        raise DesignError(f"figure 6: {solver} gives no grid for phi = {phi}, psi = {psi}")
    return np.asarray(nodes) / MICROSTEP, int(report.iterations)


def make(title: str, phi: float, psi: float) -> Grid:
    """The converged grid and its distance from the paper's way of making it."""
    nodes, steps = solved(Newton(), phi, psi)
    by_sor, sweeps = solved(SOR(omega=1.8, tolerance=1e-3), phi, psi)
    errors = np.hypot(*(by_sor - nodes)[1:-1, 1:-1].T)
    return Grid(title, nodes, steps, sweeps, errors)


def table(grids: dict[str, Grid]) -> str:
    """The counts and errors, one line a grid."""
    lines = [
        f"eq. (8) domain, {NODES[0]} x {NODES[1]} nodes, errors in microsteps (0.001 in)",
        "grid                 SOR sweeps   mean error   largest error   Newton steps",
    ]
    lines += [
        f"({name}) {grid.title:<15} {grid.sweeps:>11} {grid.errors.mean():>12.4f}"
        f" {grid.errors.max():>15.4f} {grid.steps:>14}"
        for name, grid in grids.items()
    ]
    return "\n".join(lines)


def draw(grids: dict[str, Grid]) -> Figure:
    """The grids side by side as in the paper, axes in microsteps."""
    figure = Figure(figsize=(7.5, 9.5), layout="constrained")
    for axes, (name, grid) in zip(figure.subplots(2, 2).flat, grids.items(), strict=True):
        lines = [*grid.nodes, *grid.nodes.swapaxes(0, 1)]
        axes.add_collection(LineCollection(lines, colors="black", linewidths=0.35))
        axes.set(xlim=(0, 3200), ylim=(-100, 4100), aspect="equal")
        axes.set_title(f"({name})  {grid.title}", fontsize=10)
        axes.tick_params(labelsize=7)
        axes.set_xlabel("x, microsteps", fontsize=8)
        axes.set_ylabel("y, microsteps", fontsize=8)
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="The four grids of the paper's Figure 6.")
    parser.add_argument("--out", type=Path, default=Path("out/figure6"), metavar="DIR")
    folder = parser.parse_args(argv).out
    jax.config.update("jax_enable_x64", True)
    grids = {name: make(*case) for name, case in CASES.items()}
    print(table(grids))
    folder.mkdir(parents=True, exist_ok=True)
    figure = draw(grids)
    for name in ("figure6.png", "figure6.svg"):
        figure.savefig(folder / name, dpi=200)
        print(f"wrote {folder / name}")


if __name__ == "__main__":
    main()
