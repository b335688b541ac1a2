"""One job from its tables to machine files that are measured again."""

import json
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from threading import Thread

from fdjax.app import setting
from fdjax.app.config import Job
from fdjax.app.report import Written, faults_of, report_of, table_of
from fdjax.errors import DesignError
from fdjax.formats import module, read_file
from fdjax.formats.profile import Machine
from fdjax.grid.continuation import Continuation
from fdjax.grid.solvers import SOR, Multigrid, Newton
from fdjax.optimise.design import Design
from fdjax.optimise.design import design as solve
from fdjax.optimise.least_squares import Progress
from fdjax.part.part import Part
from fdjax.part.patch import Patch
from fdjax.pattern.base import Lines
from fdjax.plan.check import check
from fdjax.plan.compare import compare
from fdjax.plan.coverage import coverage
from fdjax.plan.measure import measure
from fdjax.plan.toolpath import Build
from fdjax.plan.trace import lay, trim
from fdjax.target.target import Target
from fdjax.units import MICROSTEP


def design(job: Job, folder: Path, *, progress: Callable[[str], None]) -> str:
    """Design `job`, write its files into `folder`, and return a short table of what came out.

    Machine files are written, read back and measured; the plan is not. Raises `InputError` for a
    job that cannot be carried out and `DesignError` for a design that folds, does not converge,
    misses the job's tolerance in a file or breaks a machine limit there; the report and the
    pictures are written all the same, the machine files at fault only if the job says so.
    """
    patch = setting.patch_of(job.part)
    plate = Part.plate(patch, layers=job.part.layers, height=job.part.layer_height)
    target = setting.target_of(job.target, plate)
    machines = {kind: setting.machine_of(job, kind) for kind in job.files}
    main = setting.machine_of(job, "ssl")
    setting.check_fits(job, patch.outline, main)

    def show(step: Progress) -> None:
        progress(f"step {step.step:3d}   RMS error {step.error:.5f}   {step.seconds:5.1f} s")

    # Matplotlib takes long to load: let it do so while the optimiser computes.
    pictures = Thread(target=import_module, args=["fdjax.view.figures"])
    pictures.start()
    result = _solve(job, patch, target, main, show)
    progress("planning roads")
    lines = result.lines()
    plans = {main: _plan(job, lines, patch, main)}
    if job.pattern.lines is None:
        recounted = result.recounted(plans[main].volume)
        if recounted is not result:
            result, lines, plans = recounted, recounted.lines(), {}
    written = []
    for kind, machine in machines.items():
        if machine not in plans:
            plans[machine] = _plan(job, lines, patch, machine)
        plan = plans[machine].replace(
            origin=setting.origin_on(machine, patch.outline), notes={"target": target.text}
        )
        path = folder / f"{job.name}.{kind}"
        if kind == "ssl":
            path.write_text(module(path).write(plan, machine), encoding="utf-8")
            continue
        if {"width", "width_field"} & set(job.design.controls):
            plan = trim(plan, result.volume)
        written.append(_written(job, path, module(path).fit(plan, machine), machine, target))
    faults = faults_of(job, result, written)
    _pictures(job, folder, patch, lines, written)
    report = report_of(job, result, written, faults)
    (folder / "report.json").write_text(json.dumps(report, indent=1, allow_nan=False) + "\n")
    if faults:
        if not job.design.export_failed:
            at_fault = {path for path, _ in faults}
            if None in at_fault or at_fault == {each.path for each in written}:
                at_fault = {folder / f"{job.name}.{kind}" for kind in job.files}
            for path in filter(None, at_fault):
                path.unlink(missing_ok=True)
        raise DesignError("; ".join(what for _, what in faults))
    return table_of(job, result, written)


SOLVERS = {"newton": Continuation(Newton()), "multigrid": Multigrid(), "sor": SOR()}


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
        solver=SOLVERS[pattern.solver],
        progress=show,
    )


def _plan(job: Job, lines: Sequence[Sequence[Lines]], patch: Patch, machine: Machine) -> Build:
    resolution = RESOLUTION[machine.format]
    return lay(
        lines,
        patch.outline,
        height=job.part.layer_height,
        lift_length=machine.lift_length,
        tolerance=resolution / 4,
        clearance=resolution,
        name=job.name,
    )


RESOLUTION = {"gcode": 4e-3, "sml": MICROSTEP}
"""What dropping points (a quarter of it) and rounding to a format's steps may move a road, mm."""


def _written(job: Job, path: Path, build: Build, machine: Machine, target: Target) -> Written:
    """Write the file, read it back and measure what was read."""
    path.write_text(module(path).write(build, machine), encoding="utf-8")
    read = read_file(path, machine=machine)
    window = job.target.window
    measurement = measure(read, window=window)
    return Written(
        path,
        machine,
        read,
        build.volume,
        check(build, machine.limits, both_families=job.pattern.mode.startswith("both")),
        measurement,
        compare(measurement, target),
        compare(measure(read, window=window, shift=(0.5, 0.5)), target),
        coverage(read),
    )


def _pictures(
    job: Job,
    folder: Path,
    patch: Patch,
    lines: Sequence[Sequence[Lines]],
    written: list[Written],
) -> None:
    from fdjax.view import figures

    shown = {family.family: family.xy for layer in reversed(lines) for family in layer}
    figure = figures.grid_figure(
        patch.outline, list(shown.get("xi", [])), list(shown.get("eta", [])), title=job.name
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
