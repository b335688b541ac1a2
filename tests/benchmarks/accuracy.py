"""Ten outlines and four targets by isolines: how well the written G-code meets them, how fast.

    python tests/benchmarks/accuracy.py [--only NAME ...] [--targets NAME ...] [--out DIR]

Each pair is a job with default settings, run by the command line twice; the second run is timed.
What is measured is the file: by `fdjax measure`, and by a reader in this script that knows nothing
of roads, which sums E over windows.
"""

import argparse
import json
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from shapely import STRtree

from fdjax.formats import read_file
from fdjax.plan.segments import Segments
from fdjax.plan.spacing import approaches
from fdjax.target.expression import Expression

sys.path.insert(0, str(Path(__file__).parents[1]))
from outlines import OUTLINES

TARGETS = {
    "linear": "0.15+0.35*x/80",
    "radial": "0.5-0.35*min(1,hypot(x-40,y-40)/40)",
    "checker": "0.325+0.175*sin(pi*x/40)*sin(pi*y/40)",
    "two bumps": (
        "0.15+0.35*exp(-((x-25)**2+(y-30)**2)/15**2)+0.3*exp(-((x-55)**2+(y-55)**2)/12**2)"
    ),
    "step": "where(x<40,0.15,0.45)",
}
HEADER = (
    f"{'outline':12} {'target':10} {'RMS':>7} {'largest':>8} {'shifted':>8} {'largest':>8}"
    f" {'mean':>8} {'E sums':>7} {'roads':>6} {'travel':>7} {'close':>7} {'second run':>10}"
)


def job(outline: str, target: str) -> str:
    part = f'[part]\nshape = "polygon"\nwkt = "{outline}"\n'
    return f'{part}[target]\nsolid = "{target}"\ntolerance = 1\n'


def run(*arguments: object) -> tuple[int, str, float]:
    """Exit code, errors and seconds of a command of fdjax."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "fdjax", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    return done.returncode, done.stderr.strip(), time.perf_counter() - began


def close_share(file: Path) -> float:
    """Share of the length that lies nearer to another road than it is wide, turns left out."""
    length = close = 0.0
    for layer in read_file(file).layers:
        segments = Segments.of(layer.roads)
        pairs = segments.near_pairs(STRtree(segments.boxes(float(segments.width.max()) / 2)))
        found = approaches(segments, *pairs, None, 0.02)
        close += float(segments.length[np.union1d(found.i, found.j)].sum())
        length += float(segments.length.sum())
    return close / length


def deposits(text: str, filament: float = 1.75) -> np.ndarray:
    """Volumes by E, in pieces of at most 0.1 mm: x, y, volume, (n, 3); E relative."""
    x = y = 0.0
    pieces = []
    begun = False
    for line in text.splitlines():
        begun |= line.startswith("; fdjax layer") or ";LAYER" in line
        word = {k: float(v) for k, v in re.findall(r"([XYZE])(-?[\d.]+)", line.split(";")[0])}
        if not line.startswith(("G0", "G1")):
            continue
        to_x, to_y = word.get("X", x), word.get("Y", y)
        if begun and word.get("E", 0) > 0 and (to_x, to_y) != (x, y):
            count = int(np.ceil(np.hypot(to_x - x, to_y - y) / 0.1))
            share = (np.arange(count) + 0.5) / count
            volume = word["E"] * np.pi / 4 * filament**2 / count
            pieces.append(np.stack([
                x + share * (to_x - x), y + share * (to_y - y), np.full(count, volume)
            ], 1))  # fmt: skip
        x, y = to_x, to_y
    return np.concatenate(pieces)


def rms_by_sums(
    pieces: np.ndarray, outline: shapely.Geometry, solid: str, origin: np.ndarray
) -> float:
    """RMS error of the solid share in 5 mm windows at least half inside, heights of 2 mm."""
    x0, y0, x1, y1 = outline.bounds
    edges = [np.arange(a, b + 5 - 1e-6, 5.0) for a, b in ((x0, x1), (y0, y1))]
    xy = pieces[:, :2] - origin
    volume = np.histogram2d(xy[:, 0], xy[:, 1], edges, weights=pieces[:, 2])[0]
    total = weight = 0.0
    for i, left in enumerate(edges[0][:-1]):
        for j, low in enumerate(edges[1][:-1]):
            inside = outline.intersection(shapely.box(left, low, left + 5, low + 5))
            if inside.area < 12.5 - 1e-6:
                continue
            fine = np.arange(0.125, 5, 0.25)
            xx, yy = np.meshgrid(left + fine, low + fine)
            held = shapely.contains_xy(inside, xx, yy)
            asked = np.broadcast_to(Expression(solid)(xx, yy), xx.shape)[held].mean()
            total += inside.area * (volume[i, j] / (inside.area * 2) - asked) ** 2
            weight += inside.area
    return float(np.sqrt(total / weight))


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=OUTLINES, default=list(OUTLINES))
    parser.add_argument("--targets", nargs="*", choices=TARGETS, default=list(TARGETS)[:4])
    parser.add_argument("--out", type=Path, default=Path("out/outlines"))
    chosen = parser.parse_args(argv)
    chosen.out.mkdir(parents=True, exist_ok=True)
    print(HEADER)
    rows = []
    for name in chosen.only:
        outline = OUTLINES[name]()
        for target in chosen.targets:
            path = chosen.out / f"{name}_{target}.toml".replace(" ", "_")
            path.write_text(job(outline.wkt, TARGETS[target]))
            folder = path.with_suffix("")
            run("design", path, "--out", folder, "--quiet")
            code, errors, seconds = run("design", path, "--out", folder, "--quiet")
            if code:
                print(f"{name:12} {target:10} exit {code}: {errors.strip()}", flush=True)
                continue
            report = json.loads((folder / "report.json").read_text())
            file = folder / f"{path.stem}.gcode"
            facts = report["files"][file.name]
            text = file.read_text()
            _, x, y = re.search(r"fdjax (origin) = (\S+) (\S+)", text).groups()
            origin = np.array([float(x), float(y)])
            sums = rms_by_sums(deposits(text), outline, TARGETS[target], origin)
            mean = (facts["mean_asked"] - facts["mean_got"]) / (1 - facts["mean_asked"])
            row = (
                facts["rms"], facts["largest"], facts["rms_windows_shifted_by_half"],
                facts["largest_shifted"], mean, sums, facts["most_roads_in_a_layer"],
                100 * facts["travel"] / facts["length"], 100 * close_share(file), seconds,
            )  # fmt: skip
            rows.append(row)
            print(
                f"{name:12} {target:10} {row[0]:7.4f} {row[1]:8.3f} {row[2]:8.4f} {row[3]:8.3f}"
                f" {row[4]:+8.4f} {row[5]:7.4f} {row[6]:6d} {row[7]:6.2f}% {row[8]:6.2f}%"
                f" {row[9]:8.1f} s",
                flush=True,
            )
    table = np.abs(np.array(rows))
    for what, of in (("worst", table.max(0)), ("median", np.median(table, 0))):
        print(
            f"{what:23} {of[0]:7.4f} {of[1]:8.3f} {of[2]:8.4f} {of[3]:8.3f} {of[4]:8.4f}"
            f" {of[5]:7.4f} {of[6]:6.1f} {of[7]:6.2f}% {of[8]:6.2f}% {of[9]:8.1f} s"
        )


if __name__ == "__main__":
    main()
