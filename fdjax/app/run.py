"""One job from its tables to machine files that are measured again."""

import json
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from threading import Thread

import numpy as np

from fdjax.app import setting
from fdjax.app.config import Job
from fdjax.app.report import Written, faults_of, report_of, table_of
from fdjax.errors import DesignError, InputError
from fdjax.formats import module, read_file
from fdjax.formats.profile import Machine
from fdjax.optimise.design import Design
from fdjax.optimise.design import design as solve
from fdjax.optimise.least_squares import Progress
from fdjax.optimise.objective import WHOLE
from fdjax.part.part import Part
from fdjax.pattern.auto import Auto
from fdjax.plan.check import Finding, check
from fdjax.plan.compare import compare
from fdjax.plan.coverage import coverage
from fdjax.plan.materials import assigned
from fdjax.plan.measure import measure, solid_shares
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
    part = setting.part_of(job.part, job.pattern.road_width)
    target = setting.target_of(job.target, part)
    machines = {kind: setting.machine_of(job, kind) for kind in job.files}
    main = setting.machine_of(job, "ssl")
    setting.check_fits(job, part, main)
    setting.check_lines(job, part, target, main)
    for machine in machines.values():
        job.materials.check(machine)
    narrow, tips = setting.narrow_places(part, job.pattern.road_width)
    if narrow and job.part.narrow == "refuse":
        more = f" (and {len(narrow) - 1} more)" if len(narrow) > 1 else ""
        raise InputError(f'{narrow[0]}{more}; with narrow = "skip" such places stay empty')

    # Matplotlib takes long to load: let it do so while the optimiser computes.
    pictures = Thread(target=import_module, args=["fdjax.view.figures"])
    pictures.start()
    if isinstance(job.pattern, Auto):
        job, result, plan, tried = _best(job, job.pattern, part, target, main, progress)
    else:
        result, plan = _designed(job, part, target, main, progress)
        tried = []
    plans = {main: plan}
    written = []
    for kind, machine in machines.items():
        if machine not in plans:
            plans[machine] = _plan(job, result, machine)
        plan = plans[machine].replace(
            origin=setting.origin_on(machine, part), notes={"target": target.text}
        )
        path = folder / f"{job.name}.{kind}"
        if kind == "ssl":
            path.write_text(module(path).write(plan, machine), encoding="utf-8")
            continue
        outlines = [some.outline for some in plan.layers[0].subdomains]
        plan = _of_materials(job, part, plan, machine)
        plan = _trimmed(job, result, plan, machine)
        written.append(_written(job, path, module(path).fit(plan, machine), machine, target))
        if outlines:
            shares = solid_shares(written[-1].build, outlines)
            written[-1] = replace(written[-1], subdomains=tuple(shares.tolist()))
        if job.materials.given:
            laid = job.materials.laid(part, target, written[-1].build)
            written[-1] = replace(written[-1], materials=laid)
    notes = [*(note for region in part.regions for note in region.notes), *narrow, *tips, *tried]
    faults = faults_of(job, result, written)
    _pictures(job, folder, result, written)
    report = report_of(job, result, written, faults, notes)
    (folder / "report.json").write_text(json.dumps(report, indent=1, allow_nan=False) + "\n")
    if faults:
        if not job.design.export_failed:
            at_fault = {path for path, _ in faults}
            if None in at_fault or at_fault == {each.path for each in written}:
                at_fault = {folder / f"{job.name}.{kind}" for kind in job.files}
            for path in filter(None, at_fault):
                path.unlink(missing_ok=True)
        raise DesignError("; ".join(what for _, what in faults))
    return table_of(
        job, result, written, [*notes, *report["design"]["pattern"].get("warnings", ())]
    )


def _designed(
    job: Job, part: Part, target: Target, machine: Machine, progress: Callable[[str], None]
) -> tuple[Design, Build]:
    def show(step: Progress) -> None:
        progress(f"step {step.step:3d}   RMS error {step.error:.5f}   {step.seconds:5.1f} s")

    result = solve(
        part,
        target,
        limits=machine.limits,
        pattern=job.pattern,
        window=job.target.window,
        objective=job.design.objective,
        smoothness=job.design.smoothness,
        iterations=job.design.iterations if job.pattern.controls else 0,
        span_limit=job.design.span_limit,
        progress=show,
    )
    progress("planning roads")
    return _planned(job, result, machine, target, show)


def _best(
    job: Job,
    auto: Auto,
    part: Part,
    target: Target,
    machine: Machine,
    progress: Callable[[str], None],
) -> tuple[Job, Design, Build, list[str]]:
    """The pattern whose plan is best, of all that suit the part, and in words what was tried."""
    found: list[tuple[tuple[int, float], str, Job, Design, Build]] = []
    tried = []
    for name, settings in auto.candidates(part):
        progress(f"trying {name}")
        own = replace(job, pattern=settings)
        try:
            result, plan = _designed(own, part, target, machine, progress)
        except InputError as fault:
            tried.append(f"tried {name}: {fault}")
            continue
        # As it would be written, but for the file's steps.
        trimmed = _trimmed(own, result, plan, machine)
        errors, misses = _quality(own, trimmed, machine, target)
        errors += not result.made
        plain, shifted = (
            compare(measure(trimmed, window=job.target.window, shift=shift), target).rms
            for shift in SHIFTS
        )
        tried.append(
            f"tried {name}: RMS {plain:.4f}, shifted {shifted:.4f} on its roads"
            + (f", {errors} kinds of errors" if errors else "")
        )
        found.append(((errors, misses), name, own, result, plan))
    if not found:
        raise InputError("; ".join(tried))
    _, name, own, result, plan = min(found, key=lambda each: each[0])
    return own, result, plan, [*tried, f"kept {name}"]


def _planned(
    job: Job, result: Design, machine: Machine, target: Target, show: Callable[[Progress], None]
) -> tuple[Design, Build]:
    """The design and its plan, corrected and counted anew where that makes the plan better."""
    plan = _plan(job, result, machine)
    best = result, plan, _faultiness(job, plan, machine, target)
    for _ in range(job.pattern.corrections):
        result = result.corrected(*plan.deposits(job.target.window / 4), progress=show)
        plan = _plan(job, result, machine)
        faultiness = _faultiness(job, plan, machine, target)
        if faultiness < best[2]:
            best = result, plan, faultiness
    result, plan, _ = best
    recounted = result.recounted(plan.volume)
    return (result, plan) if recounted is result else (recounted, _plan(job, recounted, machine))


def _faultiness(job: Job, plan: Build, machine: Machine, target: Target) -> tuple[int, float]:
    """What `_quality` says, where it is asked for."""
    return _quality(job, plan, machine, target) if job.pattern.corrections else (0, 0.0)


def _quality(job: Job, plan: Build, machine: Machine, target: Target) -> tuple[int, float]:
    """Errors of a plan, and how far its windows, where they are and shifted by half, and its mean
    are from the target: weighed as in design.
    """
    found = _checked(job, plan, machine)
    misses = 0.0
    for shift in SHIFTS:
        seen = compare(measure(plan, window=job.target.window, shift=shift), target)
        misses += seen.rms**2 + (WHOLE * (seen.mean_got - seen.mean_asked)) ** 2
    return sum(each.severity == "error" for each in found), misses


def _checked(job: Job, build: Build, machine: Machine) -> tuple[Finding, ...]:
    return check(build, machine.limits, both_families=job.pattern.mode.startswith("both"))


def _plan(job: Job, result: Design, machine: Machine) -> Build:
    moved = TOLERANCE + STEP[machine.format]
    return lay(
        result.strokes(),
        result.part,
        lift_length=machine.lift_length,
        least_spacing=machine.limits.least_spacing,
        least_road=_least_road(machine),
        tolerance=TOLERANCE,
        clearance=moved,
        name=job.name,
    )


def _of_materials(job: Job, part: Part, plan: Build, machine: Machine) -> Build:
    """The plan with each road of its material."""
    if not job.materials.given:
        return plan
    return assigned(
        plan,
        job.materials.rule(part),
        job.materials.tools,
        split=job.materials.split,
        least_road=_least_road(machine),
    )


def _least_road(machine: Machine) -> float:
    """Shortest road, mm, that is planned: rounding to the file's steps may take a little off."""
    least = machine.limits.least_road
    return least + TOLERANCE + STEP[machine.format] if least else 0.0


def _trimmed(job: Job, result: Design, plan: Build, machine: Machine) -> Build:
    """The plan with the volume that is asked, by the sections of its roads: as much as that takes
    where their width is free, else only up to `FAINT` and where the machine lays it.
    """
    if not plan.volume > 0:
        return plan
    trimmed = trim(plan, result.volume)
    if job.pattern.width_is_free:
        return trimmed
    low, high = machine.limits.road_width
    widths = np.concatenate([road.width for layer in trimmed.layers for road in layer.roads])
    faint = abs(result.volume / plan.volume - 1) < FAINT
    return trimmed if faint and low <= widths.min() and widths.max() <= high else plan


SHIFTS = (0.0, 0.0), (0.5, 0.5)
"""Windows are looked at where they are, and shifted by half."""

FAINT = 0.01
"""Largest share by which sections change where the road width is given."""

TOLERANCE = 4e-3
"""Points so near a straight road are dropped, mm: a hundredth of a road's width."""

STEP = {"gcode": 1e-3, "sml": MICROSTEP}
"""Of a format's coordinates, mm: what rounding may move a road."""


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
        build.thinned,
        _checked(job, build, machine),
        measurement,
        compare(measurement, target),
        compare(measure(read, window=window, shift=(0.5, 0.5)), target),
        coverage(read),
    )


def _pictures(job: Job, folder: Path, result: Design, written: list[Written]) -> None:
    from fdjax.view import figures

    outline = result.part.slabs[-1].region.geometry
    pictures = result.pattern.pictures(result.controls) if job.design.laplacians else {}
    if "laplacians" in pictures:
        panels = pictures["laplacians"]
        figure = figures.functions_figure(panels, outline=outline, title=job.name, unit="1/mm²")
        figures.save(figure, folder / "laplacians.png")
    if not written:
        return
    first = written[0]
    top = first.build.layers[-2:]
    if any(layer.roads for layer in top):
        figure = figures.roads_figure(top, outline=outline, title=first.path.name)
        figures.save(figure, folder / "roads.png")
    figure = figures.porosity_figure(
        first.measurement.x,
        first.measurement.y,
        first.comparison.asked,
        first.comparison.got,
        outline=outline,
        title=first.path.name,
        weights=first.measurement.area,
        tolerance=job.target.tolerance,
    )
    figures.save(figure, folder / "porosity.png")
