"""Four targets on the paper's eq. (8) domain: what the model reaches, and what the SML file has.

Run it with `python examples/cosine_targets.py [TARGET ...]`; each design takes some ten seconds
after compiling. The model's error is that of the cells' own porosity, weighted by volume; the
file's is measured from SML, read back, in 0.3 in windows and in the same shifted by half a window.
"""

import os
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import jax.numpy as jnp

import fdjax
from fdjax.formats import sml

jax.config.update("jax_enable_x64", True)

TARGETS = {
    "linear": "0.45 + 0.3*(x - 100)/3000",
    "dip": "0.72 - 0.20*exp(-((x - 1600)**2 + (y - 1500)**2)/700**2)",
    "waves": "0.65 + 0.1*sin(x/500)*cos(y/600)",
    "constant": "0.65",
}
INCH = 25.4
WINDOW = 0.3 * INCH
PART = fdjax.Part.plate(fdjax.cosine_top(), layers=10, height=0.010 * INCH)


def designed(target, objective: str, machine, span_limit: bool = False):
    """The eq. (8) domain with 51 x 31 lines; spans as long as they need to be by default."""
    return fdjax.design(
        PART,
        target,
        limits=machine.limits,
        pattern=fdjax.MapLines(
            map="elliptic",
            lines=(51, 31),
            road_width=0.028 * INCH,
            nodes=(33, 25),
            controls=("spacing", "phi", "psi", "width"),
            knots=10 if objective == "cells" else None,
        ),
        window=WINDOW,
        objective=objective,
        smoothness=3e-5 if objective == "cells" else 1e-4,
        iterations=80,
        patience=0.01 if objective == "cells" else 0.05,
        span_limit=span_limit,
    )


def model_error(design, target) -> tuple[float, float]:
    """RMS, weighted by volume, and largest error of the cells' porosity."""
    pattern = design.pattern
    xyz, porosity, volume = pattern.cells(pattern.realise(design.controls))
    error = porosity - target(*xyz.T)
    return float(jnp.sqrt((error**2 * volume).sum() / volume.sum())), float(jnp.abs(error).max())


def file_error(design, target, machine) -> tuple[float, float]:
    """RMS error measured in the SML text, in windows as they lie and shifted by half."""
    build = fdjax.lay(
        design.strokes(),
        PART,
        lift_length=machine.lift_length,
        tolerance=6e-3,
        clearance=0.024,
    )
    build = fdjax.trim(build, design.volume).replace(origin=(50.0, 50.0))
    read = sml.read(sml.write(build, machine), machine=machine)
    return tuple(
        fdjax.compare(fdjax.measure(read, window=WINDOW, shift=(s, s)), target).rms
        for s in (0.0, 0.5)
    )


def main() -> None:
    machine = fdjax.load_machine("stratasys-fdm1650")
    print(
        f"{'target':10}{'model RMS':>11}{'largest':>9}{'s':>7}{'SML RMS':>10}{'shifted':>9}{'s':>7}"
        f"{'model RMS with spans limited':>31}"
    )
    for name in sys.argv[1:] or TARGETS:
        target = fdjax.expression(TARGETS[name], unit="mil")
        began = time.perf_counter()
        cells = designed(target, "cells", machine)
        rms, largest = model_error(cells, target)
        between = time.perf_counter()
        windows = designed(target, "windows", machine)
        plain, shifted = file_error(windows, target, machine)
        ended = time.perf_counter()
        limited, _ = model_error(designed(target, "cells", machine, span_limit=True), target)
        print(
            f"{name:10}{rms:11.5f}{largest:9.4f}{between - began:7.1f}{plain:10.5f}{shifted:9.5f}"
            f"{ended - between:7.1f}{limited:31.5f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
