"""Targets given by grey pictures."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

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

    The picture stands as a viewer shows it, turned as its tags say; its top row lies at the box's
    largest y, its left column at the smallest x. Grey values are taken as they stand, with no
    gamma; colours count by their luma; 1 to 32 bits. Where it is transparent there is no target.

    Raises `InputError`, naming the file, for one that is missing, broken, no picture, of one grey
    alone, or has half-transparent pixels; for several pages or frames; and for pixels of a type
    that is not certain (signed numbers, fractions, planes that may be slices).
    """
    values = _load_image(Path(path))
    return sampled(values, str(path), extent, quantity, low, high, gaps=True)


_WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC = 256, 257, 258, 262
_DESCRIPTION, _PLANES, _KIND = 270, 284, 339
"""TIFF tags: sides, bits of a sample, what 0 means; a text, whether colours lie apart, and the
type of numbers."""


def _load_image(path: Path) -> NDArray[np.float64]:
    from PIL import Image, ImageOps

    try:
        with Image.open(path) as picture:
            _refuse_stacks(picture, path)
            tags: Mapping[int, Any] = getattr(picture, "tag_v2", {})
            bits, kind = (tags.get(key, default) for key, default in ((_BITS, 0), (_KIND, 1)))
            inverted = tags.get(_PHOTOMETRIC) == 0
            if {_WIDTH, _HEIGHT} <= tags.keys():
                # Pillow 13 swaps the sides of a turned TIFF before it has decoded it.
                setattr(picture, "_size", (tags[_WIDTH], tags[_HEIGHT]))  # noqa: B010
            picture.load()
            picture = ImageOps.exif_transpose(picture)
            clear = _clear_pixels(picture, path)
            if picture.mode == "F":
                raise InputError(f"{path}: holds fractions; save them as a .npy array")
            if picture.mode.startswith("I"):
                grey = _deep(np.asarray(picture), _first(bits), _first(kind), inverted, path)
            else:
                grey = np.asarray(picture.convert("L"), dtype=float) / 255.0
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, SyntaxError, EOFError, Image.DecompressionBombError):
        raise InputError(f"{path}: is no picture that can be read") from None
    if not clear.any() and np.ptp(grey) == 0:
        raise InputError(f"{path}: is of one grey, {grey[0, 0]:.3g} of white; a number says that")
    return np.flipud(_without(grey, clear)).T


def _refuse_stacks(picture: Any, path: Path) -> None:
    # The second image of an MPO is a camera's preview of the first.
    count = 1 if picture.format == "MPO" else getattr(picture, "n_frames", 1)
    tags: Mapping[int, Any] = getattr(picture, "tag_v2", {})
    text = str(tags.get(_DESCRIPTION, ""))
    told = re.search(r"^images=(\d+)", text, re.MULTILINE)
    count = max(count, int(told[1]) if told else 1)
    shape = re.search(r'"shape": \[(\d+), (\d+), (\d+)', text)
    if shape and (int(shape[1]), int(shape[2])) != picture.size[::-1]:
        count = max(count, int(shape[1]))
    if count > 1:
        raise InputError(f"{path}: holds {count} pages, frames or slices; one is needed")
    if tags.get(_PLANES) == 2:
        raise InputError(f"{path}: holds planes that may be colours or slices; save one alone")


def _clear_pixels(picture: Any, path: Path) -> NDArray[np.bool_]:
    """Where a picture is transparent."""
    if "transparency" not in picture.info and "A" not in picture.getbands():
        return np.zeros(picture.size[::-1], bool)
    alpha = np.asarray(picture.convert("RGBA"))[..., 3]
    if ((alpha > 0) & (alpha < 255)).any() or not alpha.any():
        raise InputError(f"{path}: has half-transparent pixels, or no others; fill with a grey")
    return alpha == 0


def _deep(
    values: NDArray[Any], bits: int, kind: int, inverted: bool, path: Path
) -> NDArray[np.float64]:
    """Values of more than 8 bits as shares of white."""
    if kind != 1:
        raise InputError(f"{path}: holds signed numbers; save it with 8 or 16 bits, from 0 up")
    if bits > 16:
        # Pillow takes numbers from 0 to 2^32 for signed ones.
        values = values.astype(np.int64) & 0xFFFFFFFF
    grey = values / (2.0 ** (bits or 16) - 1)
    return 1 - grey if inverted else grey


def _first(tag: Any) -> int:
    """A tag that may have one value for each colour."""
    return int(tag[0] if isinstance(tag, tuple) else tag)


def _without(grey: NDArray[np.float64], clear: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Grey values with nan where it is clear, but for pixels beside others, which take theirs.

    So an outline that is drawn as the edge of what is clear lies inside.
    """
    if not clear.any():
        return grey
    known = np.pad(np.where(clear, 0.0, 1.0), 1)
    value = np.pad(np.where(clear, 0.0, grey), 1)
    rows, columns = grey.shape
    near = [(i, j) for i in range(3) for j in range(3)]
    count = sum(known[i : i + rows, j : j + columns] for i, j in near)
    total = sum(value[i : i + rows, j : j + columns] for i, j in near)
    with np.errstate(invalid="ignore"):
        return np.where(clear, total / np.where(count > 0, count, np.nan), grey)
