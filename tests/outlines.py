"""Outlines of all kinds, about 80 mm across, that designs and plans are tried on."""

from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon, box

from fdjax.part.contour import contour


def _disc(x: float, y: float, radius: float, points: int = 180) -> Polygon:
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    return Polygon(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], 1))


def square() -> Polygon:
    return box(0, 0, 80, 80)


def disc() -> Polygon:
    return _disc(40, 40, 40)


def ring() -> Polygon:
    return Polygon(disc().exterior, [_disc(40, 40, 15).exterior])


def ell() -> Polygon:
    return Polygon([(0, 0), (80, 0), (80, 35), (35, 35), (35, 80), (0, 80)])


def bay() -> Polygon:
    """A U with a bay of 30 x 55."""
    return box(0, 0, 80, 80).difference(box(25, 25, 55, 90))


def kidney() -> Polygon:
    t = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    r = 30 + 9 * np.cos(t) - 6 * np.cos(2 * t)
    return _fitted(Polygon(np.stack([r * np.cos(t) * 1.1, r * np.sin(t) * 1.3], 1)))


def star() -> Polygon:
    """Five points, rounded."""
    t = np.pi / 2 + np.arange(10) * np.pi / 5
    r = np.where(np.arange(10) % 2, 20, 42)
    spiky = Polygon(np.stack([r * np.cos(t), r * np.sin(t)], 1))
    return _fitted(spiky.buffer(-3).buffer(6).buffer(-3))


def triangle() -> Polygon:
    return Polygon([(0, 0), (80, 0), (40, 40 * np.sqrt(3))])


def three_holes() -> Polygon:
    holes = [_disc(22, 22, 9), _disc(60, 30, 8), _disc(36, 60, 10)]
    return Polygon(box(0, 0, 80, 80).exterior, [hole.exterior for hole in holes])


def disc_with_two_holes() -> Polygon:
    return Polygon(disc().exterior, [_disc(24, 36, 8).exterior, _disc(56, 46, 6).exterior])


def insole() -> Polygon:
    """The example's, 80 mm long."""
    source = Path(__file__).parents[1] / "examples" / "insole.geojson"
    return _fitted(contour(source))


def _fitted(polygon: Polygon) -> Polygon:
    """Scaled to a largest side of 80 mm, its box's corner at (0, 0)."""
    x0, y0, x1, y1 = polygon.bounds
    scale = 80 / max(x1 - x0, y1 - y0)
    return shapely.transform(polygon, lambda xy: (xy - [x0, y0]) * scale)


OUTLINES = {
    "square": square, "disc": disc, "ring": ring, "L": ell, "U": bay, "kidney": kidney,
    "star": star, "triangle": triangle, "three holes": three_holes, "insole": insole,
}  # fmt: skip
"""The outlines by name."""
