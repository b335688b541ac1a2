"""Arcs of machine files as polylines; plain numbers, so that a sender loads no arrays."""

import math

from fdjax.errors import InputError

Point = tuple[float, float]

SAGITTA = 0.01
"""Largest distance between an arc and its polyline, mm."""


def arc_points(start: Point, centre: Point, sweep: float, *, chord: float = 0.0) -> list[Point]:
    """Points after `start` along the arc about `centre`, evenly spaced.

    `sweep` is in radians, counter-clockwise positive. Lengths in mm. With `chord`, the arc has as
    many pieces as that fits into its length, one at least; else they are fine.

    >>> x, y = arc_points((1.0, 0.0), (0.0, 0.0), math.pi)[-1]
    >>> round(x, 9), round(y, 9)
    (-1.0, 0.0)
    """
    dx, dy = start[0] - centre[0], start[1] - centre[1]
    radius = math.hypot(dx, dy)
    step = 2 * math.acos(max(1 - SAGITTA / radius, 0.5)) if radius > 0 else math.pi
    count = max(2, math.ceil(abs(sweep) / step))
    if chord:
        count = max(1, math.floor(abs(sweep) * radius / chord))
    points = []
    for number in range(1, count + 1):
        angle = sweep * number / count
        cos, sin = math.cos(angle), math.sin(angle)
        points.append((centre[0] + dx * cos - dy * sin, centre[1] + dx * sin + dy * cos))
    return points


def cubic_points(start: Point, leaving: Point, coming: Point, end: Point) -> list[Point]:
    """Points after `start` of the cubic with these control points, `SAGITTA` off it at most.

    >>> cubic_points((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0))
    [(3.0, 0.0)]
    """
    bends = [
        math.hypot(a[0] - 2 * b[0] + c[0], a[1] - 2 * b[1] + c[1])
        for a, b, c in ((start, leaving, coming), (leaving, coming, end))
    ]
    count = max(1, math.ceil(math.sqrt(6 * max(bends) / (8 * SAGITTA)) - 1e-9))
    points = []
    for number in range(1, count + 1):
        t = number / count
        a, b, c, d = (1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3
        points.append(
            (
                a * start[0] + b * leaving[0] + c * coming[0] + d * end[0],
                a * start[1] + b * leaving[1] + c * coming[1] + d * end[1],
            )
        )
    return [*points[:-1], end]


def between(
    start: Point, end: Point, centre: Point, turn: int, *, chord: float = 0.0
) -> list[Point]:
    """Points after `start` along the arc to `end`; `turn` is 1 counter-clockwise, -1 clockwise.

    Where start and end are one point, a full circle. `chord` is that of `arc_points`.
    """
    angles = [math.atan2(p[1] - centre[1], p[0] - centre[0]) for p in (start, end)]
    sweep = (angles[1] - angles[0]) * turn % (2 * math.pi) or 2 * math.pi
    return [*arc_points(start, centre, turn * sweep, chord=chord)[:-1], end]


def centre(start: Point, end: Point, radius: float, turn: int) -> Point:
    """Centre of the arc of this radius; the longer way round where the radius is negative.

    Raises `InputError` where no such arc spans the two points.
    """
    dx, dy = end[0] - start[0], end[1] - start[1]
    chord = math.hypot(dx, dy)
    if chord == 0 or abs(radius) < chord / 2 * (1 - 1e-4):
        raise InputError(f"no arc of radius {abs(radius):g} mm spans {chord:g} mm")
    away = math.sqrt(max(radius**2 - chord**2 / 4, 0.0)) / chord
    side = turn * math.copysign(1, radius)
    return (start[0] + dx / 2 - side * away * dy, start[1] + dy / 2 + side * away * dx)
