"""Elliptic grids against compiled programs: one run, medians, ratios.

    python tests/benchmarks/grids.py [--peers FOLDER] [--sides 129 257 513 1025] [--sor]

The domain is that of the paper's eq. (8), solved until the mean Gauss-Seidel correction is 1e-8 of
its value on the transfinite grid. FOLDER holds `winslow_fas.c` (multigrid) and `winslow_sor.c`
(point relaxation at its best factor, with --sor: 40 s at 1025 nodes a side); both are compiled with
the machine's C compiler and timed beside fdjax. Without the folder the times stand alone.
"""

import argparse
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from fdjax.grid.algebraic import Transfinite
from fdjax.grid.base import Sides
from fdjax.grid.elliptic import solve
from fdjax.grid.solvers import Multigrid
from fdjax.grid.winslow import ControlFunctions
from fdjax.part.patch import cosine_top

TOLERANCE = 1e-8
SOLVER = Multigrid(TOLERANCE)

_compiled: list[str] = []


def _note(event: str, seconds: float, **_: object) -> None:
    if event == "/jax/core/compile/backend_compile_duration":
        _compiled.append(event)


jax.monitoring.register_event_duration_secs_listener(_note)


def compilations() -> int:
    """Programs that JAX has compiled so far, or taken from its cache on disk."""
    return len(_compiled)


def transfinite(ni: int, nj: int) -> jax.Array:
    """The starting lattice, shape (ni, nj, 2)."""
    xi, eta = jnp.linspace(0, 1, ni)[:, None], jnp.linspace(0, 1, nj)[None]
    return jax.jit(Transfinite(Sides.of(cosine_top())))(xi, eta)


def constant(ni: int, nj: int, phi: float = 0.0, psi: float = 0.0) -> ControlFunctions:
    """Controls given as those per index step of a lattice of 51 x 51 nodes."""
    zero = jnp.zeros(())
    return ControlFunctions(zero + phi * 50 / (ni - 1), zero + psi * 50 / (nj - 1), zero, zero)


def fields(ni: int, nj: int, phi: float = 0.0, psi: float = 0.0) -> ControlFunctions:
    """The same with phi and psi given node by node."""
    given, inside = constant(ni, nj, phi, psi), (ni - 2, nj - 2)
    return given._replace(
        phi=jnp.broadcast_to(given.phi, inside), psi=jnp.broadcast_to(given.psi, inside)
    )


def in_turns(*runs: Callable[[], object], repeats: int = 5) -> list[float]:
    """Median seconds of each of several runs that are compiled already, taken in turns."""
    seconds: list[list[float]] = [[] for _ in runs]
    for _ in range(repeats):
        for run, taken in zip(runs, seconds, strict=True):
            began = time.perf_counter()
            jax.block_until_ready(run())
            taken.append(time.perf_counter() - began)
    return [statistics.median(taken) for taken in seconds]


def compiled(function: Callable[..., object], *arguments: object) -> tuple[Any, float]:
    """The program for such arguments, and the seconds that tracing and compiling it took."""
    began = time.perf_counter()
    program = jax.jit(function).lower(*arguments).compile()
    return program, time.perf_counter() - began


def peer(folder: Path | None, name: str, *arguments: object) -> float | None:
    """Wall seconds that a compiled program says it took."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if folder is None or compiler is None:
        return None
    with tempfile.TemporaryDirectory() as made:
        program = Path(made) / name
        flags = ["-O3", "-march=native", "-ffast-math", str(folder / f"{name}.c"), "-lm"]
        subprocess.run([compiler, *flags, "-o", str(program)], check=True)
        said = subprocess.run(
            [str(program), *map(str, arguments)], check=True, capture_output=True, text=True
        ).stdout
    found = re.search(r"wall\s+([0-9.]+)\s*s", said) or re.search(r"cpu\s+([0-9.]+)\s*s", said)
    assert found, said
    return float(found[1])


def ratio(mine: float, other: float | None) -> str:
    return "-" if other is None else f"{mine / other:.2f}"


def single(folder: Path | None, sides: list[int], sor: bool) -> None:
    print(
        "one grid           compile s   warm s  cycles  cycles at 0.03   to FAS   SOR to this   "
        "compilations: first, later"
    )
    for ni, nj in ((51, 31), *((side, side) for side in sides)):
        start = transfinite(ni, nj)
        run = jax.jit(SOLVER.solve)
        none, pulled = constant(ni, nj), constant(ni, nj, 0.03, -0.03)
        begun = compilations()
        (first,) = in_turns(lambda run=run, start=start, none=none: run(start, none), repeats=1)
        between = compilations()
        (warm,) = in_turns(
            lambda run=run, start=start, none=none: run(start, none),
            repeats=20 if ni < 200 else 5,
        )
        cycles, bent = (run(start, controls)[1] for controls in (none, pulled))
        counts = between - begun, compilations() - between
        assert cycles.converged
        assert bent.converged
        fas = peer(folder, "winslow_fas", ni, nj, TOLERANCE, 1, 1, 3, 1, 1)
        point = peer(folder, "winslow_sor", ni, nj, 0, TOLERANCE, 10**7) if sor else None
        print(
            f"{ni:5} x {nj:<5} {first:15.1f} {warm:9.4f} {int(cycles.iterations):7} "
            f"{int(bent.iterations):13} {ratio(warm, fas):>12} "
            f"{'-' if point is None else f'{point / warm:.1f}':>10} {counts[0]:12}, {counts[1]}",
            flush=True,
        )


def weights(side: int) -> jax.Array:
    """Random weights of a lattice's coordinates."""
    return jnp.asarray(np.random.default_rng(1).normal(size=(side, side, 2)))


def weighted(start: jax.Array, controls: ControlFunctions, weight: jax.Array) -> jax.Array:
    """A scalar of the solved lattice: a weighted sum of its coordinates."""
    return (weight * solve(SOLVER, start, controls)[0]).sum()


def gradient(sides: list[int]) -> None:
    print("gradient           compile s   warm s   to the solve   KiB a node: within, with ends")
    for side in sides:
        start, controls = transfinite(side, side), fields(side, side, 0.03, -0.03)
        weight = weights(side)
        problem = start, controls, weight
        forward, _ = compiled(weighted, *problem)
        both, seconds = compiled(jax.value_and_grad(weighted, argnums=(0, 1)), *problem)
        jax.block_until_ready((forward(*problem), both(*problem)))
        alone, warm = in_turns(
            lambda forward=forward, problem=problem: forward(*problem),
            lambda both=both, problem=problem: both(*problem),
        )
        assert all(jnp.isfinite(g).all() for g in jax.tree.leaves(both(*problem)[1]))
        taken = both.memory_analysis()
        own = taken.temp_size_in_bytes / side**2 / 1024
        ends = taken.argument_size_in_bytes + taken.output_size_in_bytes
        print(
            f"{side:5} x {side:<5} {seconds:15.1f} {warm:9.4f} {warm / alone:12.2f} "
            f"{own:12.2f} {own + ends / side**2 / 1024:12.2f}",
            flush=True,
        )


def many(count: int, side: int) -> tuple[jax.Array, ControlFunctions]:
    """Lattices to start from and controls, one after another along the first axis."""
    rng = np.random.default_rng(2)
    start = transfinite(side, side)
    # Boundaries that differ in height and lean, controls that differ in sign and size.
    stretch = jnp.asarray(rng.uniform(0.7, 1.3, (count, 2, 1)))
    starts = start * stretch.swapaxes(1, 2)[:, None]
    pulls = jnp.asarray(rng.uniform(-1.5, 1.5, (count, 2, 1, 1)) / (side - 1))
    flat = jnp.zeros((1, side - 2, side - 2))
    none = jnp.zeros(count)
    controls = ControlFunctions(flat + pulls[:, 0], flat + pulls[:, 1], none, none)
    return starts, controls


def batch(count: int, side: int, large: int) -> None:
    starts, controls = many(count, side)
    run, compiling = compiled(jax.vmap(SOLVER.solve), starts, controls)
    report = run(starts, controls)[1]
    assert report.converged.all()
    big_problem = transfinite(large, large), fields(large, large)
    big, _ = compiled(SOLVER.solve, *big_problem)
    jax.block_until_ready(big(*big_problem))
    seconds, single = in_turns(lambda: run(starts, controls), lambda: big(*big_problem), repeats=3)
    share = (count * side**2 / seconds) / (large**2 / single)
    print(
        f"batch of {count} of {side} x {side}: compile {compiling:.1f} s, warm {seconds:.3f} s, "
        f"{int(report.iterations.min())} to {int(report.iterations.max())} cycles, "
        f"{share:.2f} of the nodes a second of one grid of {large} x {large}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peers", type=Path)
    parser.add_argument("--sides", type=int, nargs="+", default=[129, 257, 513, 1025])
    parser.add_argument("--sor", action="store_true")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    print(f"{sys.platform}, {jax.devices()[0].platform}, JAX {jax.__version__}")
    single(arguments.peers, arguments.sides, arguments.sor)
    gradient(arguments.sides)
    batch(256, 101, max(arguments.sides))


if __name__ == "__main__":
    main()
