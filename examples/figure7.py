"""Figure 7 of the paper: an embedded grid (a) and a multi-block grid (b), printed and drawn.

    python examples/figure7.py [--out DIR]

Runs the jobs `figure7a.toml` and `figure7b.toml` beside this file into folders of DIR (default
`out/figure7`), each with its G-code, report and pictures, draws the roads of two layers of each
file over each other into `figure7.png`, and prints what was measured in the files.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import jax
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fdjax.app import cli
from fdjax.formats import read_file
from fdjax.plan.toolpath import Build

HERE = Path(__file__).parent
JOBS = {
    "figure7a": "(a) embedded: the base grid keeps its lines",
    "figure7b": "(b) multi-block: lines run through the joins",
}
"""Title of each job's panel."""


def draw(builds: dict[str, Build]) -> Figure:
    """The grid that the roads of the lowest two layers are, in mm."""
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    for axes, (name, build) in zip(figure.subplots(1, 2), builds.items(), strict=True):
        roads = [road.path for layer in build.layers[:2] for road in layer.roads]
        axes.add_collection(LineCollection(roads, colors="black", linewidths=0.5))
        axes.autoscale_view()
        axes.set(aspect="equal")
        axes.set_title(JOBS[name], fontsize=9)
        axes.tick_params(labelsize=7)
        axes.set_xlabel("x, mm", fontsize=8)
        axes.set_ylabel("y, mm", fontsize=8)
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="The grids of the paper's Figure 7.")
    parser.add_argument("--out", type=Path, default=Path("out/figure7"), metavar="DIR")
    folder = parser.parse_args(argv).out
    jax.config.update("jax_enable_x64", True)
    builds = {}
    print("job       asked     got     RMS  roads  travel")
    for name in JOBS:
        out = folder / name
        code = cli.main(["design", str(HERE / f"{name}.toml"), "--out", str(out), "--quiet"])
        if code:
            sys.exit(code)
        (file,) = json.loads((out / "report.json").read_text())["files"].values()
        print(
            f"{name:<8} {file['mean_asked']:>6.4f}  {file['mean_got']:>6.4f}  {file['rms']:>6.4f}"
            f"  {file['roads']:>5}  {file['travel']:>6.1f}"
        )
        builds[name] = read_file(out / f"{name}.gcode")
    draw(builds).savefig(folder / "figure7.png", dpi=110)
    print(f"wrote {folder / 'figure7.png'}")


if __name__ == "__main__":
    main()
