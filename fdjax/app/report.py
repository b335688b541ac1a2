"""What came out of a job: the files as they were read back, what is wrong, report and table."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fdjax.app.config import Job
from fdjax.app.writing import FAINT
from fdjax.formats.profile import Machine
from fdjax.optimise.design import Design
from fdjax.plan.check import Finding
from fdjax.plan.compare import Comparison
from fdjax.plan.measure import Measurement
from fdjax.plan.toolpath import Build


@dataclass(frozen=True, eq=False)
class Written:
    """One machine file as it was read back: `measurement` and `comparison` are of the file,
    `shifted` of the same in windows shifted by half; `planned` is the plan's volume, and `thinned`
    that of lines left out of it, mm^3; `count`: what was counted, and `by_volume` the comparison of
    the volume where that is another; `materials` is what was laid of two, as `Materials.laid`;
    `subdomains`: solid share that was got in each of them; `scaled`: share by which the volume of
    the roads was changed by their sections, to meet the mean.
    """

    path: Path
    machine: Machine
    build: Build
    planned: float
    thinned: float
    findings: tuple[Finding, ...]
    measurement: Measurement
    comparison: Comparison
    shifted: Comparison
    coverage: float
    count: str
    by_volume: Comparison | None = None
    materials: dict[str, Any] | None = None
    subdomains: tuple[float, ...] = ()
    scaled: float = 0.0

    @property
    def errors(self) -> list[Finding]:
        return [finding for finding in self.findings if finding.severity == "error"]


def faults_of(job: Job, result: Design, written: list[Written]) -> list[tuple[Path | None, str]]:
    """What is wrong, in one phrase each, with the file it concerns or None for the design."""
    faults: list[tuple[Path | None, str]] = []
    if not result.made:
        faults.append((None, "the grid folds or its solve did not converge"))
    for each in written:
        whole = each.thinned + each.planned
        if not each.planned > 0:
            faults.append((each.path, f"{each.path.name}: holds no road"))
        if each.thinned > job.design.left_out * whole:
            share = 100 * each.thinned / whole
            least = each.machine.limits.least_road
            short = f"shorter than the machine's {least:.3g} mm" if least else "too short"
            what = f"{each.path.name}: roads too close or {short}, {share:.1f} % left out"
            faults.append((each.path, f"{what}, {100 * job.design.left_out:g} % is allowed"))
        rms = each.comparison.rms
        if not rms <= job.target.tolerance:
            what = f"{each.path.name} misses its target: RMS {rms:.4f} in {job.target.window:g} mm"
            what = f"{what} windows, {job.target.tolerance:g} is allowed"
            limits = [*result.limited_by, *_single_roads(result, rms)]
            why = f" (limited by {' and '.join(limits)})" if limits else ""
            faults.append((each.path, what + why))
        faults += [(each.path, f"{each.path.name}: {what}") for what in _uneven(result, each)]
        for finding in each.errors:
            faults.append((each.path, f"{each.path.name}: {finding}"))
    return faults


def _single_roads(result: Design, rms: float) -> list[str]:
    """In words, where a file misses by more than its model: windows hold so few of its roads."""
    if not rms > LUMPY * result.outcome.error:
        return []
    return [
        f"single roads, where their mean would miss by {result.outcome.error:.2g}: more layers or "
        "phases, narrower roads or a wider target.window even them out"
    ]


LUMPY = 1.5
"""A file whose error is as many times that of its model misses for its single roads."""


def _uneven(result: Design, each: Written) -> list[str]:
    """Sub-domains whose mean is not the one that was asked, where the target sets it."""
    some = result.pattern.facts(result.controls).get("subdomains", ())
    return [
        f"sub-domain {number}: a mean solid share of {fact['solid_asked']:.4f} is asked, and "
        f"{got:.4f} is laid"
        for number, (fact, got) in enumerate(zip(some, each.subdomains, strict=False), 1)
        if fact["by_target"] and abs(got / fact["solid_asked"] - 1) > UNEVEN
    ]


UNEVEN = 0.005
"""Share by which the mean of a sub-domain may be off."""


def scaled_sections(job: Job, written: list[Written]) -> list[str]:
    """Notes on files whose roads are clearly not as wide as the job says."""
    if job.pattern.width_is_free:
        return []
    return [
        f"{each.path.name}: sections are changed by {100 * each.scaled:+.1f} %, to meet the mean"
        for each in written
        if abs(each.scaled) > FAINT
    ]


def report_of(
    job: Job,
    result: Design,
    written: list[Written],
    faults: list[tuple[Path | None, str]],
    notes: list[str],
) -> dict[str, Any]:
    """Every number of a design and of its files, ready for JSON."""
    return {
        "name": job.name,
        "ok": not faults,
        "faults": [what for _, what in faults],
        "notes": notes,
        "design": {
            "made": result.made,
            "converged": result.outcome.converged,
            "steps": result.steps,
            "seconds": round(result.seconds, 3),
            "model_rms": result.outcome.error,
            "limits_broken": result.broken,
            "limited_by": result.limited_by,
            "road_width": list(result.road_width),
            "pattern": result.pattern.facts(result.controls),
        },
        "files": {each.path.name: _facts(each) for each in written},
    }


def _facts(each: Written) -> dict[str, Any]:
    comparison, build = each.comparison, each.build
    facts: dict[str, Any] = {
        "machine": each.machine.name,
        "unverified": list(each.machine.unverified),
        "window": float(each.measurement.x[1] - each.measurement.x[0]),
        "count": each.count,
        "mean_asked": comparison.mean_asked,
        "mean_got": comparison.mean_got,
        "rms": comparison.rms,
        "largest": comparison.largest,
        "rms_windows_shifted_by_half": each.shifted.rms,
        "largest_shifted": each.shifted.largest,
        "coverage": each.coverage,
        "volume": build.volume,
        "volume_planned": each.planned,
        "sections_scaled": each.scaled,
        "layers": len(build.layers),
        "roads": sum(len(layer.roads) for layer in build.layers),
        "most_roads_in_a_layer": max((len(layer.roads) for layer in build.layers), default=0),
        "length": sum(road.length for layer in build.layers for road in layer.roads),
        "travel": sum(layer.travel for layer in build.layers),
        "thinned": each.thinned,
        "findings": [
            {"severity": f.severity, "kind": f.kind, "count": f.count, "message": str(f)}
            for f in each.findings
        ],
    }
    if each.by_volume is not None:
        own = each.by_volume
        facts["by_volume"] = {"mean_got": own.mean_got, "rms": own.rms, "largest": own.largest}
    if each.subdomains:
        facts["subdomains_solid_got"] = list(each.subdomains)
    return facts if each.materials is None else facts | {"materials": each.materials}


def table_of(job: Job, result: Design, written: list[Written], notes: list[str]) -> str:
    rows = [
        f"{job.name}: {result.steps} steps, {result.seconds:.1f} s",
        f"{'file':28} {'asked':>8} {'got':>8} {'RMS':>8} {'largest':>8} {'shifted':>8}"
        f" {'roads':>6} {'travel':>8} {'warnings':>8}",
    ]
    for each in written:
        c, build = each.comparison, each.build
        rows.append(
            f"{each.path.name:28} {c.mean_asked:8.4f} {c.mean_got:8.4f} {c.rms:8.4f}"
            f" {c.largest:8.4f} {each.shifted.rms:8.4f}"
            f" {sum(len(layer.roads) for layer in build.layers):6d}"
            f" {sum(layer.travel for layer in build.layers):8.1f} {len(each.findings):8d}"
        )
        if each.by_volume is not None:
            v = each.by_volume
            rows.append(
                f"{'  the same, by volume':28} {v.mean_asked:8.4f} {v.mean_got:8.4f} {v.rms:8.4f}"
                f" {v.largest:8.4f}"
            )
        if each.materials is not None:
            got, asked = (
                ", ".join(f"{share:.4f}" for share in each.materials[key])
                for key in ("got", "asked")
            )
            changes = each.materials["changes"]
            rows.append(f"  materials: {got} of the volume, {asked} asked; {changes} changes")
    what = "porosity" if job.pattern.count == "volume" else "what is open, seen from above"
    return "\n".join(
        [*rows, f"{what}, measured in the files, in {job.target.window:g} mm windows", *notes]
    )
