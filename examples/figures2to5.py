"""Figures 2 to 5 of the paper: algebraic grids of a rectangle and of a circle, drawn and printed.

    python examples/figures2to5.py [--out DIR]

Runs the six jobs `figure2_*.toml` to `figure5.toml` beside this file into folders of DIR (default
`out/figures2to5`), each with its G-code, report and pictures, draws the grids into
`figures2to5.png` and `.svg`, and prints what was measured in the files.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fdjax.app import cli, config, setting

HERE = Path(__file__).parent
JOBS = {
    "figure2_rectangle": "Figure 2: uniform, in a rectangle",
    "figure2_circle": "Figure 2: uniform, in a circle",
    "figure3_rectangle": "Figure 3: eq. (1), in a rectangle",
    "figure3_circle": "Figure 3: eq. (1), in a circle",
    "figure4": "Figure 4: two-boundary",
    "figure5": "Figure 5: transfinite, eq. (2)",
}
"""Title of each job's panel."""


def grid_of(name: str) -> tuple[shapely.Polygon, list[NDArray[np.float64]]]:
    """Outline of a job's part and the lines of its grid, sides included, cut at the outline."""
    job = config.load(HERE / f"{name}.toml")
    part = setting.part_of(job.part)
    machine = setting.machine_of(job, "ssl")
    target = setting.target_of(job.target, part)
    pattern = job.pattern.begin(part, target, machine.limits, job.target.window)
    grid = pattern.realise(pattern.controls()).grid
    n_xi, n_eta = job.pattern.lines
    fine = jnp.linspace(0, 1, 201)
    lines = [
        *np.asarray(grid(jnp.linspace(0, 1, n_xi)[:, None], fine[None])),
        *np.asarray(grid(fine[None], jnp.linspace(0, 1, n_eta)[:, None])),
    ]
    (outline,) = part.regions[0].polygons
    inside = shapely.intersection(shapely.linestrings(np.stack(lines)), outline.buffer(1e-6))
    pieces = shapely.get_parts(inside)
    return outline, [np.asarray(piece.coords) for piece in pieces if piece.length > 0]


def draw() -> Figure:
    """The grids as in the paper, in mm."""
    figure = Figure(figsize=(9, 6.4), layout="constrained")
    for axes, (name, title) in zip(figure.subplots(2, 3).T.flat, JOBS.items(), strict=True):
        outline, lines = grid_of(name)
        axes.add_collection(LineCollection(lines, colors="black", linewidths=0.4))
        axes.plot(*outline.exterior.xy, color="black", lw=0.9)
        axes.set(aspect="equal")
        axes.set_title(title, fontsize=9)
        axes.tick_params(labelsize=7)
        axes.set_xlabel("x, mm", fontsize=8)
        axes.set_ylabel("y, mm", fontsize=8)
    return figure


def line_of(name: str, report: dict) -> str:
    """What was measured in a job's file, in one line."""
    (file,) = report["files"].values()
    return (
        f"{name:<18} {file['mean_got']:>8.4f} {file['rms']:>8.4f} {file['roads']:>6}"
        f" {file['travel']:>8.1f} {len(file['findings']):>9}"
    )


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="The grids of the paper's Figures 2 to 5.")
    parser.add_argument("--out", type=Path, default=Path("out/figures2to5"), metavar="DIR")
    folder = parser.parse_args(argv).out
    jax.config.update("jax_enable_x64", True)
    print("job                porosity  uneven  roads   travel  warnings")
    for name in JOBS:
        out = folder / name
        code = cli.main(["design", str(HERE / f"{name}.toml"), "--out", str(out), "--quiet"])
        if code:
            sys.exit(code)
        print(line_of(name, json.loads((out / "report.json").read_text())))
    figure = draw()
    for picture in ("figures2to5.png", "figures2to5.svg"):
        figure.savefig(folder / picture, dpi=200)
        print(f"wrote {folder / picture}")


if __name__ == "__main__":
    main()
