"""Arcs of machine files as polylines."""

import math

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError

Point = tuple[float, float]

SAGITTA = 0.01
"""Largest distance between an arc and its polyline, mm."""


def arc_points(
    start: tuple[float, float], centre: tuple[float, float], sweep: float
) -> NDArray[np.float64]:
    """Points after `start` along the arc about `centre`, shape (n, 2), evenly spaced.

    `sweep` is in radians, counter-clockwise positive. Lengths in mm.

    >>> arc_points((1.0, 0.0), (0.0, 0.0), math.pi)[-1].round(9)
    array([-1.,  0.])
    """
    dx, dy = start[0] - centre[0], start[1] - centre[1]
    radius = math.hypot(dx, dy)
    step = 2 * math.acos(max(1 - SAGITTA / radius, 0.5)) if radius > 0 else math.pi
    count = max(2, math.ceil(abs(sweep) / step))
    angle = sweep * np.arange(1, count + 1) / count
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([centre[0] + dx * cos - dy * sin, centre[1] + dx * sin + dy * cos], 1)


def between(start: Point, end: Point, centre: Point, turn: int) -> list[Point]:
    """Points after `start` along the arc to `end`; `turn` is 1 counter-clockwise, -1 clockwise.

    Where start and end are one point, a full circle.
    """
    angles = [math.atan2(p[1] - centre[1], p[0] - centre[0]) for p in (start, end)]
    sweep = (angles[1] - angles[0]) * turn % (2 * math.pi) or 2 * math.pi
    points = arc_points(start, centre, turn * sweep)
    points[-1] = end
    return [(x, y) for x, y in points.tolist()]


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
