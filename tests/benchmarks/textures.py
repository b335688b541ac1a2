"""Every texture and curve, rasters of sub-domains and two materials on two outlines of 80 mm.

    python tests/benchmarks/textures.py [--only NAME ...] [--outlines NAME ...] [--targets NAME ...]
                                        [--kept FOLDER] [--page examples/catalogue.md]

What is measured is the written file, in windows of 5 mm over all layers. With `--page` the rows
take their places in the tables at the end of that page, and what was not run stays. With `--kept`
reports are kept in a folder, and what is there is not run again: for a run that was cut off.
"""

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from accuracy import TARGETS as FOUR

from fdjax.app import config
from fdjax.app.run import design
from fdjax.errors import FdjaxError
from fdjax.pattern.curve_order import NAMES as CURVES
from fdjax.pattern.drawings import NAMES as CELLS

sys.path.insert(0, str(Path(__file__).parents[1]))
from outlines import disc_with_two_holes, square

OUTLINES = {"square": square, "two holes": disc_with_two_holes}
UNIFORM = {name: name for name in ("0.15", "0.3", "0.5")}
GRADED = {name: FOUR[name] for name in ("linear", "radial")}
TARGETS = {**UNIFORM, **GRADED}
PATTERNS: dict[str, dict[str, Any]] = {
    **{name: {"kind": "texture", "cell": name} for name in CELLS},
    "truchet, wind 2": {
        "kind": "texture", "cell": {"base": "truchet", "rule": "wind", "order": 2},
    },
    **{name: {"kind": "curve", "curve": name} for name in CURVES},
}  # fmt: skip
SUBDOMAINS: dict[str, dict[str, Any]] = {
    "whole": {},
    "grid": {"domains": {"grid": [3, 2]}, "angles": [0, 45, 90]},
    "sites": {
        "domains": {"sites": [[15, 20], [30, 62], [52, 18], [66, 58], [44, 40]]},
        "angles": [0, 30, 60],
        "fills": ["raster", "contour"],
        "perimeters": 0,
    },
    "levels": {"domains": {"levels": [0.25, 0.4]}, "road_widths": [0.4, 0.45]},
}
PAPERS = "cos(x/1000)*sin(3*y/2000)"
MATERIALS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "wave, split": (
        {"kind": "texture", "cell": "wave"},
        {"function": PAPERS, "unit": "microstep", "split": True},
    ),
    "hilbert, split": (
        {"kind": "curve"},
        {"function": "sin(2*pi*x/30)*cos(2*pi*y/30)", "split": True},
    ),
    "polygons, function": (
        {"kind": "mesh", "cells": "centre-dual", "laid": "polygons"},
        {"function": PAPERS, "unit": "microstep"},
    ),
    "polygons, share 0.3": (
        {"kind": "mesh", "cells": "centre-dual", "laid": "polygons"},
        {"share": 0.3},
    ),
    "isolines, share 0.3": ({"kind": "isolines"}, {"share": 0.3}),
    "square, share 0.3": ({"kind": "texture", "cell": "square"}, {"share": 0.3}),
    "hilbert, share 0.3": ({"kind": "curve"}, {"share": 0.3}),
}
FILES: dict[str, dict[str, Any]] = {
    "gcode": {"machine": "marlin-0.4-dual"},
    "sml": {
        "machine": "stratasys-fdm1650",
        "part": {"layer_height": "0.010in"},
        "design": {"span_limit": False},
    },
}
KEYS = {"pattern": 2, "sub-domains": 2, "materials": 3}
"""The tables by the first word of their heads, and the cells that a row is known by."""

KEPT: Path | None = None
HEADING = "\n## On 80 mm\n"


def written(
    outline: str, target: str, pattern: dict[str, Any], kind: str = "gcode", **more: Any
) -> dict[str, Any] | str:
    """What the report says of the written file, with its pattern, or why there is none."""
    tables = {
        "files": [kind],
        "part": {"shape": "polygon", "wkt": OUTLINES[outline]().wkt, **more.pop("part", {})},
        "target": {"solid": target, "tolerance": 1.0},
        "pattern": pattern,
        **more,
    }
    name = hashlib.sha256(json.dumps(tables).encode()).hexdigest()[:16]
    kept = None if KEPT is None else KEPT / f"{name}.json"
    if kept is not None and kept.exists():
        return json.loads(kept.read_text())
    found = _found(tables)
    if kept is not None:
        kept.write_text(json.dumps(found))
    return found


def _found(tables: dict[str, Any]) -> dict[str, Any] | str:
    with tempfile.TemporaryDirectory() as folder:
        try:
            design(config.parse(tables, name="one"), Path(folder), progress=lambda text: None)
        except FdjaxError as fault:
            return str(fault)
        report = json.loads((Path(folder) / "report.json").read_text())
    (facts,) = report["files"].values()
    return facts | report["design"]["pattern"]


def off(facts: dict[str, Any]) -> float:
    """By how much the mean is off, as a share of the solid share that is asked."""
    return abs(facts["mean_got"] - facts["mean_asked"]) / (1 - facts["mean_asked"])


def told(row: Sequence[str]) -> str:
    line = f"| {' | '.join(row)} |"
    print(line, flush=True)
    return line


def drawings(
    names: Sequence[str], outlines: Sequence[str], targets: Sequence[str]
) -> Iterator[str]:
    """Textures and curves: the mean of uniform targets, the RMS of graded ones."""
    yield told([
        "pattern", "outline", *(f"mean off, {name}" for name in UNIFORM),
        *(f"RMS, {name}" for name in GRADED), "largest", "roads",
    ])  # fmt: skip
    yield told(["---"] * (4 + len(TARGETS)))
    for name in names:
        for outline in outlines:
            found = {
                target: written(outline, TARGETS[target], PATTERNS[name]) for target in targets
            }
            good = {target: facts for target, facts in found.items() if isinstance(facts, dict)}
            cells = [
                _shown(target, good[target]) if target in good else str(found.get(target, "-"))
                for target in TARGETS
            ]
            largest = [f"{facts['largest']:.3f}" for facts in good.values()]
            roads = [str(facts["most_roads_in_a_layer"]) for facts in good.values()]
            most = (max(each, key=float, default="-") for each in (largest, roads))
            yield told([name, outline, *cells, *most])


def _shown(target: str, facts: dict[str, Any]) -> str:
    return f"{100 * off(facts):.2g} %" if target in UNIFORM else f"{facts['rms']:.4f}"


def rasters(outlines: Sequence[str], targets: Sequence[str]) -> Iterator[str]:
    """Rasters: the mean of each sub-domain."""
    yield told(["sub-domains", "outline", "how many", "mean off in the worst", "by target"])
    yield told(["---"] * 5)
    for name, pattern in SUBDOMAINS.items():
        for outline in outlines:
            worst: dict[str, float] = {}
            count = 0
            failed = ""
            for target in targets:
                if name == "levels" and target not in GRADED:
                    continue
                facts = written(outline, TARGETS[target], {"kind": "rasters", **pattern})
                if isinstance(facts, str):
                    failed += f" {target}: {facts}"
                    continue
                asked = np.array([each["solid_asked"] for each in facts["subdomains"]])
                got = np.array(facts["subdomains_solid_got"])
                worst[target] = float(np.abs(got / asked - 1).max())
                count = len(asked)
            shown = ", ".join(f"{target} {100 * each:.2g} %" for target, each in worst.items())
            most = f"{100 * max(worst.values(), default=np.nan):.2g} %"
            yield told([name, outline, str(count), most, shown + failed])


def materials(outlines: Sequence[str]) -> Iterator[str]:
    """Two materials: the share that is laid of the second, and the changes."""
    yield told(["materials", "outline", "file", "asked", "laid", "changes", "layers", "wrong"])
    yield told(["---"] * 8)
    for name, (pattern, way) in MATERIALS.items():
        for outline in outlines:
            for kind, more in FILES.items():
                facts = written(outline, GRADED["linear"], pattern, kind, materials=way, **more)
                if isinstance(facts, str):
                    yield told([name, outline, kind, facts, "", "", "", ""])
                    continue
                laid = facts["materials"]
                yield told([
                    name, outline, kind, f"{laid['asked'][1]:.4f}", f"{laid['got'][1]:.4f}",
                    str(laid["changes"]), str(facts["layers"]), str(laid.get("wrong", "-")),
                ])  # fmt: skip


def merged(page: str, tables: Sequence[Sequence[str]]) -> list[list[str]]:
    """The tables of a page with the rows of these in their places; what was not run is as before.

    Where only some targets of a drawing were run, the cells of others stay, and of the largest
    error and the number of roads the larger.
    """
    found: dict[str, tuple[list[list[str]], dict[tuple[str, ...], list[str]]]] = {}
    blocks = [block.splitlines() for block in page.split("\n\n") if block.startswith("|")]
    for block in (*blocks, *tables):
        head, under, *rows = (
            [cell.strip() for cell in line.strip("|").split("|")] for line in block
        )
        _, known = found.setdefault(head[0], ([head, under], {}))
        for row in rows:
            key = tuple(row[: KEYS[head[0]]])
            known[key] = _joined(known[key], row) if head[0] == "pattern" and key in known else row
    order = [*PATTERNS, *SUBDOMAINS, *MATERIALS]
    return [
        [f"| {' | '.join(row)} |" for row in (*top, *sorted(rows, key=lambda r: order.index(r[0])))]
        for top, rows in (
            (found[name][0], found[name][1].values()) for name in KEYS if name in found
        )
    ]


def _joined(old: Sequence[str], new: Sequence[str]) -> list[str]:
    if "-" not in new:
        return list(new)
    row = [before if now == "-" else now for before, now in zip(old, new, strict=True)]
    for k in (-2, -1):
        row[k] = max((each for each in (old[k], new[k]) if each != "-"), key=float, default="-")
    return row


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=[*PATTERNS, "rasters", "materials"])
    parser.add_argument("--outlines", nargs="*", choices=OUTLINES, default=list(OUTLINES))
    parser.add_argument("--targets", nargs="*", choices=TARGETS, default=list(TARGETS))
    parser.add_argument("--page", type=Path)
    parser.add_argument("--kept", type=Path)
    chosen = parser.parse_args(argv)
    global KEPT
    KEPT = chosen.kept
    if KEPT is not None:
        KEPT.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_enable_x64", True)
    only = [*PATTERNS, "rasters", "materials"] if chosen.only is None else chosen.only
    tables = []
    if names := [name for name in PATTERNS if name in only]:
        tables.append(list(drawings(names, chosen.outlines, chosen.targets)))
    if "rasters" in only:
        tables.append(list(rasters(chosen.outlines, chosen.targets)))
    if "materials" in only:
        tables.append(list(materials(chosen.outlines)))
    if chosen.page is not None:
        before, _, behind = chosen.page.read_text(encoding="utf-8").partition(HEADING)
        text = "\n\n".join("\n".join(table) for table in merged(behind, tables))
        chosen.page.write_text(f"{before}{HEADING}\n{INTRODUCTION}\n{text}\n", encoding="utf-8")


INTRODUCTION = """An 80 mm square and a disc of 80 mm with two holes, ten layers of 0.2 mm, roads of
0.4 mm; solid shares 0.15, 0.3, 0.5, linear and radial from 0.15 to 0.5. The mean is off as a share
of what is asked, `largest` is the largest error of a window and `roads` are the most in a layer;
"-" was not run. Written by `python tests/benchmarks/textures.py --page examples/catalogue.md`; one
row alone with `--only NAME --outlines NAME` beside.
"""


if __name__ == "__main__":
    main()
