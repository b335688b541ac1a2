"""Level sets of a function given on a raster. Loads no JAX."""

import contourpy
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_ASIDE = 1.2345e-7
"""Levels keep off the raster's values, where contouring repeats points and gives empty lines."""


def isolines(
    x: Floats, y: Floats, values: Floats, offset: float
) -> tuple[NDArray[np.intp], list[Floats]]:
    """The lines where a function is k + `offset`, k whole: the k of each and its points.

    `values` at x (n,) and y (m,), mm, has shape (n, m). Lines, (points, 2), have the higher side
    on their left; several may have one k.

    >>> x = np.linspace(0, 2, 5)
    >>> level, lines = isolines(x, x, np.add.outer(x, 0 * x), 0.5)
    >>> level.tolist(), lines[0][0].round(6).tolist()
    ([0, 1], [0.5, 2.0])
    """
    contours = contourpy.contour_generator(
        x, y, values.T - offset - _ASIDE, line_type=contourpy.LineType.Separate
    )
    low, high = float(values.min()) - offset, float(values.max()) - offset
    level: list[int] = []
    lines: list[Floats] = []
    for k in range(int(np.ceil(low)), int(np.floor(high)) + 1):
        found = contours.lines(k)
        level += [k] * len(found)
        lines += [np.asarray(line, float) for line in found]
    return np.array(level, int), lines
