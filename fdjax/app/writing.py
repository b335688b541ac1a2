"""Roads as a job's machine file is to hold them: placed, of their materials, their volume met."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fdjax.app import setting
from fdjax.app.config import Job
from fdjax.formats import module, read_file
from fdjax.formats.profile import Machine
from fdjax.optimise.design import Design
from fdjax.part.part import Part
from fdjax.plan.materials import assigned
from fdjax.plan.toolpath import Build
from fdjax.plan.trace import trim, trim_subdomains
from fdjax.target.target import Target
from fdjax.units import MICROSTEP

FAINT = 0.01
"""Largest share by which sections change where the road width is given and nothing is designed, and
by which corners are cut for it."""

UNEVEN = 0.05
"""Largest share by which they change where the mean is to be met: a machine that leaves out more
short roads, or joins fewer lines along the walls, than that of the design lays so much less."""

TOLERANCE = 4e-3
"""Points so near a straight road are dropped, mm: a hundredth of a road's width."""

STEP = {"gcode": 1e-3, "sml": MICROSTEP}
"""Of a format's coordinates, mm: what rounding may move a road."""


def least_road(machine: Machine) -> float:
    """Shortest road, mm, that is planned: rounding to the file's steps may take a little off."""
    least = machine.limits.least_road
    return least + TOLERANCE + STEP[machine.format] if least else 0.0


def placed(plan: Build, part: Part, machine: Machine, target: Target) -> Build:
    """The plan in the middle of the machine's bed, with its target as a note."""
    return plan.replace(origin=setting.origin_on(machine, part), notes={"target": target.text})


def fitted(
    job: Job, part: Part, result: Design, plan: Build, machine: Machine, target: Target
) -> Build:
    """The roads of a plan as the machine's file holds them."""
    plan = _of_materials(job, part, placed(plan, part, machine, target), machine, target)
    plan = trimmed_to(job, result, plan, machine)
    return module(f"{job.name}.{machine.format}").fit(plan, machine)


def read_back(build: Build, machine: Machine) -> Build:
    """What the machine's file of these roads is read as; the file is not kept."""
    with TemporaryDirectory(prefix="fdjax-") as folder:
        path = Path(folder) / f"roads.{machine.format}"
        path.write_text(module(path).write(build, machine), encoding="utf-8")
        return read_file(path, machine=machine)


def _of_materials(job: Job, part: Part, plan: Build, machine: Machine, target: Target) -> Build:
    """The plan with each road of its material."""
    if not job.materials.given:
        return plan
    return assigned(
        plan,
        job.materials.rules(part),
        job.materials.numbers,
        split=job.materials.split,
        least_road=least_road(machine),
        shares=job.materials.asked(part, target) if job.materials.split else None,
    )


def trimmed_to(job: Job, result: Design, plan: Build, machine: Machine) -> Build:
    """The plan with the volume, or the coverage, that is asked, by the sections of its roads: as
    much as that takes where their width is free, else only up to `UNEVEN`, of lines that are not
    designed `FAINT`, and where the machine lays it.
    """
    if not plan.volume > 0:
        return plan
    divided = bool(plan.layers[0].subdomains)
    asked = result.pattern.facts(result.controls)["subdomains"] if divided else ()
    if asked and all(each["by_target"] for each in asked):
        height = result.part.height
        volumes = [each["solid_asked"] * each["area"] * height for each in asked]
        trimmed, faint = trim_subdomains(plan, volumes, most=UNEVEN), True
    else:
        trimmed = trim(plan, result.volume, count=job.pattern.count)
        most = UNEVEN if job.pattern.controls else FAINT
        faint = abs(trimmed.volume / plan.volume - 1) < most
    if job.pattern.width_is_free:
        return trimmed
    low, high = machine.limits.road_width
    widths = np.concatenate([road.width for layer in trimmed.layers for road in layer.roads])
    return trimmed if faint and low <= widths.min() and widths.max() <= high else plan
