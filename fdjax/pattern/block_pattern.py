"""Lines that run on from block to block, each block with a map of its own."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from fdjax.grid import bspline
from fdjax.grid.base import AbstractGridMap, Tangents, norm, tangents
from fdjax.grid.respaced import Respaced, SpacingField
from fdjax.grid.spacing import DensitySpacing
from fdjax.limits import Limits
from fdjax.part.blocks import Band, Blocks
from fdjax.pattern.base import AbstractPattern, Penalties
from fdjax.pattern.block_phases import Beside, Turn, besides, turns
from fdjax.pattern.block_tracing import edges, squeezed, traced
from fdjax.pattern.width import PlacedWidth
from fdjax.programs import program
from fdjax.road.bead import section_area
from fdjax.road.deposit import Points
from fdjax.road.patches import Families, patch_deposit, wall_margins
from fdjax.road.porosity import Lattice, Samples
from fdjax.road.stacking import FAMILIES, Scan, Stacking
from fdjax.road.stroke import Lines

Floats = np.ndarray

PRESS = 0.25
"""Lines beside a wall are pressed back on it from this share of a road's width beyond."""

PATIENCE = 0.02
"""Corrections by what is laid matter more than the last steps."""

FOLD_FLOOR = 0.02
"""J over its block's mean below which design is pushed back from folding."""

SPARSE = 3.0
"""Lines lie no further apart than so many times their mean in a block: where a band is drawn out
further than that, the places at which design looks are too few to see it."""

APART = 1_000_003
"""Levels of one band and of the next lie so far apart: lines of two bands are no neighbours."""


class BlockControls(eqx.Module):
    """The real numbers that shape the lines; None where the pattern's own value stays.

    - `spacing`: of each band, log density of its lines across it, cubic B-splines, shape (R, K), at
      R places along it; around a closed band these are periodic.
    - `lines`: of each band, logarithm of its number of lines over that of the start, (bands,).
    - `width`: road width as the free number of `width.within`, shape () or, as a spline over the
      box around the part, (K, L).
    """

    spacing: tuple[Float[Array, "R K"], ...] | None = None
    lines: Float[Array, " bands"] | None = None
    width: Float[Array, "..."] | None = None


class Places(eqx.Module):
    """Where the lines of each block come from: arrays with an axis of blocks, then one of axes.

    - `band`: number of the band whose lines are those of constant xi, and of constant eta, (m, 2).
    - `turned`, `begin`, `end`: as of `SpacingField`, (m, 2).
    - `family`: 0 or 1, (m, 2); `walls`: as of `Families`, (m, 4).
    """

    band: Int[Array, "m 2"]
    turned: Bool[Array, "m 2"]
    begin: Float[Array, "m 2"]
    end: Float[Array, "m 2"]
    family: Int[Array, "m 2"]
    walls: Float[Array, "m 4"]

    @classmethod
    def of(cls, blocks: Blocks, lengths: Floats) -> "Places":
        """`lengths`: how long the lines of either axis are within each block, (m, 2), mm."""
        count = len(blocks.blocks)
        band, family = np.zeros((2, count, 2), int)
        turned, begin, end = np.zeros((count, 2), bool), *np.zeros((2, count, 2))
        for number, each in enumerate(blocks.bands):
            reach = np.concatenate(
                [[0.0], np.cumsum([lengths[s.block, s.axis] for s in each.stretches])]
            )
            reach /= reach[-1]
            for stretch, low, high in zip(each.stretches, reach[:-1], reach[1:], strict=True):
                at = stretch.block, stretch.axis
                band[at], family[at], turned[at] = number, each.family, stretch.turned
                begin[at], end[at] = (high, low) if stretch.back else (low, high)
        walls = [[blocks.is_wall(block, k) for k in range(4)] for block in range(count)]
        return cls(*map(jnp.asarray, (band, turned, begin, end, family, np.array(walls, float))))


@dataclass(frozen=True, eq=False)
class Structure:
    """What of the blocks stays as it is: the bands, where lines end within the part, and which
    bands lie side by side."""

    bands: tuple[Band, ...]
    cuts: tuple[Floats, ...]
    beside: tuple[Beside, ...] = ()

    @classmethod
    def of(cls, blocks: Blocks) -> "Structure":
        cuts = tuple(blocks.sides[key].polyline() for key in blocks.broken)
        return cls(blocks.bands, cuts, besides(blocks))


class Realised(NamedTuple):
    """What controls amount to: the blocks' maps, and these where design looks.

    - `grid`: one map, its arrays with a leading axis of blocks; `lattice`: likewise.
    - `lines`: of each band, in all phases together, (bands,).
    """

    grid: AbstractGridMap
    width: PlacedWidth
    lines: Float[Array, " bands"]
    lattice: Lattice
    made: Bool[Array, ""]


class BlockLines(AbstractPattern):
    """Both families of lines of all blocks, laid by `road.stacking`.

    - `base`: the blocks' maps, their arrays with a leading axis; `smooth`: whether these join
      without a kink. `places`, `structure`: where lines run.
    - `lines`: of each band in all phases together, real numbers, (bands,).
    - `width`, `width_range`, `height`: of roads and layers, mm.
    - `first`: the controls to start from; `samples`: where design looks, along xi and along eta.
    - `skew_limit`: largest |cos| of the angle between the families, where design looks.
    - `box`: lower left and upper right corner around the part.
    """

    base: AbstractGridMap
    places: Places
    lines: Float[Array, " bands"]
    width: float
    width_range: tuple[float, float]
    height: float
    first: BlockControls
    samples: Samples
    box: Float[Array, "2 2"]
    skew_limit: Float[Array, "m n n"] | float = 0.9
    structure: Structure = eqx.field(static=True, default=Structure((), ()))
    stacking: Stacking = eqx.field(static=True, default=Stacking())
    counts_fixed: bool = eqx.field(static=True, default=False)
    smooth: bool = eqx.field(static=True, default=False)

    def controls(self) -> BlockControls:
        return self.first

    @property
    def patience(self) -> float | None:
        return PATIENCE

    def at(self, controls: BlockControls) -> "BlockLines":
        return eqx.tree_at(lambda p: p.first, self, controls)

    def grid(self, controls: BlockControls) -> AbstractGridMap:
        """The blocks' maps, with a leading axis."""
        if controls.spacing is None:
            return Respaced(self.base)
        rows = [
            bspline.closed(own, 0) if band.closed and len(own) > 1 else own
            for own, band in zip(controls.spacing, self.structure.bands, strict=True)
        ]
        # Bands with fewer rows have theirs in the first part of a spline with as many as the most.
        most = max(map(len, rows))
        spans = np.array([max(len(own) - 3, 1) for own in rows]) / max(most - 3, 1)
        rows = [jnp.pad(own, ((0, most - len(own)), (0, 0))) for own in rows]
        spacings = jax.vmap(jax.vmap(DensitySpacing.of))(jnp.stack(rows))
        at, span = self.places, jnp.asarray(spans)[self.places.band]
        fields = [
            SpacingField(
                jax.tree.map(lambda part, k=k: part[at.band[:, k]], spacings),
                turned=at.turned[:, k],
                begin=at.begin[:, k] * span[:, k],
                end=at.end[:, k] * span[:, k],
            )
            for k in (0, 1)
        ]
        return Respaced(self.base, fields[0], fields[1], joint=self.smooth)

    def counts(self, controls: BlockControls) -> Float[Array, " bands"]:
        """Lines of each band in all phases together, real numbers."""
        return self.lines if controls.lines is None else self.lines * jnp.exp(controls.lines)

    def road_width(self, controls: BlockControls) -> PlacedWidth:
        if controls.width is not None:
            return PlacedWidth(controls.width, self.box[0], self.box[1], self.width_range)
        # `within` keeps the ends of its range out of reach.
        low = self.width / 2
        return PlacedWidth(jnp.zeros(()), self.box[0], self.box[1], (low, 3 * low))

    def realise(self, controls: BlockControls) -> Realised:
        grid, where = self.grid(controls), self.samples
        lattice = eqx.filter_vmap(
            lambda own: tangents(own, where.places[:, None], where.places[None])
        )(grid)
        return Realised(
            grid,
            self.road_width(controls),
            self.counts(controls),
            Lattice(where, where, *lattice),
            jnp.asarray(True),
        )

    @property
    def _shares(self) -> Float[Array, "m 2"]:
        """Of the layers that hold the families of each block."""
        shares = [self.stacking.layer_share(family) for family in FAMILIES]
        return jnp.asarray(shares)[self.places.family]

    def _lines_per_layer(self, realised: Realised) -> Float[Array, "m 2"]:
        return realised.lines[self.places.band] / self.stacking.phases

    def deposit(self, realised: Realised) -> Points:
        width, lattice = realised.width, realised.lattice
        area = section_area(width(lattice.xy), self.height)
        families = Families(self._lines_per_layer(realised), self._shares, self.places.walls)
        clearance = width.ends[1] / 2

        def one(xy: Array, along: Tangents, area: Array, families: Families) -> Any:
            own = Lattice(lattice.xi, lattice.eta, xy, along)
            return patch_deposit(own, area, clearance, families)

        xy, volume = jax.vmap(one)(lattice.xy, lattice.along, area, families)
        xy = xy.reshape(-1, 2)
        xyz = jnp.concatenate([xy, jnp.full((len(xy), 1), self._depth / 2)], 1)
        return Points(xyz, volume.ravel() * self.stacking.layers)

    @property
    def _depth(self) -> float:
        return self.height * self.stacking.layers

    def cells(self, realised: Realised) -> tuple[Array, Array, Array]:
        (xi, eta, xy, along), inner = realised.lattice, (slice(None), slice(1, -1), slice(1, -1))
        lines = self._lines_per_layer(realised) * self._shares
        density = jnp.stack([norm(along.eta), norm(along.xi)], -1) * lines[:, None, None]
        local = 1 - section_area(realised.width(xy), self.height) / self.height * (
            density.sum(-1) / along.jacobian
        )
        area = along.jacobian * xi.weights[:, None] * eta.weights
        points = xy[inner].reshape(-1, 2)
        points = jnp.concatenate([points, jnp.full((len(points), 1), self._depth / 2)], 1)
        return points, local[inner].ravel(), area[inner].ravel() * self._depth

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        along, xy = realised.lattice.along, realised.lattice.xy
        least = limits.least_spacing or realised.width(xy)
        mean = jnp.abs(along.jacobian).mean((1, 2), keepdims=True)
        positive = jnp.maximum(along.jacobian, 1e-3 * mean)
        lines = self._lines_per_layer(realised)[:, None, None]
        across = jnp.stack([norm(along.eta), norm(along.xi)])
        spacing = positive / (jnp.moveaxis(lines, -1, 0) * across)
        # What walls take of the room, lines have less.
        edge = jax.vmap(wall_margins, (0, None, 0))(
            along, realised.width.ends[1] / 2, self.places.walls
        )
        taken = (edge.left + edge.right)[:, None], (edge.bottom + edge.top)[..., None]
        spacing = spacing * (1 - jnp.stack([jnp.broadcast_to(t, xy.shape[:3]) for t in taken]))
        inner = spacing[:, :, 1:-1, 1:-1]
        return {
            "fold": (FOLD_FLOOR - along.jacobian / mean).ravel() / FOLD_FLOOR,
            "skew": (along.skew / self.skew_limit).ravel() - 1,
            "spacing": (least / spacing)[:, :, 1:-1, 1:-1].ravel() - 1,
            # A road crosses lines of the other family that lie so far apart below it.
            "span": inner[:, :, ::2, ::2].ravel() / limits.longest_span - 1,
            "sparse": (spacing / spacing.mean((2, 3), keepdims=True)).ravel() / SPARSE - 1,
        }

    def roughness(self, controls: BlockControls) -> Float[Array, " n"]:
        pieces = [jnp.zeros(0)]
        for own, band in zip(controls.spacing or (), self.structure.bands, strict=False):
            size = np.sqrt(own.size * len(self.structure.bands))
            pieces.append(jnp.diff(own, 2, axis=1).ravel() / size)
            around = jnp.concatenate([own, own[:2]]) if band.closed else own
            if len(own) > 2:
                pieces.append(jnp.diff(around, 2, axis=0).ravel() / size)
        if controls.width is not None and controls.width.ndim == 2:
            size = np.sqrt(controls.width.size)
            pieces += [jnp.diff(controls.width, 2, axis=k).ravel() / size for k in (0, 1)]
        return jnp.concatenate(pieces)

    def widths(self, realised: Realised) -> tuple[Array, Array]:
        return realised.width.ends

    def whole_counts(self, controls: BlockControls) -> list[int]:
        """Lines of each band in all phases together, as they are laid."""
        return [max(1, round(float(count))) for count in self.counts(controls)]

    def strokes(self, controls: BlockControls, points: int = 97) -> Iterator[Sequence[Lines]]:
        grid, width = _shape(self, controls)
        combs = self.whole_counts(controls)
        walls = np.asarray(self.places.walls)
        around = [
            jax.tree.map(np.asarray, edges(grid, width, block, points))
            for block in np.arange(len(walls))
        ]
        lines = [
            traced(grid, width, band, comb, squeezed(band, around, walls))
            for band, comb in zip(self.structure.bands, combs, strict=True)
        ]
        order = turns(combs, self.structure.beside, self.stacking.phases)
        made: dict[Scan, Lines] = {}
        for layer in self.stacking.scans:
            for scan in layer:
                if scan not in made:
                    made[scan] = self._lines(scan, lines, order)
            yield [made[scan] for scan in layer]

    def _lines(self, scan: Scan, traced: list[tuple[Floats, Floats]], order: list[Turn]) -> Lines:
        """All bands of one family, on one layer."""
        level, xy, width = [], [], []
        for number, (band, lines) in enumerate(zip(self.structure.bands, traced, strict=True)):
            if FAMILIES[band.family] != scan.family:
                continue
            now = order[number].phases(len(lines[0]), scan.phases) == scan.phase
            courses, widths = (each[now] for each in lines)
            if band.closed:
                # Where lines begin moves around from layer to layer.
                turn = scan.phase * widths.shape[1] // scan.phases
                courses = np.roll(courses[:, :-1], -turn, axis=1)
                courses = np.concatenate([courses, courses[:, :1]], 1)
                widths = np.roll(widths, -turn, axis=1)
            # Turn-arounds alternate from line to line, and along a band from phase to phase.
            first = int(now.argmax()) - scan.phase
            level += (number * APART + first % 2 + np.arange(len(courses))).tolist()
            xy += list(courses)
            width += list(widths)
        return Lines(
            scan.family, scan.parity, np.array(level, int), xy, width, press=PRESS,
            cuts=self.structure.cuts,
        )  # fmt: skip

    def counted(self, asked: float, laid: float) -> "BlockLines":
        """The pattern with all bands' numbers of lines scaled alike, where the mean is missed."""
        if self.counts_fixed or laid <= 0 or abs(asked / laid - 1) < _MISSED:
            return self
        # The controls stay, so that they are still those of a design.
        lines = self.lines * (asked / laid)
        return eqx.tree_at(lambda p: p.lines, self, lines)

    def facts(self, controls: BlockControls) -> dict[str, Any]:
        """Blocks, shared sides at which lines end, and of each band its family and lines."""
        phases = self.stacking.phases
        bands = zip(self.structure.bands, self.whole_counts(controls), strict=True)
        return {
            "kind": "blocks",
            "smooth": self.smooth,
            "blocks": len(self.places.band),
            "phases": phases,
            "cuts": len(self.structure.cuts),
            "bands": [
                {
                    "family": FAMILIES[band.family],
                    "closed": band.closed,
                    "blocks": [stretch.block for stretch in band.stretches],
                    "lines_per_layer": count / phases,
                }
                for band, count in bands
            ],
        }


_MISSED = 3e-3
"""Share of the volume up to which the sections of the roads make good what is missing."""


@program
def _shape(pattern: BlockLines, controls: BlockControls) -> tuple[AbstractGridMap, PlacedWidth]:
    return pattern.grid(controls), pattern.road_width(controls)
