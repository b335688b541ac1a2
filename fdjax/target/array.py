"""Targets given by arrays, and by the files that hold them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fdjax.errors import InputError
from fdjax.target.raster import Extent, Raster
from fdjax.target.target import Target


def array(
    source: str | Path | ArrayLike,
    *,
    extent: Extent,
    quantity: str = "porosity",
    low: float = 0.0,
    high: float = 1.0,
) -> Target:
    """The target given by an array, or by the `.npy` file that holds one, over a box in mm.

    Axis 0 of the array is x, axis 1 is y, both rising; see `Raster` for what lies between. A
    value v stands for `low + v (high - low)`. Raises `InputError`, naming the file, for one that
    is missing, is no `.npy`, holds Python objects, or is empty, not two-dimensional, not real or
    not finite.
    """
    name = str(source) if isinstance(source, str | Path) else "array"
    values = _load_array(Path(name)) if isinstance(source, str | Path) else np.asarray(source)
    return sampled(values, name, extent, quantity, low, high)


def sampled(
    values: Any,
    name: str,
    extent: Extent,
    quantity: str,
    low: float,
    high: float,
    *,
    gaps: bool = False,
) -> Target:
    """The target of values over a box in mm, as `array`; `name` is for errors.

    With `gaps`, values that are not numbers are places without a target.
    """
    if values.dtype.kind not in "buif":
        raise InputError(f"{name}: values of type {values.dtype}; real numbers are needed")
    if values.ndim != 2:
        raise InputError(f"{name}: {values.ndim} axes; two are needed, x and y")
    if values.size == 0:
        raise InputError(f"{name}: is empty (shape {values.shape})")
    values = values.astype(float)
    if not (gaps or np.isfinite(values).all()):
        i, j = np.argwhere(~np.isfinite(values))[0]
        raise InputError(f"{name}: value [{i}, {j}] is {values[i, j]}; all must be finite")
    samples = Raster(low + values * (high - low), extent)
    return Target(samples, quantity, text=f"{quantity} of {Path(name).name}")


def _load_array(path: Path) -> NDArray[Any]:
    try:
        # A memory map finds a file that is shorter than its header says before reserving room.
        values = np.load(path, mmap_mode="r", allow_pickle=False)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as fault:
        raise InputError(f"{path}: cannot be read: {fault.strerror or fault}") from None
    except (ValueError, EOFError):
        raise InputError(f"{path}: is no whole .npy file of numbers") from None
    if not isinstance(values, np.ndarray):
        values.close()
        raise InputError(f"{path}: is an archive of arrays; one array (.npy) is needed")
    return np.array(values)
