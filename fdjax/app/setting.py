"""From a job's tables to the things they describe: domain, target, machines."""

from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from fdjax.app.config import FILE_KINDS, Job, TargetSource
from fdjax.app.part import Circle, Part, Side
from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.formats.profile import Machine
from fdjax.part import curve
from fdjax.part import part as body
from fdjax.part.contour import circle, contour, contours
from fdjax.part.corners import smallest_rectangle
from fdjax.part.patch import Patch, cosine_top, from_curves, from_polygon, rectangle
from fdjax.part.region import Region
from fdjax.part.ring import JOINED, MERGED
from fdjax.road.bead import section_area
from fdjax.target.array import array
from fdjax.target.image import image
from fdjax.target.target import Target, expression

CURVES = {"polyline": curve.polyline, "spline": curve.smooth}


def part_of(part: Part, road_width: float = 0.0) -> body.Part:
    """The layers that `[part]` describes, with their four sides where it says them.

    Points of a polygon nearer to each other than `JOINED` of a road (mm) are one; the notes of the
    part's regions say so.
    """
    holes = [_hole(hole) for hole in part.holes]
    region: Any
    merged = max(MERGED, JOINED * road_width)
    notes: tuple[str, ...] = ()
    if part.shape == "curves":
        region = from_curves(*_sides(part), holes=holes)
    elif part.shape == "polygon":
        source: Any = part.points if part.points is not None else part.wkt or part.file
        # Inline points are in mm already; a file and WKT are in the table's unit.
        unit = "mm" if part.points is not None else part.unit
        if part.corners is not None or part.smooth:
            (polygon,), notes = contours(source, unit=unit, merged=merged, most=1)
            holed = contour(polygon, holes=holes)
            region = from_polygon(holed, corners=part.corners, smooth=part.smooth)
        else:
            region = Region.of(source, unit=unit, merged=merged)
            if holes:
                notes, region = region.notes, Region.of(region.geometry, holes=holes)
    elif part.shape == "rectangle" and part.size is not None:
        region = rectangle(*part.size, holes=holes)
    else:
        top = cosine_top()
        rings = tuple(hole.exterior for hole in holes)
        region = Patch(top.bottom, top.right, top.top, top.left, rings)
    plate = body.Part.plate(region, layers=part.layers, height=part.layer_height)
    return plate.noted(notes) if notes else plate


def _sides(part: Part) -> list[curve.Curve]:
    """The four curves, in the order of `from_curves`; errors name the side."""
    made = []
    for name in ("bottom", "right", "top", "left"):
        side = getattr(part, name)
        try:
            made.append(_curve(side))
        except InputError as fault:
            raise InputError(f"part.{name}: {fault}") from None
    return made


def _curve(side: Side) -> curve.Curve:
    if side.shape == "arc":
        return curve.arc(*side.points)
    return CURVES[side.shape](side.points)


def _hole(hole: Any) -> Polygon:
    return circle(hole.centre, hole.radius) if isinstance(hole, Circle) else Polygon(hole.points)


def target_of(source: TargetSource, filled: body.Part) -> Target:
    """The porosity that `[target]` asks for, checked all over the part."""
    path = source.image or source.array
    if path is not None:
        load = image if source.image is not None else array
        target = load(
            path,
            extent=filled.bounds,
            quantity=source.quantity,
            low=source.low,
            high=source.high,
        )
    else:
        quantity = "porosity" if source.porosity is not None else "solid"
        text = source.porosity if source.porosity is not None else source.solid
        assert text is not None
        target = expression(text, quantity=quantity, unit=source.unit)
    target.check(filled)
    return target


def machine_of(job: Job, kind: str) -> Machine:
    """The machine that files of this kind are written for."""
    main = profile.load(job.machine)
    if kind == main.format or kind == "ssl":
        return main
    other = profile.load(job.gcode_machine if kind == "gcode" else job.sml_machine)
    if other.format != kind:
        raise InputError(f"{kind}_machine: {other.name} takes {other.format}, not {kind}")
    return other


def machines_of(job: Job, part: body.Part) -> tuple[dict[str, Machine], list[str]]:
    """The machine of each kind of file that is written, and in words what is not.

    Raises `InputError`, as `check_fits`, for the machine of the design and for that of a file which
    the job names; where it names none, what another machine cannot lay is not written.
    """
    main = machine_of(job, "ssl")
    check_fits(job, part, main)
    machines, notes = {}, []
    for kind in job.files or FILE_KINDS:
        machine = machine_of(job, kind)
        try:
            check_fits(job, part, machine)
        except InputError as fault:
            if job.files is not None:
                raise InputError(f"{job.name}.{kind}: {fault}; leave it out of files") from None
            notes.append(f"{job.name}.{kind}: not written: {fault}")
        else:
            machines[kind] = machine
    return machines, notes


def unfit_for(
    machines: dict[str, Machine], widths: tuple[float, float], main: Machine
) -> dict[str, str]:
    """The kinds of file whose machines do not lay roads as wide as a design made them, from the
    least to the largest, mm, each with what is wrong; that of the design keeps to it.
    """
    low, high = widths
    found = {}
    for kind, machine in machines.items():
        least, most = machine.limits.road_width
        if machine != main and not least <= low <= high <= most:
            found[kind] = (
                f"the design's roads are {low:.3g} to {high:.3g} mm wide; {machine.name} lays "
                f"{least:g} to {most:g} mm"
            )
    return found


def check_fits(job: Job, part: body.Part, machine: Machine) -> None:
    """Raise `InputError` where part, layers or roads are beyond what the machine can do at all."""
    x0, y0, x1, y1 = part.bounds
    for size, room, axis in zip((x1 - x0, y1 - y0, part.height), machine.bed, "xyz", strict=True):
        if size > room:
            raise InputError(
                f"part: {size:g} mm along {axis}, and the bed of {machine.name} has {room:g} mm"
            )
    for name, value in (
        ("road_width", job.pattern.road_width),
        ("layer_height", job.part.layer_height),
    ):
        low, high = getattr(machine, name)
        if not low <= value <= high:
            raise InputError(f"{name}: {value:g} mm; {machine.name} lays {low:g} to {high:g} mm")


def check_lines(job: Job, part: body.Part, target: Target, machine: Machine) -> None:
    """Raise `InputError` where the target asks for less than one line in a layer."""
    solid = target.densest(part)
    height, wide = job.part.layer_height, job.pattern.road_width
    if job.pattern.width_is_free:
        wide = min(wide, machine.road_width[0])
    corners = smallest_rectangle(shapely.get_coordinates(part.slabs[0].region.geometry))
    across = float(min(np.hypot(*(corners[1] - corners[0])), np.hypot(*(corners[2] - corners[1]))))
    families = 2 if job.pattern.mode.startswith("both") else 1
    per_length = float(section_area(wide, height)) * families / height
    if solid * across < per_length:
        least = per_length / across
        raise InputError(
            f"target: at most {solid:.3g} solid is asked for, and the part is {across:.3g} mm "
            f"wide: less than one line a layer; lines {wide:g} mm wide can give {least:.2g} or "
            "more, a narrower pattern.road_width less"
        )


DEEP = 5.0
"""A tip that stays empty for more road widths than this is missed: a corner of 11 degrees is."""


def narrow_places(part: body.Part, road_width: float) -> tuple[list[str], list[str]]:
    """Where the part is narrower than a road, and so stays empty, in words: passages, polygons and
    arms, and beside them the tips of sharp corners.
    """
    places: tuple[list[str], list[str]] = [], []
    for region in part.regions:
        for neck in region.necks(road_width):
            where = f"({neck.x:.4g}, {neck.y:.4g})"
            tip = neck.depth <= DEEP * road_width
            places[tip].append(
                f"part: comes to a point at {where}, where {neck.depth:.2g} mm stay empty"
                if tip
                else f"part: {neck.width:.3g} mm wide at {where}, narrower than a road of "
                f"{road_width:g} mm"
            )
    return places


def origin_on(machine: Machine, part: body.Part) -> tuple[float, float]:
    """Where the part's (0, 0) goes so that the part lies in the middle of the bed, mm."""
    x0, y0, x1, y1 = part.bounds
    return (
        round(machine.bed_origin[0] + machine.bed[0] / 2 - (x0 + x1) / 2, 3),
        round(machine.bed_origin[1] + machine.bed[1] / 2 - (y0 + y1) / 2, 3),
    )
