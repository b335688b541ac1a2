"""A layer of very many cells, drawn, cut at the walls and put in order: time and memory.

    python tests/benchmarks/large_textures.py [--cell hexagonal] [--cells 200000]

Times are the processor's, memory is the largest of the process. The cells are as large as they can
be for roads of one edge, some 1.24 mm, to be laid.
"""

import argparse
import resource
import time
from dataclasses import replace

import jax
import numpy as np
import shapely

from fdjax.formats import profile
from fdjax.part.part import Part
from fdjax.pattern.drawings import NAMES, drawing
from fdjax.pattern.textures import Textures
from fdjax.plan.trace import lay
from fdjax.road.bead import section_area
from fdjax.target.target import expression

EDGE = 1.24
"""Of the drawing's unit, mm."""

FACES = {"square": 1, "triangular": 4, "hexagonal": 2}
"""Closed cells of the named drawings' periods."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cell", choices=[*NAMES], default="hexagonal")
    parser.add_argument("--cells", type=int, default=200_000)
    chosen = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    cell = drawing(chosen.cell)
    side = EDGE * (chosen.cells * cell.area / FACES.get(chosen.cell, 1)) ** 0.5
    part = Part.plate(shapely.box(0, 0, side, side), layers=1, height=0.2)
    solid = cell.density / EDGE * float(section_area(0.4, 0.2)) / 0.2
    limits = replace(profile.load("marlin-0.4").limits, longest_span=np.inf)
    target = expression(f"{solid:.6f}", quantity="solid")
    pattern = Textures(cell=cell).begin(part, target, limits, 50.0)

    begun = time.process_time()
    strokes = list(pattern.strokes(pattern.first))
    drawn = time.process_time()
    build = lay(iter(strokes), part, lift_length=4.0, least_road=1.0, tolerance=4e-3)
    laid = time.process_time()
    (layer,) = build.layers
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{side:.0f} mm of {chosen.cell}: {len(layer.roads)} roads, travel {layer.travel:.0f} mm")
    print(f"drawn in {drawn - begun:.1f} s, laid in {laid - drawn:.1f} s, {most:.0f} MiB")


if __name__ == "__main__":
    main()
