"""Arcs of machine files as polylines."""

import math

import numpy as np
from numpy.typing import NDArray

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
