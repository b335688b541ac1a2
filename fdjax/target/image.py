"""Targets given by grey pictures."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.target.array import sampled
from fdjax.target.raster import Extent
from fdjax.target.target import Target

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".gif", ".pgm")


def image(
    path: str | Path,
    *,
    extent: Extent,
    quantity: str = "porosity",
    low: float = 0.0,
    high: float = 1.0,
) -> Target:
    """The target given by a grey picture over a box in mm: black is `low`, white is `high`.

    The picture's top row lies at the box's largest y, its left column at the smallest x. Grey
    values are taken as they stand, with no gamma; colours count by their luma. 8 and 16 bit.
    Raises `InputError`, naming the file, for one that is missing, broken, no picture, or has
    transparent pixels.
    """
    return sampled(_load_image(Path(path)), str(path), extent, quantity, low, high)


def _load_image(path: Path) -> NDArray[np.float64]:
    from PIL import Image

    try:
        with Image.open(path) as picture:
            if "transparency" in picture.info or "A" in picture.getbands():
                alpha = np.asarray(picture.convert("RGBA"))[..., 3]
                if alpha.min() < 255:
                    raise InputError(f"{path}: has transparent pixels; fill them with a grey")
            if picture.mode == "F":
                raise InputError(f"{path}: holds fractions; save them as a .npy array")
            deep = picture.mode.startswith("I")
            grey = np.asarray(picture if deep else picture.convert("L"), dtype=float)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, SyntaxError, EOFError, Image.DecompressionBombError):
        raise InputError(f"{path}: is no picture that can be read") from None
    return np.flipud(grey / (65535.0 if deep else 255.0)).T
