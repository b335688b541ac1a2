"""Five outlines and three targets by lines that follow the boundary, and by `kind = "auto"`.

    python tests/benchmarks/structured.py [--only NAME ...] [--targets NAME ...] [--kinds NAME ...]
                                          [--out DIR]

Each pair is a job, run by the command line. What is measured is the written G-code, in windows of
5 mm, where they are and shifted by half. A job of kind "auto" says of each kind that it tried what
its file reaches; other kinds, by request, are jobs of their own.
"""

import argparse
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from accuracy import TARGETS, run

from fdjax.part.part import Part
from fdjax.pattern.auto import TRIED, Auto

sys.path.insert(0, str(Path(__file__).parents[1]))
from outlines import OUTLINES

NAMES = "disc", "ring", "L", "three holes", "insole"
ASKED = "linear", "radial", "checker"
KINDS = (*(name for name in TRIED if name != "isolines"), "auto")
HEADER = (
    f"{'outline':12} {'target':8} {'kind':14} {'RMS':>7} {'shifted':>8} {'mean':>8} {'roads':>6}"
    f" {'travel':>7}"
)


def job(outline: str, target: str, kind: str) -> str:
    pattern = f'kind = "{kind}"'
    design = ""
    if kind not in ("auto", "blocks"):
        pattern, design = f'map = "{kind}"', '[design]\ncontrols = ["spacing_field"]\n'
    return (
        f'files = ["gcode"]\n[part]\nshape = "polygon"\nwkt = "{outline}"\n'
        f'[target]\nsolid = "{target}"\ntolerance = 1\n[pattern]\n{pattern}\n{design}'
    )


def _reached(note: str) -> tuple[str, float] | None:
    """The kind that a note of "auto" is of and its RMS error, where it was laid without errors."""
    found = re.fullmatch(r"tried (\S+): RMS (\S+), shifted \S+ in its file", note)
    return found and (found[1], float(found[2]))


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Lines that follow the boundary, and auto.")
    parser.add_argument("--only", nargs="*", choices=NAMES, default=list(NAMES))
    parser.add_argument("--targets", nargs="*", choices=ASKED, default=list(ASKED))
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=["auto"])
    parser.add_argument("--out", type=Path, default=Path("out/structured"))
    chosen = parser.parse_args(argv)
    chosen.out.mkdir(parents=True, exist_ok=True)
    print(HEADER)
    best: dict[tuple[str, str], float] = {}
    of_auto: list[float] = []
    for name in chosen.only:
        outline = OUTLINES[name]()
        suits = [kind for kind, _ in Auto().candidates(Part.plate(outline))]
        for target in chosen.targets:
            for kind in (each for each in chosen.kinds if each in (*suits, "auto")):
                path = chosen.out / f"{name}_{target}_{kind}.toml".replace(" ", "_")
                path.write_text(job(outline.wkt, TARGETS[target], kind))
                folder = path.with_suffix("")
                code, errors, _ = run("design", path, "--out", folder, "--quiet")
                if code:
                    print(f"{name:12} {target:8} {kind:14} exit {code}: {errors}", flush=True)
                    continue
                report = json.loads((folder / "report.json").read_text())
                (facts,) = report["files"].values()
                mean = (facts["mean_asked"] - facts["mean_got"]) / (1 - facts["mean_asked"])
                print(
                    f"{name:12} {target:8} {kind:14} {facts['rms']:7.4f}"
                    f" {facts['rms_windows_shifted_by_half']:8.4f} {mean:+8.4f}"
                    f" {facts['most_roads_in_a_layer']:6d}"
                    f" {100 * facts['travel'] / facts['length']:6.2f}%",
                    flush=True,
                )
                reached = {kind: facts["rms"]}
                if kind == "auto":
                    of_auto.append(facts["rms"])
                    print("\n".join(f"    {note}" for note in report["notes"]), flush=True)
                    reached = dict(filter(None, map(_reached, report["notes"])))
                for own, rms in reached.items():
                    if own != "isolines":
                        best[name, target] = min(best.get((name, target), np.inf), rms)
    for what, values in (("best that follows", list(best.values())), ("auto", of_auto)):
        if values:
            print(
                f"{what:36} worst {max(values):.4f}, median {np.median(values):.4f} of"
                f" {len(values)} pairs"
            )


if __name__ == "__main__":
    main()
