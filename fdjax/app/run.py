"""One job from its tables to machine files that are measured again."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from fdjax.app import setting
from fdjax.app.config import Job
from fdjax.app.planning import SHIFTS, checked, designed, plan_of
from fdjax.app.report import Written, faults_of, report_of, scaled_sections, table_of
from fdjax.app.writing import fitted, placed
from fdjax.beside import Beside
from fdjax.errors import DesignError, InputError
from fdjax.formats import module, read_file
from fdjax.formats.profile import Machine
from fdjax.optimise.design import Design
from fdjax.plan.compare import compare
from fdjax.plan.coverage import coverage
from fdjax.plan.measure import measure, solid_shares
from fdjax.plan.toolpath import Build
from fdjax.target.target import Target
from fdjax.view import DRAW

SAID = 3
"""Faults of a design that are told at once; the report has all."""


def design(job: Job, folder: Path, *, progress: Callable[[str], None]) -> str:
    """Design `job`, write its files into `folder`, and return a short table of what came out.

    Machine files are written, read back and measured; the plan is not. Raises `InputError` for a
    job that cannot be carried out and `DesignError` for a design that folds, does not converge,
    misses the job's tolerance in a file or breaks a machine limit there; the report and the
    pictures are written all the same, the machine files at fault only if the job says so.
    """
    part = setting.part_of(job.part, job.pattern.road_width)
    target = setting.target_of(job.target, part)
    main = setting.machine_of(job, "ssl")
    machines, left_out = setting.machines_of(job, part)
    named = job.files is not None
    job = replace(job, files=tuple(machines))
    setting.check_lines(job, part, target, main)
    for machine in machines.values():
        job.materials.check(machine)
    # A function or picture that cannot be used is told of before anything is computed.
    wanted = job.materials.asked(part, target) if job.materials.given else []
    narrow, tips = setting.narrow_places(part, job.pattern.road_width)
    if narrow and job.part.narrow == "refuse":
        more = f" (and {len(narrow) - 1} more)" if len(narrow) > 1 else ""
        raise InputError(f'{narrow[0]}{more}; with narrow = "skip" such places stay empty')

    with Beside("fdjax.plan.trace", "fdjax.view.figures") as beside:
        job, result, plan, tried = designed(job, part, target, main, progress, beside)
        unfit = {} if named else setting.unfit_for(machines, result.road_width, main)
        machines = {kind: each for kind, each in machines.items() if kind not in unfit}
        left_out += [f"{job.name}.{kind}: not written: {why}" for kind, why in unfit.items()]
        plans = {main: plan}
        # All before any picture: the process beside does one after the other.
        for machine in machines.values():
            if machine not in plans:
                plans[machine] = plan_of(job, result, machine, target, beside)
        if job.design.laplacians:
            _laplacians(job, folder, result, beside)
        written: list[Written] = []
        for kind, machine in machines.items():
            plan = plans[machine]
            path = folder / f"{job.name}.{kind}"
            if kind == "ssl":
                plan = placed(plan, part, machine, target)
                path.write_text(module(path).write(plan, machine), encoding="utf-8")
                continue
            outlines = [some.outline for some in plan.layers[0].subdomains]
            build = fitted(job, part, result, plan, machine, target)
            each = _written(job, path, build, machine, target, None if written else beside)
            if plan.volume > 0:
                each = replace(each, scaled=build.volume / plan.volume - 1)
            if outlines:
                shares = solid_shares(each.build, outlines)
                each = replace(each, subdomains=tuple(shares.tolist()))
            if job.materials.given:
                each = replace(each, materials=job.materials.laid(part, wanted, each.build))
            written.append(each)
    notes = [note for region in part.regions for note in region.notes]
    notes += [*narrow, *tips, *left_out, *tried]
    notes += [
        f"{each.path.name}: {what}"
        for each in written
        if each.materials is not None
        for what in job.materials.missed(each.materials)
    ]
    notes += scaled_sections(job, written)
    faults = faults_of(job, result, written)
    report = report_of(job, result, written, faults, notes)
    (folder / "report.json").write_text(json.dumps(report, indent=1, allow_nan=False) + "\n")
    if faults:
        if not job.design.export_failed:
            at_fault = {path for path, _ in faults}
            if None in at_fault or at_fault == {each.path for each in written}:
                at_fault = {folder / f"{job.name}.{kind}" for kind in machines}
            for path in filter(None, at_fault):
                path.unlink(missing_ok=True)
        said = [what for _, what in faults[:SAID]]
        if len(faults) > SAID:
            said.append(f"{len(faults) - SAID} more in report.json")
        raise DesignError("; ".join(said))
    return table_of(
        job, result, written, [*notes, *report["design"]["pattern"].get("warnings", ())]
    )


def _written(
    job: Job, path: Path, build: Build, machine: Machine, target: Target, beside: Beside | None
) -> Written:
    """Write the file, read it back and measure what was read; it is drawn beside."""
    outline = build.layers[-1].outline
    top = build.layers[-2:]
    if beside is not None and any(layer.roads for layer in top):
        place = path.with_name("roads.png")
        beside.ask(DRAW, place, "roads_figure", top, outline=outline, title=path.name)
    path.write_text(module(path).write(build, machine), encoding="utf-8")
    read = read_file(path, machine=machine)
    window = job.target.window
    count = job.pattern.count
    measurement, shifted = (
        measure(read, window=window, shift=shift, count=count) for shift in SHIFTS
    )
    comparison = compare(measurement, target)
    if beside is not None:
        beside.ask(
            DRAW,
            path.with_name("porosity.png"),
            "porosity_figure",
            measurement.x,
            measurement.y,
            comparison.asked,
            comparison.got,
            outline=outline,
            title=path.name,
            weights=measurement.area,
            tolerance=job.target.tolerance,
        )
    return Written(
        path,
        machine,
        read,
        build.volume,
        build.thinned,
        checked(job, build, machine),
        measurement,
        comparison,
        compare(shifted, target),
        coverage(read),
        count,
        None if count == "volume" else compare(measure(read, window=window), target),
    )


def _laplacians(job: Job, folder: Path, result: Design, beside: Beside) -> None:
    """P and Q of eq. (5), drawn beside the files."""
    panels = result.pattern.pictures(result.controls).get("laplacians")
    if panels is not None:
        outline = result.part.slabs[-1].region.geometry
        options = {"outline": outline, "title": job.name, "unit": "1/mm²"}
        beside.ask(DRAW, folder / "laplacians.png", "functions_figure", panels, **options)
