"""The cross-section of one road. Takes NumPy or JAX arrays alike and loads no JAX."""

from collections.abc import Callable
from typing import Any

from fdjax.arrays import namespace


def section_area(width: Any, height: Any) -> Any:
    """Area of a road's cross-section, mm^2.

    A stadium `h (w - h) + pi h^2 / 4` where the road is at least as wide as the layer is high,
    a circle `pi w^2 / 4` where it is narrower (a bridging strand); continuous at `w = h`, with a
    kink there. The stadium is the section that slicers for Marlin-kind machines agree on.
    `width` and `height` are positive, in mm, and broadcast against each other.

    >>> round(float(section_area(0.4, 0.2)), 6)
    0.071416
    """
    xp = namespace(width, height)
    stadium = height * (width - height) + xp.pi / 4 * height**2
    return xp.where(width >= height, stadium, xp.pi / 4 * width**2)[()]


def road_width(area: Any, height: Any) -> Any:
    """Width in mm of the road whose section has this area: the inverse of `section_area`.

    >>> round(float(road_width(section_area(0.4, 0.2), 0.2)), 12)
    0.4
    """
    xp = namespace(area, height)
    stadium = area / height + height * (1 - xp.pi / 4)
    circle = xp.sqrt(4 / xp.pi * xp.maximum(area, 1e-30))
    return xp.where(area >= xp.pi / 4 * height**2, stadium, circle)[()]


def footprint(width: Any, height: Any) -> Any:
    """What a road covers of a layer per length, times the layer's height, mm^2: a rectangle."""
    return width * height


SECTIONS: dict[str, Callable[[Any, Any], Any]] = {"volume": section_area, "coverage": footprint}
"""What a solid share counts of a road, from its width and height: the volume that is laid, which
counts twice where roads overlap, or what it covers seen from above, which counts once there."""
