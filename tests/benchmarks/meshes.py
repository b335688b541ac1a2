"""Three outlines and five targets by triangles and both duals: how well the files meet them.

    python tests/benchmarks/meshes.py [--only NAME ...] [--targets NAME ...] [--cells NAME ...]
                                      [--out DIR]

Each pair is a job with default settings (80 mm parts, ten layers of 0.2 mm, five meshes), run by
the command line. What is measured is the written G-code, in windows of 5 mm, where they are and
shifted by half; angles are those of the adapted triangles, the shortest road and the shortest edge
between two nodes are the file's, the time is the processor's.
"""

import argparse
import json
import resource
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from accuracy import OUTLINES, TARGETS, run

from fdjax.formats import read_file

DUALS = "triangles", "centre-dual", "voronoi-dual"
ASKED = {name: TARGETS[name] for name in ("linear", "radial")} | {
    f"{share:.2f}": f"{share} + 0*x" for share in (0.15, 0.3, 0.5)
}
HEADER = (
    f"{'outline':10} {'target':7} {'cells':12} {'RMS':>6} {'largest':>7} {'shifted':>7}"
    f" {'largest':>7} {'mean':>8} {'angle':>6} {'median':>6} {'edge':>5} {'road':>5} {'travel':>7}"
    f" {'seconds':>7}"
)


def two_holes() -> shapely.Polygon:
    disc = shapely.Point(40, 40).buffer(40, quad_segs=45)
    for x, y in ((25, 40), (56, 46)):
        disc = disc.difference(shapely.Point(x, y).buffer(8, quad_segs=24))
    return disc


PARTS = {"square": OUTLINES["square"], "two holes": two_holes, "kidney": OUTLINES["kidney"]}


def job(outline: str, target: str, cells: str) -> str:
    return (
        f'files = ["gcode"]\n[part]\nshape = "polygon"\nwkt = "{outline}"\n'
        f'[target]\nsolid = "{target}"\ntolerance = 1\n'
        f'[pattern]\nkind = "mesh"\ncells = "{cells}"\n'
    )


def shortest(file: Path) -> tuple[float, float]:
    """The shortest segment and the shortest road of a file, mm."""
    segments, roads = [], []
    for layer in read_file(file).layers:
        for road in layer.roads:
            step = np.hypot(*np.diff(road.path, axis=0).T)
            segments.append(step.min())
            roads.append(step.sum())
    return float(min(segments)), float(min(roads))


def spent() -> float:
    """Seconds of the processor that finished children took."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    parser.add_argument("--targets", nargs="*", choices=ASKED, default=list(ASKED))
    parser.add_argument("--cells", nargs="*", choices=DUALS, default=list(DUALS))
    parser.add_argument("--out", type=Path, default=Path("out/meshes"))
    chosen = parser.parse_args(argv)
    chosen.out.mkdir(parents=True, exist_ok=True)
    print(HEADER)
    rows = []
    for name in chosen.only:
        outline = PARTS[name]()
        for target in chosen.targets:
            for cells in chosen.cells:
                path = chosen.out / f"{name}_{target}_{cells}.toml".replace(" ", "_")
                path.write_text(job(outline.wkt, ASKED[target], cells))
                folder = path.with_suffix("")
                began = spent()
                code, errors, _ = run("design", path, "--out", folder, "--quiet")
                if code:
                    print(f"{name:10} {target:7} {cells:12} exit {code}: {errors}", flush=True)
                    continue
                took = spent() - began
                report = json.loads((folder / "report.json").read_text())
                (file,) = report["files"]
                facts, mesh = report["files"][file], report["design"]["pattern"]
                mean = (facts["mean_asked"] - facts["mean_got"]) / (1 - facts["mean_asked"])
                row = (
                    facts["rms"], facts["largest"], facts["rms_windows_shifted_by_half"],
                    facts["largest_shifted"], mean, mesh["least_angle"], mesh["median_angle"],
                    *shortest(folder / file), 100 * facts["travel"] / facts["length"], took,
                )  # fmt: skip
                rows.append(row)
                print(
                    f"{name:10} {target:7} {cells:12} {row[0]:6.4f} {row[1]:7.3f} {row[2]:7.4f}"
                    f" {row[3]:7.3f} {row[4]:+8.4f} {row[5]:6.1f} {row[6]:6.1f} {row[7]:5.2f}"
                    f" {row[8]:5.2f} {row[9]:6.1f}% {row[10]:7.1f}",
                    flush=True,
                )
    table = np.abs(np.array(rows))
    worst = np.where(np.isin(np.arange(table.shape[1]), (5, 6, 7, 8)), table.min(0), table.max(0))
    for what, of in (("worst", worst), ("median", np.median(table, 0))):
        print(
            f"{what:31} {of[0]:6.4f} {of[1]:7.3f} {of[2]:7.4f} {of[3]:7.3f} {of[4]:8.4f}"
            f" {of[5]:6.1f} {of[6]:6.1f} {of[7]:5.2f} {of[8]:5.2f} {of[9]:6.1f}% {of[10]:7.1f}"
        )


if __name__ == "__main__":
    main()
