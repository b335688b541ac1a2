"""Isolines as roads: what a user says of them, and how they begin.

Straight lines, as dense across as the target asks, twisted about the middle: how many lines end a
mm of wall follows from their number alone, but lines that run obliquely inside are dense there.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from fdjax.errors import InputError
from fdjax.field.poisson import Poisson
from fdjax.field.spline import Axis
from fdjax.keys import choices, key, number, pair, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.base import AbstractSettings, mode_key, phases_key, road_width_key
from fdjax.pattern.isoline_pattern import Controls, IsolinePattern, Lattice, waves_of, width_bases
from fdjax.pattern.reach import check_reachable
from fdjax.pattern.straight import profiles
from fdjax.pattern.width import free_of
from fdjax.road.bead import section_area
from fdjax.road.deposit import Raster
from fdjax.road.room import Room
from fdjax.road.stacking import FAMILIES
from fdjax.target.target import Target

CELLS = {True: 6, False: 4}
"""Cells to a window's side at which design looks, where all layers are alike and where not."""

KNOTS = {True: 0.72, False: 1.0}
"""Distance of the knots as a share of a window's side: lines cannot crowd faster than a knot."""


@dataclass(frozen=True)
class Isolines(AbstractSettings):
    """Isolines of two splines over a part, for any outline and target.

    Lengths in mm. See the job's keys for what each value means.
    """

    angle: float = key(
        number(-360, 360), "degrees from the x axis across the first lines, to begin with",
        default=0.0,
    )  # fmt: skip
    twist: float = key(
        number(-360, 360), "degrees by which the lines are turned in the middle, to begin with; "
        "twisted lines can crowd inside without crowding at the walls", default=90.0,
    )  # fmt: skip
    mode: str = mode_key()
    phases: int = phases_key()
    road_width: float = road_width_key()
    knots: tuple[int, int] | None = key(
        pair(whole(6, 400)), "spline coefficients along x and y", default=None,
        shown="by window", table="design",
    )  # fmt: skip
    field_knots: tuple[int, int] = key(
        pair(whole(4, 64)), "spline coefficients of a width field along x and y", default=[8, 8],
        table="design",
    )  # fmt: skip
    corrections: int = key(
        whole(0, 10), "times that what the plan lays beside the model is made up for", default=2,
        table="design",
    )  # fmt: skip
    controls: tuple[str, ...] = key(
        choices("coefficients", "p", "q", "width", "width_field"),
        "what the design may change: both functions' coefficients, or P and Q of eq. (5)",
        default=["coefficients"], table="design",
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name in ("angle", "twist"):
            if not np.isfinite(getattr(self, name)):
                raise InputError(f"{name}: {getattr(self, name)} is not finite")
        if "width" in self.controls and "width_field" in self.controls:
            raise InputError("controls: width and width_field exclude each other")
        if not {"coefficients", "p", "q"} & set(self.controls):
            raise InputError('controls: one of "coefficients", "p", "q" is needed')

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> "IsolinePattern":
        """Straight lines at `angle`, as dense across as the target asks.

        Raises `InputError` for a target beyond what spacing and span allow, and for a region with
        no room for a road.
        """
        stacking = self.stacking(len(part.slabs))
        flat = target.is_flat_over(part)
        widths = limits.road_width if self.width_is_free and limits.road_width[1] < np.inf else None
        low, high = widths or (self.road_width, self.road_width)
        margins = np.array([self.road_width / 2])
        if widths is not None:
            margins = np.unique([low / 2, (low + high) / 4, high / 2])
        room = Room.of(
            part, margins, side=window / CELLS[flat], thickness=window / CELLS[flat], flat=flat
        )
        axes = self._axes(part, window, flat)
        shares = stacking.layer_share(FAMILIES[0]), stacking.layer_share(FAMILIES[1])
        xyz, weight, solid = _asked(room, target)
        height = float(np.average(room.height, weights=room.layers))
        check_reachable(
            solid, xyz, height=height, shares=sum(shares), widths=(low, high), limits=limits
        )
        size = max(axes[0].high - axes[0].low, axes[1].high - axes[1].low)
        reach = min(limits.longest_span, size / 3)
        bounds = 1 / reach, 1 / (limits.least_spacing or self.road_width)
        area = float(section_area(self.road_width, height))
        first = _straight(
            axes,
            profiles(
                xyz[:, 0], xyz[:, 1], weight, solid * height / area,
                angle=np.radians(self.angle), shares=shares, bounds=bounds,
            ),
            self.twist,
        )  # fmt: skip
        sources = "p" in self.controls, "q" in self.controls
        poisson = Poisson.over(axes[0], axes[1]) if any(sources) else None
        xi, eta = (
            poisson.data(each) if poisson is not None and source else each
            for each, source in zip(first, sources, strict=True)
        )
        width = None
        if widths is not None:
            middle = free_of(self.road_width, low, high)
            width = np.full(self.field_knots if "width_field" in self.controls else (), middle)
        return IsolinePattern(
            first=Controls(
                jnp.asarray(xi), jnp.asarray(eta), None if width is None else jnp.asarray(width)
            ),
            axes=axes,
            lattice=Lattice.of(axes, room),
            room=jax.tree.map(jnp.asarray, room),
            poisson=None if poisson is None else jax.tree.map(jnp.asarray, poisson),
            waves=tuple(waves_of(axis) for axis in axes),
            width_bases=tuple(map(jnp.asarray, width_bases(axes, width, (room.x, room.y)))),
            width=self.road_width,
            width_range=(low, high),
            reach=reach,
            middles=tuple(part.middles.tolist()),
            stacking=stacking,
            sources=sources,
        )

    def _axes(self, part: Part, window: float, flat: bool) -> tuple[Axis, Axis, Axis]:
        x0, y0, x1, y1 = part.bounds
        box = (x0, x1), (y0, y1), (0.0, part.height)
        knots = self.knots or tuple(_knots(b - a, KNOTS[flat] * window) for a, b in box[:2])
        along_z = 1 if flat else _knots(part.height, window)
        return (
            Axis(*box[0], knots[0]),
            Axis(*box[1], knots[1]),
            Axis(*box[2], along_z),
        )


def _knots(length: float, step: float) -> int:
    return int(np.clip(np.ceil(length / step), 3, 200)) + 3


def _asked(room: Room, target: Target) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places in the room, (n, 3), their volumes and the solid share asked there."""
    volume = room.area[len(room.margin) // 2] * room.height * room.layers
    points, volumes = Raster(room.x, room.y, room.z, volume).points
    kept = volumes > 0
    xyz = points[kept]
    return xyz, np.asarray(volumes[kept]), np.asarray(target.solid(*xyz.T))


def _straight(axes: tuple[Axis, Axis, Axis], both: Any, twist: float) -> list[np.ndarray]:
    """Coefficients (K, L, M) of straight lines, twisted (degrees), alike at all heights."""
    places = [np.linspace(axis.low, axis.high, 4 * axis.count) for axis in axes[:2]]
    x, y = np.meshgrid(*places, indexing="ij")
    x, y = _twisted(x, y, np.radians(twist))
    fit = [axis.fit(at) for axis, at in zip(axes, places, strict=False)]
    return [
        np.repeat((fit[0] @ each.count(x, y) @ fit[1].T)[..., None], axes[2].count, 2)
        for each in both
    ]


def _twisted(x: np.ndarray, y: np.ndarray, twist: float) -> tuple[np.ndarray, np.ndarray]:
    """Places on a lattice turned about its middle, by `twist` radians there and less outwards."""
    middle_x, middle_y = (x[0, 0] + x[-1, -1]) / 2, (y[0, 0] + y[-1, -1]) / 2
    reach = max(np.ptp(x), np.ptp(y)) / 4
    right, up = x - middle_x, y - middle_y
    turn = twist * np.exp(-(right**2 + up**2) / reach**2)
    cosine, sine = np.cos(turn), np.sin(turn)
    return middle_x + cosine * right - sine * up, middle_y + sine * right + cosine * up
