"""One job from its tables to machine files that are measured again."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fdjax.app import setting
from fdjax.app.config import Job
from fdjax.design.design import Design
from fdjax.design.design import design as solve
from fdjax.design.optimise import Progress
from fdjax.design.target import Target
from fdjax.domain.patch import Patch
from fdjax.errors import DesignError
from fdjax.formats import module, read_file
from fdjax.formats.profile import Machine
from fdjax.grid.solvers import SOR
from fdjax.plan.check import Finding, check
from fdjax.plan.coverage import coverage
from fdjax.plan.measure import Comparison, Measurement, compare, measure
from fdjax.plan.toolpath import Build
from fdjax.plan.trace import lay, trim
from fdjax.units import MICROSTEP


@dataclass(frozen=True, eq=False)
class Written:
    """One machine file as it was read back: `measurement` and `comparison` are of the file."""

    path: Path
    machine: Machine
    build: Build
    findings: tuple[Finding, ...]
    measurement: Measurement
    comparison: Comparison
    shifted: Comparison
    coverage: float | None

    @property
    def errors(self) -> list[Finding]:
        return [finding for finding in self.findings if finding.severity == "error"]


def design(job: Job, folder: Path, *, progress: Callable[[str], None]) -> str:
    """Design `job`, write its files into `folder`, and return a short table of what came out.

    Machine files are written, read back and measured; the plan is not. Raises `InputError` for a
    job that cannot be carried out and `DesignError` for a design that folds, does not converge,
    misses the job's tolerance in a file or breaks a machine limit there; the report and the
    pictures are written all the same, the machine files at fault only if the job says so.
    """
    patch = setting.patch_of(job.part)
    target = setting.target_of(job.target, patch.outline)
    machines = {kind: setting.machine_of(job, kind) for kind in job.files}
    main = setting.machine_of(job, "ssl")
    setting.check_fits(job, patch.outline, main)

    def show(step: Progress) -> None:
        progress(f"step {step.step:3d}   RMS error {step.error:.5f}   {step.seconds:5.1f} s")

    result = _solve(job, patch, target, main, show)
    progress("planning roads")
    roads = [kind for kind in job.files if kind != "ssl"]
    builds = {kind: _build(job, result, patch, target, machines[kind], kind) for kind in roads}
    written = [_write(job, builds[kind], folder, kind, machines[kind], target) for kind in roads]
    if "ssl" in job.files:
        build = next(iter(builds.values()), None) or _build(job, result, patch, target, main, "ssl")
        path = folder / f"{job.name}.ssl"
        path.write_text(module(path).write(build, main), encoding="utf-8")
    faults = _faults(job, result, written)
    _pictures(job, folder, patch, result, written)
    report = _report(job, result, written, faults)
    (folder / "report.json").write_text(json.dumps(report, indent=1, allow_nan=False) + "\n")
    if faults:
        if not job.design.export_failed:
            kinds = roads if any(path is None for path, _ in faults) else []
            bad = {path for path, _ in faults if path} | {folder / f"{job.name}.{k}" for k in kinds}
            for path in bad:
                path.unlink(missing_ok=True)
        raise DesignError("; ".join(what for _, what in faults))
    return _table(job, result, written)


def _solve(
    job: Job, patch: Patch, target: Target, machine: Machine, show: Callable[[Progress], None]
) -> Design:
    pattern, settings = job.pattern, job.design
    phi, psi = pattern.phi_psi
    return solve(
        patch,
        target,
        limits=machine.limits,
        layers=job.part.layers,
        layer_height=job.part.layer_height,
        map=pattern.map,
        mode=pattern.mode,
        phases=pattern.phases,
        road_width=pattern.road_width,
        lines=pattern.lines,
        controls=settings.controls,
        window=job.target.window,
        objective=settings.objective,
        knots=settings.knots,
        field_knots=settings.field_knots,
        smoothness=settings.smoothness,
        iterations=settings.iterations,
        span_limit=settings.span_limit,
        nodes=pattern.nodes,
        phi=phi,
        psi=psi,
        p=pattern.p,
        q=pattern.q,
        alpha=pattern.alpha,
        beta=pattern.beta,
        solver=SOR() if pattern.solver == "sor" else None,
        progress=show,
    )


def _build(
    job: Job, result: Design, patch: Patch, target: Target, machine: Machine, kind: str
) -> Build:
    """The plan as this machine can express it."""
    build = lay(
        result.lines(),
        patch.outline,
        height=job.part.layer_height,
        lift_length=machine.lift_length,
        tolerance=TOLERANCE[kind],
        clearance=CLEARANCE[kind],
        name=job.name,
    ).replace(
        origin=setting.origin_on(machine, patch.outline),
        notes={"target": target.text},
    )
    if {"width", "width_field"} & set(job.design.controls):
        build = trim(build, result.volume)
    return build if kind == "ssl" else module(f"{job.name}.{kind}").fit(build, machine)


TOLERANCE = {"gcode": 2e-3, "sml": 6e-3, "ssl": 2e-3}
"""How far (mm) a road's corners may be dropped: below what each format resolves."""

CLEARANCE = {"gcode": 3e-3, "sml": 6e-3 + MICROSTEP / 2**0.5, "ssl": 0.0}
"""What that and rounding to the format's steps may move a road, mm."""


def _write(
    job: Job, build: Build, folder: Path, kind: str, machine: Machine, target: Target
) -> Written:
    path = folder / f"{job.name}.{kind}"
    path.write_text(module(path).write(build, machine), encoding="utf-8")
    read = read_file(path, machine=machine)
    window = job.target.window
    measurement = measure(read, window=window)
    return Written(
        path,
        machine,
        read,
        check(build, machine.limits, both_families=job.pattern.mode.startswith("both")),
        measurement,
        compare(measurement, target),
        compare(measure(read, window=window, shift=(0.5, 0.5)), target),
        coverage(read) if kind == setting.machine_of(job, "ssl").format else None,
    )


def _faults(job: Job, result: Design, written: list[Written]) -> list[tuple[Path | None, str]]:
    """What is wrong, in one phrase each, with the file it concerns or None for the design."""
    faults: list[tuple[Path | None, str]] = []
    if not result.made:
        faults.append((None, "the grid folds or its solve did not converge"))
    for each in written:
        rms = each.comparison.rms
        if not rms <= job.target.tolerance:
            what = f"{each.path.name} misses its target: RMS {rms:.4f} in {job.target.window:g} mm"
            faults.append((each.path, f"{what} windows, {job.target.tolerance:g} is allowed"))
        for finding in each.errors:
            faults.append((each.path, f"{each.path.name}: {finding}"))
    return faults


def _pictures(job: Job, folder: Path, patch: Patch, result: Design, written: list[Written]) -> None:
    from fdjax.view import figures

    lines = {family.family: family.xy for layer in reversed(result.lines()) for family in layer}
    figure = figures.grid_figure(
        patch.outline, list(lines.get("xi", [])), list(lines.get("eta", [])), title=job.name
    )
    figures.save(figure, folder / "grid.png")
    for each in written[:1]:
        figure = figures.porosity_figure(
            each.measurement.x,
            each.measurement.y,
            each.comparison.asked,
            each.comparison.got,
            outline=patch.outline,
            title=each.path.name,
            weights=each.measurement.area,
        )
        figures.save(figure, folder / "porosity.png")


def _report(
    job: Job, result: Design, written: list[Written], faults: list[tuple[Path | None, str]]
) -> dict[str, Any]:
    xi, eta = (int(np.asarray(n)) for n in result.pattern.comb)
    phases = result.pattern.stacking.phases
    return {
        "name": job.name,
        "ok": not faults,
        "faults": [what for _, what in faults],
        "design": {
            "made": result.made,
            "converged": result.outcome.converged,
            "steps": result.steps,
            "seconds": round(result.seconds, 3),
            "model_rms": result.outcome.error,
            "limits_broken": result.broken,
            "lines_per_layer": {"xi": xi / phases, "eta": eta / phases},
            "phases": phases,
            "road_width": list(result.road_width),
        },
        "files": {each.path.name: _facts(each) for each in written},
    }


def _facts(each: Written) -> dict[str, Any]:
    comparison, build = each.comparison, each.build
    return {
        "machine": each.machine.name,
        "unverified": list(each.machine.unverified),
        "window": float(each.measurement.x[1] - each.measurement.x[0]),
        "mean_asked": comparison.mean_asked,
        "mean_got": comparison.mean_got,
        "rms": comparison.rms,
        "largest": comparison.largest,
        "rms_windows_shifted_by_half": each.shifted.rms,
        "coverage": each.coverage,
        "volume": build.volume,
        "layers": len(build.layers),
        "roads": sum(len(layer.roads) for layer in build.layers),
        "travel": sum(layer.travel for layer in build.layers),
        "findings": [
            {"severity": f.severity, "kind": f.kind, "count": f.count, "message": str(f)}
            for f in each.findings
        ],
    }


def _table(job: Job, result: Design, written: list[Written]) -> str:
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
    return "\n".join(
        [*rows, f"porosity, measured in the files, in {job.target.window:g} mm windows"]
    )
