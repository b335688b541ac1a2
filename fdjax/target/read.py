"""Targets named by one text, of whatever kind it is."""

from pathlib import Path

from fdjax.target.array import array
from fdjax.target.image import SUFFIXES, image
from fdjax.target.raster import Extent
from fdjax.target.target import Target, expression


def read(
    source: str,
    *,
    extent: Extent,
    quantity: str = "porosity",
    unit: str = "mm",
    low: float = 0.0,
    high: float = 1.0,
) -> Target:
    """The target named by one text: a `.npy` file, a picture's file, else an expression.

    `extent`, `low` and `high` are for files, `unit` is for expressions.
    """
    suffix = Path(source).suffix.lower()
    if suffix == ".npy":
        return array(source, extent=extent, quantity=quantity, low=low, high=high)
    if suffix in SUFFIXES:
        return image(source, extent=extent, quantity=quantity, low=low, high=high)
    return expression(source, quantity=quantity, unit=unit)
