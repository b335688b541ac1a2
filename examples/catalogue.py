"""Textures, recursive cells, space-filling curves and rasters, uniform and graded: a picture and
a table of the errors of porosity, measured in the written G-code.

    python examples/catalogue.py --out examples/
    python examples/catalogue.py --out out/ --only hexagonal hilbert
"""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import jax
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from PIL import Image

from fdjax.app import config
from fdjax.app.run import design
from fdjax.formats import read_file
from fdjax.pattern.curve_order import NAMES as CURVES
from fdjax.pattern.drawings import NAMES as CELLS
from fdjax.plan.toolpath import Layer
from fdjax.view.strips import strips

SIDE = 40.0
TARGETS = {"uniform": "0.3", "graded": f"0.2 + 0.22*x/{SIDE:g}"}
CARPET = {
    "size": [1, 1],
    "lines": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]],
    "rule": ["00", "b0"],
    "order": 2,
}
PATTERNS: dict[str, dict[str, Any]] = {
    **{name: {"kind": "texture", "cell": name} for name in CELLS},
    "truchet, rule wind, order 2": {
        "kind": "texture",
        "cell": {"base": "truchet", "rule": "wind", "order": 2},
    },
    "squares, rule 00 b0, order 2": {"kind": "texture", "cell": CARPET},
    **{name: {"kind": "curve", "curve": name} for name in CURVES},
    "polygons": {"kind": "mesh", "cells": "centre-dual", "laid": "polygons"},
    "rasters": {"kind": "rasters", "domains": {"grid": [2, 2]}, "angles": [0, 45, 90, 30]},
    "contours": {"kind": "rasters", "fills": ["contour"]},
}
"""What `[pattern]` of a job says, by what the page calls it."""


PAGE = f"""# Catalogue

Textures, recursive cells, space-filling curves, polygons and rasters on {SIDE:g} x {SIDE:g} x 2 mm,
solid share {TARGETS["uniform"]} and {TARGETS["graded"]}: the top layer of each file, and the errors
of porosity in 5 mm windows over all layers, measured in the written G-code. Rasters meet the mean
of each sub-domain, and a target that changes inside one only in the mean.
The page before this one is [examples](README.md); this one and its picture are made by
`python examples/catalogue.py --out examples/`.

![top layers](catalogue.png)

"""


def one(pattern: dict[str, Any], target: str, folder: Path) -> tuple[dict[str, Any], Layer]:
    """What the report says of the written file, and the file's top layer."""
    job = config.parse(
        {
            "files": ["gcode"],
            "part": {"shape": "rectangle", "size": [SIDE, SIDE]},
            "target": {"solid": target, "tolerance": 1.0},
            "pattern": pattern,
        },
        name="one",
    )
    design(job, folder, progress=lambda text: None)
    report = json.loads((folder / "report.json").read_text())
    return report["files"]["one.gcode"], read_file(folder / "one.gcode").layers[-1]


def drawn(figure: Figure, layers: dict[tuple[str, str], Layer]) -> None:
    """The top layers, a row for each target and a column for each pattern, about six in a row: as
    many as leave the fewest places of the last row empty.
    """
    names = list(dict.fromkeys(name for name, _ in layers))
    across = min((6, 5, 7), key=lambda many: -len(names) % many) if len(names) > 6 else len(names)
    rows = 2 * -(-len(names) // across)
    figure.set_size_inches(2.1 * across, 2.6 * rows)
    axes = figure.subplots(rows, across, squeeze=False)
    for each in axes.flat:
        each.set_axis_off()
    for k, name in enumerate(names):
        for row, target in enumerate(TARGETS):
            panel = axes[2 * (k // across) + row, k % across]
            for road in layers[name, target].roads:
                panel.add_collection(PathCollection(strips(road), facecolor="#3d7a4e", lw=0))
            panel.set(xlim=(0, SIDE), ylim=(0, SIDE), aspect="equal")
            panel.set_title(f"{name}\n{target}", fontsize=7)
    figure.tight_layout(pad=0.4)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out"))
    parser.add_argument("--only", nargs="+", choices=PATTERNS, default=list(PATTERNS))
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_enable_x64", True)
    layers = {}
    rows = ["| pattern | `[pattern]` | RMS, uniform | RMS, graded | mean, largest relative error |"]
    rows.append("|---|---|---|---|---|")
    for name in given.only:
        found = []
        for target, solid in TARGETS.items():
            with tempfile.TemporaryDirectory() as folder:
                facts, layers[name, target] = one(PATTERNS[name], solid, Path(folder))
            found.append(facts)
        # Compiled programs of many designs take more memory mappings than a process may have.
        jax.clear_caches()
        keys = ", ".join(f"{key} = {json.dumps(value)}" for key, value in PATTERNS[name].items())
        worst = max(abs(f["mean_got"] - f["mean_asked"]) / (1 - f["mean_asked"]) for f in found)
        rms = " | ".join(f"{facts['rms']:.4f}" for facts in found)
        rows.append(f"| {name} | `{keys}` | {rms} | {100 * worst:.2g} % |")
        print(rows[-1], flush=True)
    page = given.out / "catalogue.md"
    # What another command has written behind the table stays.
    behind = page.read_text().partition("\n## ") if page.exists() else ("", "", "")
    page.write_text(PAGE + "\n".join(rows) + "\n" + "".join(behind[1:]))
    figure = Figure()
    drawn(figure, layers)
    figure.savefig(given.out / "catalogue.png", dpi=110)
    with Image.open(given.out / "catalogue.png") as picture:
        few = picture.convert("RGB").quantize(8)
    few.save(given.out / "catalogue.png", optimize=True)


if __name__ == "__main__":
    main()
