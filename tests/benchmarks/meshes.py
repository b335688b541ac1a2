"""Three outlines and five targets by triangles and both duals: how well the files meet them.

    python tests/benchmarks/meshes.py [--only NAME ...] [--targets NAME ...] [--cells NAME ...]
                                      [--out DIR] [--large]

Each pair is a job with default settings (80 mm parts, ten layers of 0.2 mm, five meshes), run by
the command line. What is measured is the written G-code, in windows of 5 mm, where they are and
shifted by half; angles are those of the adapted triangles, the shortest road and the shortest edge
between two nodes are the file's, the time is the processor's. With --large instead: travel over a
dual of 10,000 edges beside that of going to the nearest edge, 50,000 roads planned, checked and
written, and a design of about 10,000 edges, the second of two.
"""

import argparse
import json
import resource
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import shapely
from accuracy import OUTLINES, TARGETS, run

from fdjax.formats import module, profile, read_file
from fdjax.mesh.dual import centre_points
from fdjax.mesh.size import SizeField
from fdjax.mesh.triangulation import relaxed
from fdjax.optimise.design import design
from fdjax.part.part import Part
from fdjax.pattern.mesh import Mesh
from fdjax.plan.check import check
from fdjax.plan.toolpath import Layer
from fdjax.plan.trace import lay
from fdjax.plan.trail import lay_graph
from fdjax.road.stroke import Graph
from fdjax.target.target import expression

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


def dual_of(side: float, edges: int) -> Graph:
    """The centre-point dual of a uniform mesh of a square, of about so many edges."""
    region = shapely.box(0, 0, side, side)
    size = side * np.sqrt(2 * np.sqrt(3) / edges)
    mesh = relaxed(SizeField.over(region, lambda x, y: size + 0 * x))
    inside = shapely.contains_xy(region, *mesh.xy[mesh.triangles].mean(1).T)
    mesh = mesh.part(inside)
    ends = mesh.beside[mesh.inner]
    return Graph(centre_points(mesh.xy, mesh.triangles), ends, np.full(len(ends), 0.4), "mesh")


def nearest_first(graph: Graph) -> float:
    """Travel, mm, of going on with the nearest edge that is left."""
    ends = graph.xy[graph.edges]
    left = np.ones(len(ends), bool)
    at, total = ends[0, 1], 0.0
    left[0] = False
    for _ in range(len(ends) - 1):
        gap = np.hypot(*np.moveaxis(ends - at, -1, 0))
        gap[~left] = np.inf
        edge, end = np.unravel_index(np.argmin(gap), gap.shape)
        total += gap[edge, end]
        left[edge] = False
        at = ends[edge, 1 - end]
    return float(total)


def large(folder: Path) -> None:
    jax.config.update("jax_enable_x64", True)
    graph = dual_of(80, 10_000)
    room = shapely.box(-1, -1, 81, 81)
    began = time.process_time()
    roads = lay_graph(graph, room).roads
    took = time.process_time() - began
    travel = Layer(0.2, 0.2, roads, room).travel
    greedy = nearest_first(graph)
    print(
        f"{len(graph.edges)} edges: {len(roads)} roads in {took:.1f} s, travel {travel:.0f} mm,"
        f" {travel / greedy:.3f} of the nearest first"
    )
    part = Part.plate(shapely.box(-1, -1, 161, 161), layers=10)
    dual = dual_of(160, 15_500)
    began = time.process_time()
    # Layers that are the same objects are laid once: these are not.
    layers = [[replace(dual, xy=dual.xy + 1e-3 * k)] for k in range(len(part.slabs))]
    build = lay(layers, part, lift_length=4.0, least_road=1.0, tolerance=4e-3, clearance=5e-3)
    machine = profile.load("marlin-0.4")
    build = build.replace(origin=(20.0, 20.0))
    found = check(build, machine.limits)
    gcode = module(folder / "large.gcode")
    fit = gcode.fit(build, machine)
    (folder / "large.gcode").write_text(gcode.write(fit, machine), encoding="utf-8")
    took = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    errors = sum(each.severity == "error" for each in found)
    count = sum(len(layer.roads) for layer in build.layers)
    print(f"{count} roads laid, checked ({errors} errors), written in {took:.1f} s, {peak:.2f} GiB")
    part, target = Part.plate(PARTS["kidney"]()), expression(ASKED["0.30"], quantity="solid")
    for _ in range(2):
        began = time.process_time()
        result = design(part, target, limits=machine.limits, pattern=Mesh(cells="centre-dual"))
        took = time.process_time() - began
    edges, model = result.pattern.facts(result.controls)["edges"], result.outcome.error
    print(f"design of {edges} edges: {took:.1f} s, {result.steps} steps, model RMS {model:.4f}")


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    parser.add_argument("--targets", nargs="*", choices=ASKED, default=list(ASKED))
    parser.add_argument("--cells", nargs="*", choices=DUALS, default=list(DUALS))
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("out/meshes"))
    chosen = parser.parse_args(argv)
    chosen.out.mkdir(parents=True, exist_ok=True)
    if chosen.large:
        large(chosen.out)
        return
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
