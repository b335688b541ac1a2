"""What a user says of any pattern drawn in a chart of two splines, and how its chart begins."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.field.poisson import Poisson
from fdjax.field.spline import Axis
from fdjax.keys import choices, key, number, pair, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.base import AbstractSettings, road_width_key
from fdjax.pattern.chart import Controls, Lattice, waves_of, width_bases
from fdjax.pattern.reach import check_reachable
from fdjax.pattern.width import free_of
from fdjax.road.bead import section_area
from fdjax.road.deposit import Raster
from fdjax.road.room import Room
from fdjax.target.target import Target

Floats = NDArray[np.float64]

CELLS = {True: 6, False: 4}
"""Cells to a window's side at which design looks, where all layers are alike and where not."""

KNOTS = {True: 0.72, False: 1.0}
"""Distance of the knots as a share of a window's side: lines cannot crowd faster than a knot."""

LEAST = 160
"""Coefficients that a function has at least, in a part of few windows too: with fewer the arms of a
small part, a few roads wide, do not get what each of them asks, and a design moves so few controls
without the scaled and damped first steps that straight lines need."""


class Start(NamedTuple):
    """What a chart begins from.

    - `axes`: of the splines; `room`: for centre lines; `reach`: longest span, mm.
    - `xyz`, `weight`, `demand`: places in the room (n, 3), mm, their volumes, and the centre line
      an area that is asked there, 1/mm.
    - `widths`: least and largest road width, mm; `middles`: of the layers, mm.
    """

    axes: tuple[Axis, Axis, Axis]
    room: Room
    reach: float
    xyz: Floats
    weight: Floats
    demand: Floats
    widths: tuple[float, float]
    middles: tuple[float, ...]


@dataclass(frozen=True)
class ChartSettings(AbstractSettings):
    """Keys of the patterns that are drawn in a chart of two splines. Lengths in mm."""

    angle: float = key(
        number(-360, 360), "degrees by which the pattern is turned, to begin with", default=0.0
    )
    twist: float = key(
        number(-360, 360), "degrees by which the lines are turned in the middle, to begin with; "
        "twisted lines can crowd inside without crowding at the walls", default=90.0,
    )  # fmt: skip
    road_width: float = road_width_key()
    knots: tuple[int, int] | None = key(
        pair(whole(6, 400)), "spline coefficients along x and y", default=None,
        shown="by window", table="design",
    )  # fmt: skip
    field_knots: tuple[int, int] = key(
        pair(whole(4, 64)), "spline coefficients of a width field along x and y", default=[8, 8],
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

    def start(
        self,
        part: Part,
        target: Target,
        limits: Limits,
        window: float,
        *,
        lengths: tuple[float, float],
    ) -> Start:
        """What the chart of a part begins from; `lengths` as in `reach.check_reachable`.

        Raises `InputError` for a target beyond what spacing and span allow, and for a region with
        no room for a road.
        """
        flat = target.is_flat_over(part)
        free = self.width_is_free and limits.road_width[1] < np.inf
        low, high = limits.road_width if free else (self.road_width, self.road_width)
        margins = np.array([self.road_width / 2])
        if free:
            margins = np.unique([low / 2, (low + high) / 4, high / 2])
        room = Room.of(
            part, margins, side=window / CELLS[flat], thickness=window / CELLS[flat], flat=flat
        )
        axes = self._axes(part, window, flat)
        xyz, weight, solid = _asked(room, target)
        height = float(np.average(room.height, weights=room.layers))
        check_reachable(
            solid, xyz, height=height, lengths=lengths, widths=(low, high), limits=limits
        )
        size = max(axes[0].high - axes[0].low, axes[1].high - axes[1].low)
        return Start(
            axes,
            room,
            min(limits.longest_span, size / 3),
            xyz,
            weight,
            solid * height / float(section_area(self.road_width, height)),
            (low, high),
            tuple(part.middles.tolist()),
        )

    def chart(
        self,
        start: Start,
        xi: Floats,
        eta: Floats,
        *,
        times: Floats | None = None,
        finest: float = 1.0,
    ) -> dict[str, Any]:
        """The fields of a `ChartPattern`, from its first coefficients."""
        axes, room = start.axes, start.room
        sources = "p" in self.controls, "q" in self.controls
        poisson = Poisson.over(axes[0], axes[1]) if any(sources) else None
        xi, eta = (
            poisson.data(each) if poisson is not None and source else each
            for each, source in zip((xi, eta), sources, strict=True)
        )
        width = None
        low, high = start.widths
        if low < high:
            middle = free_of(self.road_width, low, high)
            width = np.full(self.field_knots if "width_field" in self.controls else (), middle)
        return {
            "first": Controls(*jax.device_put((xi, eta, width, times))),
            "axes": axes,
            "lattice": Lattice.of(axes, room),
            "room": jax.device_put(room),
            "poisson": jax.device_put(poisson),
            "waves": tuple(waves_of(axis) for axis in axes),
            "width_bases": jax.device_put(tuple(width_bases(axes, width, (room.x, room.y)))),
            "width": self.road_width,
            "width_range": start.widths,
            "reach": start.reach,
            "middles": start.middles,
            "sources": sources,
            "finest": finest,
        }

    def _axes(self, part: Part, window: float, flat: bool) -> tuple[Axis, Axis, Axis]:
        x0, y0, x1, y1 = part.bounds
        box = (x0, x1), (y0, y1), (0.0, part.height)
        along_z = 1 if flat else _knots(part.height, window)
        step = KNOTS[flat] * window
        knots = self.knots or tuple(_knots(b - a, step) for a, b in box[:2])
        while self.knots is None and along_z * math.prod(knots) < LEAST:
            step *= 0.95
            knots = tuple(_knots(b - a, step) for a, b in box[:2])
        return (
            Axis(*box[0], knots[0]),
            Axis(*box[1], knots[1]),
            Axis(*box[2], along_z),
        )


def spline_of(axes: tuple[Axis, Axis, Axis], places: Sequence[Floats], values: Floats) -> Floats:
    """Coefficients (K, L, M), alike at all heights, from values (n, m) at places along x and y."""
    fit = [axis.fit(at) for axis, at in zip(axes, places, strict=False)]
    return np.repeat((fit[0] @ values @ fit[1].T)[..., None], axes[2].count, 2)


def twisted(x: np.ndarray, y: np.ndarray, twist: float) -> tuple[np.ndarray, np.ndarray]:
    """Places on a lattice turned about its middle, by `twist` radians there and less outwards."""
    middle_x, middle_y = (x[0, 0] + x[-1, -1]) / 2, (y[0, 0] + y[-1, -1]) / 2
    reach = max(np.ptp(x), np.ptp(y)) / 4
    right, up = x - middle_x, y - middle_y
    turn = twist * np.exp(-(right**2 + up**2) / reach**2)
    cosine, sine = np.cos(turn), np.sin(turn)
    return middle_x + cosine * right - sine * up, middle_y + sine * right + cosine * up


def _knots(length: float, step: float) -> int:
    return int(np.clip(np.ceil(length / step), 3, 200)) + 3


def _asked(room: Room, target: Target) -> tuple[Floats, Floats, Floats]:
    """Places in the room, (n, 3), their volumes and the solid share asked there."""
    volume = room.area[len(room.margin) // 2] * room.height * room.layers
    points, volumes = Raster(room.x, room.y, room.z, volume).points
    kept = volumes > 0
    xyz = points[kept]
    return xyz, np.asarray(volumes[kept]), np.asarray(target.solid(*xyz.T))
