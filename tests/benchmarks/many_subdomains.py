"""Thousands of sub-domains with rasters, by a grid and around sites: time, and the mean of each.

    python tests/benchmarks/many_subdomains.py [--grid 50] [--sites 2000] [--side 200]

A whole job with its G-code, which is what is measured. Times are the processor's, of this process.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

from fdjax.app import config
from fdjax.app.run import design


def measured(side: float, domains: dict[str, Any]) -> str:
    tables = {
        "files": ["gcode"],
        "part": {"shape": "rectangle", "size": [side, side]},
        "target": {"solid": "0.3", "tolerance": 1.0},
        "pattern": {"kind": "rasters", "domains": domains, "angles": [0, 45, 90], "perimeters": 0},
    }
    with tempfile.TemporaryDirectory() as folder:
        begun = time.process_time()
        design(config.parse(tables, name="many"), Path(folder), progress=lambda text: None)
        spent = time.process_time() - begun
        report = json.loads((Path(folder) / "report.json").read_text())
    asked = np.array([each["solid_asked"] for each in report["design"]["pattern"]["subdomains"]])
    got = np.array(report["files"]["many.gcode"]["subdomains_solid_got"])
    off = float(np.abs(got / asked - 1).max())
    return f"{len(asked)} sub-domains, mean off by {100 * off:.2g} % in the worst, {spent:.1f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--grid", type=int, default=50, help="columns and rows")
    parser.add_argument("--sites", type=int, default=2000)
    parser.add_argument("--side", type=float, default=200.0, help="of the part, mm")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if given.grid:
        print("grid:", measured(given.side, {"grid": [given.grid, given.grid]}), flush=True)
    if given.sites:
        # One in each cell of a lattice, so that no two are near each other.
        across = int(np.ceil(given.sites**0.5))
        cell = np.arange(given.sites)
        at = np.stack([cell % across, cell // across], 1) + 0.5
        at += np.random.default_rng(3).uniform(-0.3, 0.3, at.shape)
        sites = (at * given.side / across).round(3).tolist()
        print("sites:", measured(given.side, {"sites": sites}), flush=True)


if __name__ == "__main__":
    main()
