"""Isolines of analytic fields as strokes, and regions of every sort, for tests of plans."""

from collections.abc import Callable

import contourpy
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Point, Polygon, box

from fdjax.road.stroke import Lines

Floats = NDArray[np.float64]
Field = Callable[[Floats, Floats], Floats]


def isolines(
    field: Field,
    bounds: tuple[float, float, float, float],
    *,
    width: float = 0.4,
    parity: int = 0,
    family: str = "xi",
    phase: float = 0.0,
    step: float = 0.25,
) -> Lines:
    """The lines field = k + phase over a box and 1 mm round it, on a raster of this step, mm."""
    x0, y0, x1, y1 = bounds
    x, y = np.arange(x0 - 1, x1 + 1 + step, step), np.arange(y0 - 1, y1 + 1 + step, step)
    # A level equal to a node's value would give lines of no length.
    values = field(*np.meshgrid(x, y)) - phase - 1.2345e-7
    contours = contourpy.contour_generator(x, y, values, line_type=contourpy.LineType.Separate)
    level, xy = [], []
    for k in range(int(np.ceil(values.min())), int(np.floor(values.max())) + 1):
        for line in contours.lines(k):
            level.append(k)
            xy.append(np.asarray(line, float))
    widths = [np.full(len(line) - 1, width) for line in xy]
    return Lines(family, parity, np.array(level, int), xy, widths)


def straight(degrees: float, spacing: float) -> Field:
    """Lines in this direction."""
    angle = np.radians(degrees)
    return lambda x, y: (np.cos(angle) * y - np.sin(angle) * x) / spacing


def graded(degrees: float, least: float, most: float, size: float = 80.0) -> Field:
    """Straight lines, their spacing growing from `least` to `most` over 1.4 sizes across."""
    angle = np.radians(degrees)

    def field(x: Floats, y: Floats) -> Floats:
        across = np.cos(angle) * (y - size / 2) - np.sin(angle) * (x - size / 2)
        share = across / (1.42 * size) + 0.5
        return 1.42 * size * np.log1p((most / least - 1) * share) / (most - least)

    return field


def bump(degrees: float, spacing: float) -> Field:
    """Lines that bend round the middle of an 80 mm part."""
    line = straight(degrees, spacing)
    return lambda x, y: line(x, y) + 3.6 / spacing * np.exp(-((x - 35) ** 2 + (y - 45) ** 2) / 450)


def conformal(spacing: float, rate: float = 0.015) -> Field:
    """e^(kx) cos(ky): isolines of an analytic function."""
    return lambda x, y: np.exp(rate * (x - 40)) * np.cos(rate * (y - 40) + 0.5) / (rate * spacing)


def random_field(rng: np.random.Generator, size: float) -> Field:
    """Lines in any direction with waves that may turn them, and at times close them."""
    base = straight(rng.uniform(0, 360), rng.uniform(0.6, 2.5))
    waves = [
        (rng.uniform(0, 2.5), *(rng.uniform(-1, 1, 2) * 8 / size), rng.uniform(0, 6.3))
        for _ in range(3)
    ]
    return lambda x, y: base(x, y) + sum(a * np.sin(p * x + q * y + r) for a, p, q, r in waves)


def random_region(rng: np.random.Generator, size: float) -> Polygon | MultiPolygon:
    """Several polygons or one, with holes, bays and slivers."""
    shapes = []
    for _ in range(rng.integers(1, 5)):
        x, y = rng.uniform(0, size, 2)
        disc = Point(x, y).buffer(rng.uniform(0.1, 0.5) * size, quad_segs=int(rng.integers(2, 24)))
        w, h = rng.uniform(0.2, 1, 2) * size
        turned = shapely.affinity.rotate(box(x - w / 2, y - h / 2, x + w / 2, y + h / 2),
                                         rng.uniform(0, 90))  # fmt: skip
        shapes.append(disc if rng.random() < 0.5 else turned)
    region = shapely.union_all(shapes)
    for _ in range(rng.integers(0, 6)):
        x, y = rng.uniform(0, size, 2)
        slot = shapely.LineString([(x, y), (x + rng.normal(0, size / 3), y + rng.normal(0, 9))])
        region = region.difference(slot.buffer(rng.uniform(0.05, 2.5), quad_segs=6))
    parts = [part for part in shapely.get_parts(region) if part.buffer(-0.4).area > 0]
    return MultiPolygon(parts) if len(parts) > 1 else parts[0]
