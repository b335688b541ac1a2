"""What the part is to be: the porosity asked for at each point. Loads no JAX."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from dataclasses import field as data
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.arrays import namespace
from fdjax.errors import InputError
from fdjax.part.part import Part, Slab
from fdjax.target.expression import Expression
from fdjax.target.field import Field, field_of
from fdjax.units import length

Floats = NDArray[np.float64]
QUANTITIES = ("porosity", "solid")
_ROUNDING = 1e-9
"""What a target may stray beyond 0..1, from rounding alone."""
_LEVELS = 20
"""Layers at which a target is looked at, at most."""


@dataclass(frozen=True, eq=False)
class Target:
    """The porosity asked for, as a function of the place.

    - `field`: a function of x and y, or of x, y and z (arrays of one shape, in `unit`), that gives
      the quantity at each, as an `Expression`, a `Raster` or any JAX function is. See
      `fdjax.target.field.field_of` for how the two are told apart.
    - `quantity`: whether that is the `porosity` (void share, 0 to 1) or the `solid` share.
    - `unit`: the length unit in which the field takes x, y and z ("mm", "in", "mil", ...).
    - `text`: how a report names it.

    Calling it takes x, y and z in mm, z above the bed, as NumPy or JAX arrays of one shape or
    that broadcast, and gives the porosity there. It is differentiable wherever the field is.

    >>> target = Target(Expression("0.1 + 0.4*x/80"), quantity="solid")
    >>> round(float(target(40.0, 10.0)), 12)
    0.7
    """

    field: Callable[..., Any]
    quantity: str = "porosity"
    unit: str = "mm"
    text: str = "function"
    _field: Field = data(init=False, repr=False)

    def __post_init__(self) -> None:
        if not callable(self.field):
            raise InputError(f"target: {self.field!r} is no function of x and y")
        if self.quantity not in QUANTITIES:
            raise InputError(f'target: quantity "{self.quantity}" is neither porosity nor solid')
        _mm_per(self.unit)
        object.__setattr__(self, "_field", field_of(self.field))

    def __call__(self, x: Any, y: Any, z: Any = 0.0) -> Any:
        """Porosity at (x, y, z) mm, shape of these broadcast."""
        value = self._quantity_at(x, y, z)
        return value if self.quantity == "porosity" else 1.0 - value

    def solid(self, x: Any, y: Any, z: Any = 0.0) -> Any:
        """Solid share at (x, y, z) mm, which is one less the porosity."""
        return 1.0 - self(x, y, z)

    @property
    def varies_in_z(self) -> bool:
        """Whether the porosity may differ from layer to layer at one x and y."""
        return self._field.varies_in_z

    def is_flat_over(self, part: Part) -> bool:
        """Whether all layers of a part are alike: one region, and one target at each x and y."""
        return len(part.regions) == 1 and not self.varies_in_z

    def check(self, part: Part, *, samples: int = 200) -> None:
        """Raise `InputError` if the target leaves 0..1 or is not finite inside the part.

        Looked at are the layers' regions at their middles, of more than 20 these 20 evenly
        spread from the first to the last; where the target does not vary in z, each region once.
        In a region it is the points of a raster of `samples` x `samples` over its bounds that lie
        inside, and points along its edges equally close.
        """
        for points, z in self._looked_at(part, samples):
            self._check_at(points, z)

    def densest(self, part: Part, *, samples: int = 200) -> float:
        """Largest solid share asked at the places in the part that `check` looks at."""
        return max(
            float(self.solid(points[:, 0], points[:, 1], z).max())
            for points, z in self._looked_at(part, samples)
        )

    def _looked_at(self, part: Part, samples: int) -> Iterator[tuple[Floats, float]]:
        """Points all over the regions of some layers, with the height of each's middle."""
        slabs = part.slabs
        if not self.varies_in_z:
            slabs = tuple({id(slab.region): slab for slab in slabs}.values())
        chosen = np.unique(np.linspace(0, len(slabs) - 1, _LEVELS).round().astype(int))
        points: dict[int, Floats] = {}
        for slab in (slabs[k] for k in chosen):
            key = id(slab.region)
            if key not in points:
                points[key] = _points_in(slab, samples)
            yield points[key], slab.z - slab.height / 2

    def _check_at(self, points: Floats, z: float) -> None:
        values = np.asarray(self._quantity_at(points[:, 0], points[:, 1], z))
        with np.errstate(invalid="ignore"):
            excess = np.where(np.isfinite(values), np.abs(values - 0.5) - 0.5, np.inf)
        worst = int(np.argmax(excess))
        if excess[worst] > _ROUNDING:
            fault = "lie in 0..1" if np.isfinite(values[worst]) else "be finite"
            place = ", ".join(f"{c:.6g}" for c in (*points[worst], z)[: 2 + self.varies_in_z])
            raise InputError(
                f"target: {self.text} is {values[worst]:.6g} at ({place}) mm; "
                f"the {self.quantity} must {fault} everywhere inside the outline"
            )

    def _quantity_at(self, x: Any, y: Any, z: Any) -> Any:
        xp, mm = namespace(x, y, z), _mm_per(self.unit)
        x, y, z = xp.broadcast_arrays(*(xp.asarray(each, dtype=float) for each in (x, y, z)))
        with np.errstate(all="ignore"):
            given = self._field(x / mm, y / mm, z / mm)
        value = xp.asarray(np.nan if given is None else given)
        if given is None or value.dtype.kind not in "biuf":
            raise InputError(f"target: {self.text} gives {given!r:.60}; real numbers are needed")
        if value.shape not in ((), x.shape):
            raise InputError(
                f"target: {self.text} gives shape {value.shape} for points of shape {x.shape}"
            )
        return xp.broadcast_to(value, x.shape)


def expression(text: str, *, quantity: str = "porosity", unit: str = "mm") -> Target:
    """The target given by a formula in x, y and z (see `Expression`), these in `unit`.

    Raises `InputError` for what the formula may not hold.

    >>> round(float(expression("0.5 + x/10", unit="in")(25.4, 0.0)), 12)
    0.6
    """
    formula = Expression(text)
    return Target(formula, quantity, unit, f'{quantity} "{formula.text}"')


def _points_in(slab: Slab, samples: int) -> Floats:
    """Points all over a layer's region, shape (points, 2), mm."""
    region = slab.region.geometry
    x0, y0, x1, y1 = region.bounds
    step = max(x1 - x0, y1 - y0) / samples
    grid = np.meshgrid(np.linspace(x0, x1, samples), np.linspace(y0, y1, samples))
    raster = np.stack([axis.ravel() for axis in grid], 1)
    shapely.prepare(region)
    inside = shapely.contains_xy(region, raster)
    edges = shapely.get_coordinates(region.segmentize(step))
    return np.vstack([edges, raster[inside]])


def _mm_per(unit: str) -> float:
    if not (isinstance(unit, str) and unit.isalpha()):
        raise InputError(f'target: unit {unit!r} is no unit; write one like "mm" or "in"')
    return length(f"1{unit}", "target unit")
