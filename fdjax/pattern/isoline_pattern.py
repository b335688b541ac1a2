"""Isolines as roads: two functions of the place, the roads of each family where one is whole.

By the coarea formula (Federer 1959, 3.2.12) the length of centre line an area, averaged over the
phase, is |grad xi|: nothing has to be traced to know where the material goes.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.field.isolines import isolines
from fdjax.field.pointwise import place_by_place
from fdjax.field.poisson import Poisson
from fdjax.field.spline import Axis, product
from fdjax.limits import Limits
from fdjax.pattern.base import AbstractPattern, Panel, Penalties
from fdjax.pattern.width import within
from fdjax.road.bead import section_area
from fdjax.road.deposit import Raster
from fdjax.road.room import Room
from fdjax.road.stacking import FAMILIES, Scan, Stacking
from fdjax.road.stroke import APART, LONGEST_JOIN, Lines

jax.tree_util.register_static(Axis)

SKEW = 0.8
"""Largest |cos| of the angle between the families."""

_TIGHT = 0.05
"""Between places looked at, lines of one phase come this share closer."""

_SMOOTH = 1.6
"""A third derivative of one line over this length cubed, mm, is a roughness of one."""

_STEP = 5.0
"""Waves shorter than 2 pi times this, mm, are held back in the steps of a design."""

_FINE = 8
"""Places between knots at which lines are traced."""


class Controls(eqx.Module):
    """The real numbers that shape the lines.

    - `xi`, `eta`: spline coefficients of the two functions, shape (K, L, M); where P or Q is
      controlled, the data of `field.poisson.Poisson` instead.
    - `width`: road width as the free number of `width.within`, shape () or, as a spline over the
      box, (K', L'); None where it is given.
    """

    xi: Float[Array, "K L M"]
    eta: Float[Array, "K L M"]
    width: Float[Array, "..."] | None = None


class Lattice(NamedTuple):
    """The bases of the splines at the places where design looks, by axis, and their slopes.

    Arrays, NumPy's or JAX's: `x` (n, K), `y` (m, L), `z` (p, M), `slope_x`, `slope_y`.
    """

    x: Any
    y: Any
    z: Any
    slope_x: Any
    slope_y: Any

    @classmethod
    def of(cls, axes: tuple[Axis, Axis, Axis], room: Room) -> "Lattice":
        x, y, z = axes
        bases = (x.basis(room.x), y.basis(room.y), z.basis(room.z))
        return cls(*map(jnp.asarray, (*bases, x.basis(room.x, 1), y.basis(room.y, 1))))

    def gradient(self, coefficients: Any) -> tuple[Any, Any]:
        """Slopes along x and along y on the lattice, (n, m, p), 1/mm."""
        along_x = product(coefficients, self.slope_x, self.y, self.z)
        return along_x, product(coefficients, self.x, self.slope_y, self.z)


class Realised(NamedTuple):
    """What controls amount to: both functions' coefficients and, on the lattice, gradients,
    densities |grad| (1/mm) and road width (mm), shapes that broadcast to (n, m, p).
    """

    coefficients: tuple[Array, Array]
    gradient: tuple[tuple[Array, Array], tuple[Array, Array]]
    density: tuple[Array, Array]
    width: Array
    made: Bool[Array, ""]


class IsolinePattern(AbstractPattern):
    """The roads of a family lie where its function is k + phase, k whole.

    - `first`: the controls to start from.
    - `axes`: of the splines along x, y and z; `lattice`: their bases where design looks.
    - `room`: for centre lines.
    - `poisson`: solves for a function whose Laplacian is controlled; `sources`: which are.
    - `waves`: of each axis, by which steps are scaled.
    - `width_bases`: of a width field along x and y, where design looks.
    - `width`: road width, mm, where it is not a control; `width_range`: what it may be.
    - `reach`: longest span of a road over the lines of the other family, mm.
    - `middles`: height of the middle of each layer, mm.
    """

    first: Controls
    lattice: Lattice
    room: Room
    poisson: Poisson | None
    waves: tuple[tuple[Array, Array], ...]
    width_bases: tuple[Array, ...]
    width: float
    width_range: tuple[float, float]
    reach: float
    axes: tuple[Axis, Axis, Axis] = eqx.field(static=True)
    middles: tuple[float, ...] = eqx.field(static=True)
    stacking: Stacking = eqx.field(static=True)
    sources: tuple[bool, bool] = eqx.field(static=True)

    def controls(self) -> Controls:
        return self.first

    def at(self, controls: Controls) -> "IsolinePattern":
        return eqx.tree_at(lambda p: p.first, self, controls)

    def realise(self, controls: Controls) -> Realised:
        xi, eta = self.coefficients(controls)
        gradient = self.lattice.gradient(xi), self.lattice.gradient(eta)
        density = tuple(_density(*each) for each in gradient)
        width = self.width_at(controls, self.width_bases)
        made = jnp.isfinite(density[0].sum() + density[1].sum())
        return Realised((xi, eta), gradient, (density[0], density[1]), width, made)

    def coefficients(self, controls: Controls) -> tuple[Array, Array]:
        """Spline coefficients of both functions; where P or Q is controlled, (5) is solved."""
        xi, eta = controls.xi, controls.eta
        if self.poisson is not None:
            xi = self.poisson.coefficients(xi) if self.sources[0] else xi
            eta = self.poisson.coefficients(eta) if self.sources[1] else eta
        return xi, eta

    def width_at(self, controls: Controls, bases: Sequence[Any]) -> Array:
        """Road width, mm, on a lattice (n, m, 1), or one for all (1, 1, 1).

        `bases` are those of a width field along x and y there.
        """
        if controls.width is None:
            return jnp.full((1, 1, 1), self.width)
        low, high = self.width_range
        if controls.width.ndim == 0:
            return within(controls.width, low, high).reshape(1, 1, 1)
        free = bases[0] @ controls.width @ jnp.asarray(bases[1]).T
        return within(free, low, high)[..., None]

    def deposit(self, realised: Realised) -> Raster:
        """Lines by |grad| over the room for centre lines, and turn-arounds along its walls.

        Where a family runs into a wall the path turns along it between every second pair of
        neighbours, so half of the wall is covered; where it runs along the wall nothing is.
        """
        room, width = self.room, realised.width
        area = room.area_at(width / 2)
        i, j, k = room.cell.T
        length = jnp.sqrt((room.along**2).sum(1))
        lines, turns = 0.0, 0.0
        for family, (gx, gy), density in zip(
            FAMILIES, realised.gradient, realised.density, strict=True
        ):
            share = self.stacking.layer_share(family)
            lines = lines + share * density
            ends = jnp.abs(gx[i, j, k] * room.along[:, 0] + gy[i, j, k] * room.along[:, 1]) / length
            own = width[i, j, 0] if width.size > 1 else width[0, 0, 0]
            turns = turns + share * length * _covered(ends, density[i, j, k], own)
        run = (lines * area).at[i, j, k].add(turns)
        volume = run * section_area(width, room.height) * room.layers
        return Raster(room.x, room.y, room.z, volume)

    def cells(self, realised: Realised) -> tuple[Array, Array, Array]:
        room = self.room
        shares = [self.stacking.layer_share(family) for family in FAMILIES]
        run = sum(share * each for share, each in zip(shares, realised.density, strict=True))
        solid = run * section_area(realised.width, room.height) / room.height
        volume = room.area_at(realised.width / 2) * room.height * room.layers
        points, volumes = Raster(room.x, room.y, room.z, volume).points
        return points, 1 - solid.reshape(-1), volumes

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        # Away from the room lines may do as they like.
        inside = self.room.area[0] > 0
        least = (limits.least_spacing or realised.width) * (1 + _TIGHT)
        least = jnp.broadcast_to(least, inside.shape)
        skew, *others = _excess(*realised.gradient[0], *realised.gradient[1], least, self.reach)
        count = inside.sum() / inside.size
        kinds = {"skew": [skew], "spacing": others[:2], "span": others[2:]}
        return {
            name: jnp.stack([jnp.where(inside, one, -1.0) for one in some]).ravel()
            / jnp.sqrt(count)
            for name, some in kinds.items()
        }

    def roughness(self, controls: Controls) -> Float[Array, " n"]:
        pieces = []
        for source, values in zip(self.sources, (controls.xi, controls.eta), strict=True):
            # The slope of a function's Laplacian is a third derivative of it.
            order, weight = (1, _SMOOTH**2) if source else (3, _SMOOTH**2 / self._knot_area)
            inner = values[1:-1, 1:-1] if source else values
            for axis in range(3):
                if inner.shape[axis] > 1:
                    pieces.append(weight * jnp.diff(inner, order, axis=axis).ravel())
        if controls.width is not None and controls.width.ndim:
            for axis in (0, 1):
                change = jnp.diff(controls.width, 2, axis=axis).ravel()
                pieces.append(change / np.sqrt(controls.width.size))
        return jnp.concatenate(pieces)

    @property
    def _knot_area(self) -> float:
        return self.axes[0].step * self.axes[1].step

    def scale(self, step: Controls) -> Controls:
        xi, eta = (
            values.at[1:-1, 1:-1].divide(_STEP**2) if source else _smoothed(values, self.waves)
            for source, values in zip(self.sources, (step.xi, step.eta), strict=True)
        )
        return Controls(xi, eta, step.width)

    def widths(self, realised: Realised) -> tuple[Array, Array]:
        return realised.width.min(), realised.width.max()

    def strokes(self, controls: Controls) -> Iterator[Sequence[Lines]]:
        xi, eta = (np.asarray(each) for each in self.coefficients(controls))
        places = [_between_knots(axis) for axis in self.axes[:2]]
        bases = [axis.basis(at) for axis, at in zip(self.axes, places, strict=False)]
        width = np.asarray(self.width_at(controls, width_bases(self.axes, controls.width, places)))
        flat = self.axes[2].count == 1
        made: dict[tuple[Scan, float], Lines] = {}
        for z, scans in zip(self.middles, self.stacking.scans, strict=True):
            layer = []
            for scan in scans:
                at = scan, 0.0 if flat else z
                if at not in made:
                    function = (xi, eta)[FAMILIES.index(scan.family)]
                    x, y = bases
                    values = product(function, x, y, self.axes[2].basis(np.array([z])))[..., 0]
                    made[at] = _lines(places, values, width[..., 0], scan)
                layer.append(made[at])
            yield layer

    def facts(self, controls: Controls) -> dict[str, Any]:
        """Lines, knots, spacings, and the P = lap(xi) and Q = lap(eta) of eq. (5) inside."""
        inside = np.asarray(self.room.area[0] > 0)
        lattice = Lattice(*map(np.asarray, self.lattice))
        functions = [np.asarray(each) for each in self.coefficients(controls)]
        density = [np.hypot(*lattice.gradient(each))[inside] for each in functions]
        spacing = {
            family: [float(1 / own.max()), float(1 / max(own.min(), _FLAT))]
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

    def pictures(self, controls: Controls) -> dict[str, tuple[Panel, ...]]:
        x, y = (np.linspace(axis.low, axis.high, 6 * axis.count) for axis in self.axes[:2])
        p, q = (each[..., -1] for each in self.laplacians(controls, x, y))
        return {"laplacians": (Panel("P = lap(ξ)", x, y, p), Panel("Q = lap(η)", x, y, q))}

    def laplacians(
        self, controls: Controls, x: np.ndarray | None = None, y: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """P = lap(xi) and Q = lap(eta) on a lattice, (n, m, p), 1/mm^2; where design looks, if no
        other x (n,) and y (m,) are given.
        """
        places = self.room.x if x is None else x, self.room.y if y is None else y
        (along_x, bend_x), (along_y, bend_y) = (
            (axis.basis(np.asarray(at)), axis.basis(np.asarray(at), 2))
            for axis, at in zip(self.axes, places, strict=False)
        )
        z = np.asarray(self.lattice.z)
        xi, eta = (
            product(each, bend_x, along_y, z) + product(each, along_x, bend_y, z)
            for each in map(np.asarray, self.coefficients(controls))
        )
        return xi, eta

    def _warnings(self, densest: float) -> list[str]:
        step = min(axis.step for axis in self.axes[:2])
        if step < densest:
            return [
                f"knots: {step:.3g} mm apart, finer than the roads' spacing of {densest:.3g} mm "
                "where it is least; the lines cannot show what such knots say"
            ]
        return []


@place_by_place
def _density(x: Array, y: Array) -> Array:
    return jnp.sqrt(x * x + y * y + _FLAT**2)


@place_by_place
def _excess(
    ax: Array, ay: Array, bx: Array, by: Array, least: Array, reach: Array
) -> tuple[Array, ...]:
    """By how much two gradients, 1/mm, break the limit of skew, of both families' spacing, `least`
    (mm), and of both families' span, `reach` (mm).
    """
    first, second = _density(ax, ay), _density(bx, by)
    across = jnp.abs(ax * by - ay * bx)
    return (
        jnp.abs(ax * bx + ay * by) / (first * second) / SKEW - 1,
        *(each * least - 1 for each in (first, second)),
        # The lines of one family are bridges between those of the other.
        *(1 - reach * across / other for other in (first, second)),
    )


def _covered(ends: Array, density: Array, width: Array) -> Array:
    """Road a mm of wall that turning around takes, less what lines end early for it.

    - `ends`: of lines a mm of wall, |d xi/ds|; `density`: |grad xi|, 1/mm; `width`: mm.

    Half the wall, where the next end is within `LONGEST_JOIN` and the lines do not run along it
    (below `_ALONG`). Where they meet it at a small angle (below `_WEDGE`) they end early by
    `APART` widths over its sine, and the join begins across the wedge.
    """
    sine = ends / density
    joined = jax.nn.sigmoid(12 * (LONGEST_JOIN * ends - 1)) * jax.nn.sigmoid((sine - _ALONG) * 60)
    early = jax.nn.sigmoid((_WEDGE - sine) * 30) * APART * width * (density - ends / 2)
    return joined * (0.5 - early)


_ALONG, _WEDGE = 0.07, 0.35
"""Sines of 4 and of 20 degrees, as plans were seen to go."""

_FLAT = 1e-6
"""A density, 1/mm, far below any that matters: |grad| has no slope where the gradient is 0."""


def waves_of(axis: Axis) -> tuple[Array, Array]:
    """Waves of an axis's coefficients, and their squared wave numbers times `_STEP`, squared."""
    bend = np.diff(np.eye(axis.count), axis=0)
    rates, waves = np.linalg.eigh(bend.T @ bend)
    return jnp.asarray(waves), jnp.asarray(np.maximum(rates, 0) * (_STEP / axis.step) ** 2)


def _smoothed(values: Array, waves: tuple[tuple[Array, Array], ...]) -> Array:
    """Each wave divided by one more than its squared wave number."""
    (x, of_x), (y, of_y), (z, of_z) = waves
    parts = product(values, x.T, y.T, z.T)
    parts = parts / (1 + of_x[:, None, None] + of_y[:, None] + of_z)
    return product(parts, x, y, z)


def width_bases(
    axes: tuple[Axis, Axis, Axis], width: Any, places: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Bases of a width field at places along x and y; none where the width is no field."""
    counts = () if width is None else np.shape(width)
    return [
        Axis(axis.low, axis.high, count).basis(at)
        for axis, count, at in zip(axes, counts, places, strict=False)
    ]


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
