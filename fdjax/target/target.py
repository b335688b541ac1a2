"""What the part is to be: the porosity asked for at each point of a layer. Loads no JAX."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from fdjax.arrays import namespace
from fdjax.errors import InputError
from fdjax.target.expression import Expression
from fdjax.target.raster import Extent, Raster
from fdjax.units import length

Floats = NDArray[np.float64]
QUANTITIES = ("porosity", "solid")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".gif", ".pgm")
_ROUNDING = 1e-9
"""What a target may stray beyond 0..1, from rounding alone."""


@dataclass(frozen=True, eq=False)
class Target:
    """The porosity asked for, as a function of the place.

    - `field`: a function of x and y (arrays of one shape, in `unit`) that gives the quantity at
      each, as an `Expression`, a `Raster` or any JAX function is.
    - `quantity`: whether that is the `porosity` (void share, 0 to 1) or the `solid` share.
    - `unit`: the length unit in which the field takes x and y ("mm", "in", "mil", ...).
    - `text`: how a report names it.

    Calling it takes x and y in mm, as NumPy or JAX arrays of one shape or that broadcast, and
    gives the porosity there. It is differentiable in x and y wherever the field is.

    >>> target = Target(Expression("0.1 + 0.4*x/80"), quantity="solid")
    >>> round(float(target(40.0, 10.0)), 12)
    0.7
    """

    field: Callable[[Any, Any], Any]
    quantity: str = "porosity"
    unit: str = "mm"
    text: str = "function"

    def __post_init__(self) -> None:
        if not callable(self.field):
            raise InputError(f"target: {self.field!r} is no function of x and y")
        if self.quantity not in QUANTITIES:
            raise InputError(f'target: quantity "{self.quantity}" is neither porosity nor solid')
        _mm_per(self.unit)

    def __call__(self, x: Any, y: Any) -> Any:
        """Porosity at (x, y) mm, shape of x and y broadcast."""
        value = self._quantity_at(x, y)
        return value if self.quantity == "porosity" else 1.0 - value

    def solid(self, x: Any, y: Any) -> Any:
        """Solid share at (x, y) mm, which is one less the porosity."""
        return 1.0 - self(x, y)

    def check(self, outline: shapely.Polygon, *, samples: int = 200) -> None:
        """Raise `InputError` if the target leaves 0..1 or is not finite inside the outline.

        Looked at are the points of a raster of `samples` x `samples` over the outline's bounds
        that lie inside, and points along its edges equally close.
        """
        x0, y0, x1, y1 = outline.bounds
        step = max(x1 - x0, y1 - y0) / samples
        grid = np.meshgrid(np.linspace(x0, x1, samples), np.linspace(y0, y1, samples))
        raster = np.stack([axis.ravel() for axis in grid], 1)
        inside = shapely.contains_xy(outline, raster)
        edges = shapely.get_coordinates(outline.segmentize(step))
        points = np.vstack([edges, raster[inside]])
        values = np.asarray(self._quantity_at(points[:, 0], points[:, 1]))
        with np.errstate(invalid="ignore"):
            excess = np.where(np.isfinite(values), np.abs(values - 0.5) - 0.5, np.inf)
        worst = int(np.argmax(excess))
        if excess[worst] > _ROUNDING:
            fault = "lie in 0..1" if np.isfinite(values[worst]) else "be finite"
            raise InputError(
                f"target: {self.text} is {values[worst]:.6g} at "
                f"({points[worst, 0]:.6g}, {points[worst, 1]:.6g}) mm; "
                f"the {self.quantity} must {fault} everywhere inside the outline"
            )

    def _quantity_at(self, x: Any, y: Any) -> Any:
        xp, mm = namespace(x, y), _mm_per(self.unit)
        x, y = xp.broadcast_arrays(xp.asarray(x, dtype=float), xp.asarray(y, dtype=float))
        with np.errstate(all="ignore"):
            value = xp.asarray(self.field(x / mm, y / mm))
        if value.shape not in ((), x.shape):
            raise InputError(
                f"target: {self.text} gives shape {value.shape} for points of shape {x.shape}"
            )
        return xp.broadcast_to(value, x.shape)


def expression(text: str, *, quantity: str = "porosity", unit: str = "mm") -> Target:
    """The target given by a formula in x and y (see `Expression`), these in `unit`.

    Raises `InputError` for what the formula may not hold.

    >>> round(float(expression("0.5 + x/10", unit="in")(25.4, 0.0)), 12)
    0.6
    """
    formula = Expression(text)
    return Target(formula, quantity, unit, f'{quantity} "{formula.text}"')


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
    return _sampled(values, name, extent, quantity, low, high)


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
    return _sampled(_load_image(Path(path)), str(path), extent, quantity, low, high)


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
    if suffix in IMAGE_SUFFIXES:
        return image(source, extent=extent, quantity=quantity, low=low, high=high)
    return expression(source, quantity=quantity, unit=unit)


def _mm_per(unit: str) -> float:
    if not (isinstance(unit, str) and unit.isalpha()):
        raise InputError(f'target: unit {unit!r} is no unit; write one like "mm" or "in"')
    return length(f"1{unit}", "target unit")


def _sampled(
    values: Any, name: str, extent: Extent, quantity: str, low: float, high: float
) -> Target:
    if values.dtype.kind not in "buif":
        raise InputError(f"{name}: values of type {values.dtype}; real numbers are needed")
    if values.ndim != 2:
        raise InputError(f"{name}: {values.ndim} axes; two are needed, x and y")
    if values.size == 0:
        raise InputError(f"{name}: is empty (shape {values.shape})")
    values = values.astype(float)
    if not np.isfinite(values).all():
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


def _load_image(path: Path) -> Floats:
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
