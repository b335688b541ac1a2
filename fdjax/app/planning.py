"""The design of a job and its plan, corrected by what that lays; of several patterns the best."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import equinox as eqx

from fdjax.app import setting
from fdjax.app.config import Job
from fdjax.app.writing import (
    FAINT,
    STEP,
    TOLERANCE,
    fitted,
    least_road,
    read_back,
)
from fdjax.beside import Beside
from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.optimise.design import Design
from fdjax.optimise.design import design as solve
from fdjax.optimise.least_squares import Progress
from fdjax.optimise.objective import WHOLE
from fdjax.part.part import Part
from fdjax.pattern.auto import Auto
from fdjax.plan.check import Finding, check
from fdjax.plan.compare import compare
from fdjax.plan.corners import cut_corners
from fdjax.plan.counted import deposits
from fdjax.plan.measure import measure
from fdjax.plan.toolpath import Build
from fdjax.plan.trace import lay
from fdjax.target.target import Target

SHIFTS = (0.0, 0.0), (0.5, 0.5)
"""Windows are looked at where they are, and shifted by half."""


def designed(
    job: Job,
    part: Part,
    target: Target,
    machine: Machine,
    progress: Callable[[str], None],
    beside: Beside | None = None,
) -> tuple[Job, Design, Build, list[str]]:
    """The job with the pattern that was kept, its design and plan, and in words what was tried."""
    if isinstance(job.pattern, Auto):
        return _best(job, job.pattern, part, target, machine, progress, beside)
    return job, *_designed(job, part, target, machine, progress, beside), []


def _designed(
    job: Job,
    part: Part,
    target: Target,
    machine: Machine,
    progress: Callable[[str], None],
    beside: Beside | None,
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
    return _planned(job, result, machine, target, show, beside)


def _best(
    job: Job,
    auto: Auto,
    part: Part,
    target: Target,
    machine: Machine,
    progress: Callable[[str], None],
    beside: Beside | None,
) -> tuple[Job, Design, Build, list[str]]:
    """Of all patterns that suit the part that whose first file is best, as it is read back, and in
    words what was tried.
    """
    found: list[tuple[tuple[int, float], str, Job, Design, Build]] = []
    tried = []
    kind = next((kind for kind in job.files or () if kind != "ssl"), machine.format)
    writer = setting.machine_of(job, kind)
    for name, settings in auto.candidates(part):
        progress(f"trying {name}")
        own = replace(job, pattern=settings)
        try:
            result, plan = _designed(own, part, target, machine, progress, beside)
            laid = plan if writer == machine else plan_of(own, result, writer, target, beside)
            build = fitted(own, part, result, laid, writer, target)
            seen = _missed(own, read_back(build, writer), target)
        except InputError as fault:
            tried.append(f"tried {name}: {fault}")
            continue
        errors = _errors(own, build, writer) + (not result.made)
        tried.append(
            f"tried {name}: RMS {seen.rms:.4f}, shifted {seen.shifted:.4f} in its file"
            + (f", {errors} kinds of errors" if errors else "")
        )
        found.append(((errors, seen.misses), name, own, result, plan))
    if not found:
        none = f"pattern: none of {', '.join(auto.tried)} suits this outline"
        raise InputError("; ".join(tried) or f'{none}; "isolines" always does')
    _, name, own, result, plan = min(found, key=lambda each: each[0])
    return own, result, plan, [*tried, f"kept {name}"]


def _planned(
    job: Job,
    result: Design,
    machine: Machine,
    target: Target,
    show: Callable[[Progress], None],
    beside: Beside | None,
) -> tuple[Design, Build]:
    """The design and its plan, corrected and counted anew where that makes the plan better."""
    made = [_tried(job, result, machine, target, beside)]
    for count in range(job.pattern.corrections):
        if count and made[-1].missed.largest <= job.pattern.enough:
            break
        places = deposits(made[-1].plan, job.target.window / 4, job.pattern.count)
        result = made[-1].design.corrected(*places, progress=show)
        if eqx.tree_equal(result.controls, made[-1].design.controls):
            # It would be corrected alike for ever.
            break
        made.append(_tried(job, result, machine, target, beside))
    best = _soundest(job, made, machine) if len(made) > 1 else made[0]
    recounted = best.design.recounted(best.laid)
    if recounted is best.design:
        return best.design, best.plan
    return recounted, plan_of(job, recounted, machine, target, beside)


@dataclass(frozen=True, eq=False)
class _Tried:
    """A design, its plan, and the volume, mm^3, of that before corners were cut: lines are counted
    by it, since sections make up for corners.
    """

    job: Job
    target: Target
    design: Design
    laid: float
    plan: Build

    @cached_property
    def missed(self) -> "_Missed":
        return _missed(self.job, self.plan, self.target)


def _tried(
    job: Job, result: Design, machine: Machine, target: Target, beside: Beside | None
) -> _Tried:
    square = _laid(job, result, machine, beside)
    plan = _cut(job, square, result, machine, target)
    return _Tried(job, target, result, square.volume, plan)


def _soundest(job: Job, made: list[_Tried], machine: Machine) -> _Tried:
    """Of the plans without errors the nearest to its target, or else the one with the fewest."""
    found = []
    # Checks take longest: behind a plan without errors none is looked at.
    for each in sorted(made, key=lambda each: each.missed.misses):
        found.append((_errors(job, each.plan, machine), each))
        if not found[-1][0]:
            break
    return min(found, key=lambda pair: pair[0])[1]


class _Missed(NamedTuple):
    """How far the windows of a plan, where they are and shifted by half, and its mean are from the
    target, weighed as in design; the RMS of both windows, and how far off the worst of all is.
    """

    misses: float
    rms: float
    shifted: float
    largest: float


def _missed(job: Job, plan: Build, target: Target) -> _Missed:
    plain, shifted = (
        compare(
            measure(plan, window=job.target.window, shift=shift, count=job.pattern.count), target
        )
        for shift in SHIFTS
    )
    misses = sum(
        each.rms**2 + (WHOLE * (each.mean_got - each.mean_asked)) ** 2 for each in (plain, shifted)
    )
    return _Missed(misses, plain.rms, shifted.rms, max(plain.largest, shifted.largest))


def _errors(job: Job, plan: Build, machine: Machine) -> int:
    """Kinds of errors of a plan on this machine."""
    return sum(each.severity == "error" for each in checked(job, plan, machine))


def checked(job: Job, build: Build, machine: Machine) -> tuple[Finding, ...]:
    """Faults of a build on this machine."""
    return check(build, machine.limits, both_families=job.pattern.mode.startswith("both"))


def plan_of(
    job: Job, result: Design, machine: Machine, target: Target, beside: Beside | None = None
) -> Build:
    """The roads of a design as this machine's format can hold them, their corners cut if asked for.

    Lines that are not designed are laid as they are.
    """
    return _cut(job, _laid(job, result, machine, beside), result, machine, target)


def _laid(job: Job, result: Design, machine: Machine, beside: Beside | None) -> Build:
    moved = TOLERANCE + STEP[machine.format]
    return lay(
        result.strokes(),
        result.part,
        lift_length=machine.lift_length,
        least_spacing=machine.limits.least_spacing,
        least_road=least_road(machine),
        tolerance=TOLERANCE,
        clearance=moved,
        name=job.name,
        beside=beside,
    )


def _cut(job: Job, plan: Build, result: Design, machine: Machine, target: Target) -> Build:
    if not (job.design.cut_corners and job.pattern.controls):
        return plan
    # Sections can make up for most of `FAINT`.
    least = (1 - 0.8 * FAINT) * result.volume
    return cut_corners(
        plan,
        target,
        window=job.target.window,
        clearance=machine.limits.least_spacing,
        least=least,
        least_road=least_road(machine),
    )
