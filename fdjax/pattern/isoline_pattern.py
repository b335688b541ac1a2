"""Isolines as roads: two functions of the place, the roads of each family where one is whole.

By the coarea formula (Federer 1959, 3.2.12) the length of centre line an area, averaged over the
phase, is |grad xi|: nothing has to be traced to know where the material goes.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fdjax.field.isolines import isolines
from fdjax.field.pointwise import place_by_place
from fdjax.field.spline import Axis, product
from fdjax.limits import Limits
from fdjax.pattern.base import Penalties
from fdjax.pattern.chart import (
    FLAT,
    ChartPattern,
    Controls,
    Lattice,
    Realised,
    density_of,
    width_bases,
)
from fdjax.road.bead import section_area
from fdjax.road.deposit import Raster
from fdjax.road.room import Room
from fdjax.road.stacking import FAMILIES, Scan, Stacking
from fdjax.road.stroke import APART, LONGEST_JOIN, Lines

SKEW = 0.8
"""Largest |cos| of the angle between the families."""

_TIGHT = 0.05
"""Between places looked at, lines of one phase come this share closer."""

_FINE = 8
"""Places between knots at which lines are traced."""


class IsolinePattern(ChartPattern):
    """The roads of a family lie where its function is k + phase, k whole.

    - `stacking`: which family's lines lie on which layer.

    `reach` is over the lines of the other family.
    """

    stacking: Stacking = eqx.field(static=True)

    def deposit(self, realised: Realised) -> Raster:
        """Lines by |grad| over the room for centre lines, and turn-arounds along its walls.

        Where a family runs into a wall the path turns along it between every second pair of
        neighbours, so half of the wall is covered; where it runs along the wall nothing is.
        """
        room, width = self.room, realised.width
        shares = tuple(map(self.stacking.layer_share, FAMILIES))
        run = _run(*realised.gradient[0], *realised.gradient[1], width, room, shares)
        return Raster(room.x, room.y, room.z, run * section_area(width, room.height) * room.layers)

    @property
    def correcting(self) -> int:
        # A plan joins its lines anew at the walls: what more would gain is lost there again.
        return 10

    def cells(self, realised: Realised) -> tuple[Array, Array, Array]:
        room = self.room
        xi, eta = map(self.stacking.layer_share, FAMILIES)
        run = xi * realised.density[0] + eta * realised.density[1]
        solid = run * section_area(realised.width, room.height) / room.height
        volume = room.area_at(realised.width / 2) * room.height * room.layers
        points, volumes = Raster(room.x, room.y, room.z, volume).points
        return points, 1 - solid.reshape(-1), volumes

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        # Away from the room lines may do as they like.
        inside = self.room.area[0] > 0
        least = (limits.least_spacing or realised.width) * (1 + _TIGHT)
        least = jnp.broadcast_to(least, inside.shape)
        skew, *others = _excess(
            *realised.gradient[0], *realised.gradient[1], least, self.reach, inside
        )
        kinds = {"skew": [skew], "spacing": others[:2], "span": others[2:]}
        share = jnp.sqrt(inside.sum() / inside.size)
        return {name: jnp.stack(some).ravel() / share for name, some in kinds.items()}

    def strokes(self, controls: Controls) -> Iterator[Sequence[Lines]]:
        xi, eta = (np.asarray(each) for each in self.coefficients(controls))
        places = [_between_knots(axis) for axis in self.axes[:2]]
        x, y = (axis.basis(at) for axis, at in zip(self.axes, places, strict=False))
        width = np.asarray(self.width_at(controls, width_bases(self.axes, controls.width, places)))
        flat = self.axes[2].count == 1
        values: dict[tuple[str, float], np.ndarray] = {}
        made: dict[tuple[Scan, float], Lines] = {}
        for z, scans in zip(self.middles, self.stacking.scans, strict=True):
            layer = []
            for scan in scans:
                height = 0.0 if flat else z
                of, at = (scan.family, height), (scan, height)
                if of not in values:
                    function = (xi, eta)[FAMILIES.index(scan.family)]
                    basis = self.axes[2].basis(np.array([z]))
                    values[of] = product(function, x, y, basis)[..., 0]
                if at not in made:
                    made[at] = _lines(places, values[of], width[..., 0], scan)
                layer.append(made[at])
            yield layer

    def facts(self, controls: Controls) -> dict[str, Any]:
        """Lines, knots, spacings, and the P = lap(xi) and Q = lap(eta) of eq. (5) inside."""
        inside = np.asarray(self.room.area)[0] > 0
        lattice = Lattice(*map(np.asarray, self.lattice))
        functions = [np.asarray(each) for each in self.coefficients(controls)]
        slopes = lattice.gradient(np.stack(functions))
        density = np.hypot(slopes[:, 0], slopes[:, 1])[:, inside]
        spacing = {
            family: [float(1 / own.max()), float(1 / max(own.min(), FLAT))]
            for family, own in zip(FAMILIES, density, strict=True)
        }
        sources = {
            name: values[inside]
            for name, values in zip(("p", "q"), self.laplacians(controls), strict=True)
        }
        return {
            "kind": "isolines",
            "coefficients": [axis.count for axis in self.axes],
            "knot_distance": [axis.step for axis in self.axes[:2]],
            "phases": self.stacking.phases,
            "spacing": spacing,
            "laplacians": {name: [float(v.min()), float(v.max())] for name, v in sources.items()},
            "warnings": self._warnings(max(each[0] for each in spacing.values())),
        }

    def _warnings(self, densest: float) -> list[str]:
        step = min(axis.step for axis in self.axes[:2])
        if step < densest:
            return [
                f"knots: {step:.3g} mm apart, finer than the roads' spacing of {densest:.3g} mm "
                "where it is least; the lines cannot show what such knots say"
            ]
        return []


@place_by_place
def _excess(
    ax: Array, ay: Array, bx: Array, by: Array, least: Array, reach: float, inside: Array
) -> tuple[Array, ...]:
    """By how much two gradients, 1/mm, break the limit of skew, of both families' spacing, `least`
    (mm), and of both families' span, `reach` (mm); -1 where not `inside`.
    """
    first, second = density_of(ax, ay), density_of(bx, by)
    across = jnp.abs(ax * by - ay * bx)
    broken = (
        jnp.abs(ax * bx + ay * by) / (first * second) / SKEW - 1,
        *(each * least - 1 for each in (first, second)),
        # The lines of one family are bridges between those of the other.
        *(1 - reach * across / other for other in (first, second)),
    )
    return tuple(jnp.where(inside, each, -1.0) for each in broken)


@place_by_place
def _run(
    ax: Array, ay: Array, bx: Array, by: Array, width: Array, room: Room, shares: tuple[float, ...]
) -> Array:
    """Road (mm) in each cell and layer, (n, m, p), of two families with gradients a and b, 1/mm,
    each on a share of the layers.
    """
    lines, turns = jnp.zeros(()), jnp.zeros(())
    along_x, along_y = room.along[:, 0], room.along[:, 1]
    one = width.size == 1
    own = width.ravel() if one else room.at_walls(jnp.broadcast_to(width, ax.shape))
    for share, x, y in zip(shares, (ax, bx), (ay, by), strict=True):
        lines = lines + share * density_of(x, y)
        ends = room.at_walls(x), room.at_walls(y)
        turns = turns + share * _turned(*ends, along_x, along_y, own)
    return room.add_at_walls(lines * room.area_at(width / 2), turns)


def _turned(gx: Array, gy: Array, along_x: Array, along_y: Array, width: Array) -> Array:
    """Road (mm) that turning around takes at pieces of wall, less what lines end early for it.

    - `gx`, `gy`: of grad xi, 1/mm; `along_x`, `along_y`: of the pieces, mm; `width`: of roads, mm.

    Half the wall, where the next end is within `LONGEST_JOIN` and the lines do not run along it
    (below `_ALONG`). Where they meet it at a small angle (below `_WEDGE`) they end early by
    `APART` widths over its sine, and the join begins across the wedge.
    """
    density, length = density_of(gx, gy), jnp.sqrt(along_x**2 + along_y**2)
    ends = jnp.abs(gx * along_x + gy * along_y) / length
    sine = ends / density
    joined = jax.nn.sigmoid(12 * (LONGEST_JOIN * ends - 1)) * jax.nn.sigmoid((sine - _ALONG) * 60)
    early = jax.nn.sigmoid((_WEDGE - sine) * 30) * APART * width * (density - ends / 2)
    return length * joined * (0.5 - early)


_ALONG, _WEDGE = 0.07, 0.35
"""Sines of 4 and of 20 degrees, as plans were seen to go."""


def _between_knots(axis: Axis) -> np.ndarray:
    count = int(np.clip(_FINE * (axis.count - 3), 64, 1600)) + 1
    return np.linspace(axis.low, axis.high, count)


def _lines(places: list[np.ndarray], values: np.ndarray, width: np.ndarray, scan: Scan) -> Lines:
    level, xy = isolines(places[0], places[1], values, (scan.phase + 0.5) / scan.phases)
    if width.size == 1:
        widths = [np.full(len(line) - 1, float(width[0, 0])) for line in xy]
    else:
        widths = [_sampled(places, width, (line[1:] + line[:-1]) / 2) for line in xy]
    return Lines(scan.family, scan.parity, level, xy, widths)


def _sampled(places: list[np.ndarray], values: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Values of a fine lattice at the nearest of its places, (n,)."""
    index = [
        np.clip(np.round((xy[:, k] - at[0]) / (at[1] - at[0])).astype(int), 0, len(at) - 1)
        for k, at in enumerate(places)
    ]
    return values[index[0], index[1]]
