"""Grid lines as roads: two families of lines of a map of the unit square."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.errors import InputError
from fdjax.grid import bspline
from fdjax.grid.base import AbstractGridMap, Sides, Tangents, norm, tangents
from fdjax.grid.laplacians import laplacians
from fdjax.grid.quality import quality
from fdjax.grid.solvers import AbstractSolver, Newton
from fdjax.limits import Limits
from fdjax.pattern.base import AbstractPattern, Panel, Penalties
from fdjax.pattern.embedded import Embedded
from fdjax.pattern.embedded_joins import CLEAR
from fdjax.pattern.embedded_lines import with_fine
from fdjax.pattern.grid_tracing import along, margins, spiral, traced
from fdjax.pattern.maps import CLOSED, MAPS, NEED_BASE
from fdjax.pattern.width import AbstractWidth, SplineWidth, UniformWidth, within
from fdjax.road import porosity
from fdjax.road.bead import section_area
from fdjax.road.deposit import Points
from fdjax.road.holes import Holes
from fdjax.road.porosity import Lattice, Margins, Samples
from fdjax.road.stacking import FAMILIES, Scan, Stacking
from fdjax.road.stroke import Lines


class Controls(eqx.Module):
    """The real numbers that shape the lines; None where the pattern's own value stays.

    - `spacing`: log density of lines along bottom, right, top and left, cubic B-splines, shape
      (4, K).
    - `stretching`: the free number of the stretching along x and y, see `STRETCHINGS`, shape (2,).
    - `phi`, `psi`: control functions of the unit square, cubic B-splines, shape (K, L); they add
      to the pattern's constants.
    - `width`: road width as the free number of `width.within`, shape () or, as a spline, (K, L).
    - `crowding`: log density of the xi lines along xi, shape (R, K), at R places along eta, and of
      the eta lines along eta, (S, L), at S places along xi: cubic B-splines both ways.

    On a closed map splines over eta are periodic.
    """

    spacing: Float[Array, "4 K"] | None = None
    stretching: Float[Array, " 2"] | None = None
    phi: Float[Array, "K L"] | None = None
    psi: Float[Array, "K L"] | None = None
    width: Float[Array, "..."] | None = None
    crowding: tuple[Float[Array, "R K"], Float[Array, "S L"]] | None = None


class Realised(NamedTuple):
    """What controls amount to: the map, the road width, and whether the map could be made.

    `lattice`: the map where design looks.
    """

    grid: AbstractGridMap
    width: AbstractWidth
    made: Bool[Array, ""]
    lattice: Lattice


_Shape = tuple[AbstractGridMap, AbstractWidth]


class GridLines(AbstractPattern):
    """Both families of a grid map's lines, laid by `road.stacking`.

    - `sides`: of the layer domain.
    - `comb`: lines of each family in all phases together (xi, eta).
    - `width`: road width, mm, where it is not a control; `width_range`: what the machine allows.
    - `height`: layer height, mm.
    - `phi`, `psi`, `p`, `q`: constants of the elliptic map, on the unit square.
    - `stretching`, `strength`, `alpha`: along x and y, for "stretched": keys of `STRETCHINGS`, the
      number that shapes it, and what end it draws to.
    - `first`: the controls to start from.
    - `samples`: where design looks along xi and along eta.
    - `holes`: in the domain, or None.
    - `counts_fixed`: whether the number of lines was given, and stays.
    - `skew_limit`: largest |cos| of the angle between the families, one or for each of the samples.
    - `kind`: a key of `MAPS`; `nodes`, `solver`: of the elliptic map.
    - `base`: the map that lines are spaced on, where it does not follow from `sides` or stays as
      it is; `base_made`: whether it could be made.
    - `apart`: on a disc, where `left` is but a point at which eta lines would meet, every second
      one ends where they come nearer than this, mm; else None.
    - `spiral`: whether a closed map's xi lines are one spiral on each layer.
    - `embedded`: where a map with four sides has finer lines between its own, or None.
    """

    sides: Sides
    comb: tuple[Float[Array, ""] | float, Float[Array, ""] | float]
    width: float
    width_range: tuple[float, float]
    height: float
    first: Controls
    samples: tuple[Samples, Samples]
    holes: Holes | None = None
    phi: float = 0.0
    psi: float = 0.0
    p: float = 0.0
    q: float = 0.0
    strength: tuple[float, float] = (1.1, 1.1)
    skew_limit: Float[Array, "n m"] | float = 0.9
    alpha: tuple[float, float] = eqx.field(static=True, default=(0.5, 0.5))
    stretching: tuple[str, str] = eqx.field(static=True, default=("roberts", "roberts"))
    counts_fixed: bool = eqx.field(static=True, default=False)
    kind: str = eqx.field(static=True, default="transfinite")
    stacking: Stacking = eqx.field(static=True, default=Stacking())
    nodes: tuple[int, int] = eqx.field(static=True, default=(41, 41))
    solver: AbstractSolver = eqx.field(static=True, default=Newton())
    base: AbstractGridMap | None = None
    base_made: Bool[Array, ""] | bool = True
    apart: float | None = None
    spiral: bool = eqx.field(static=True, default=False)
    embedded: Embedded | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        if self.kind not in MAPS:
            raise InputError(f'map: "{self.kind}" is not one of {", ".join(MAPS)}')
        if self.kind in NEED_BASE and self.base is None:
            raise InputError(f'map: "{self.kind}" needs the map that it is, as `base`')

    def controls(self) -> Controls:
        return self.first

    def at(self, controls: Controls) -> "GridLines":
        return eqx.tree_at(lambda p: p.first, self, controls)

    @property
    def closed(self) -> bool:
        """Whether xi lines run around a ring."""
        return self.kind in CLOSED

    @property
    def lines_per_layer(self) -> tuple[Array, Array]:
        """Lines of each family on a layer that has it, a mean over the phases."""
        xi, eta = self.comb
        return jnp.asarray(xi) / self.stacking.phases, jnp.asarray(eta) / self.stacking.phases

    def realise(self, controls: Controls) -> Realised:
        """The map and the road width that these controls give."""
        grid, made, width = self.shape(controls)
        return Realised(grid, width, made, Lattice.of(grid, self.samples))

    def shape(self, controls: Controls) -> tuple[AbstractGridMap, Bool[Array, ""], AbstractWidth]:
        """The map that these controls give, whether it could be made, and the road width."""
        grid, made = MAPS[self.kind](self, controls)
        low, high = self.width_range
        if controls.width is None:
            width = UniformWidth(self.width)
        elif controls.width.ndim == 0:
            width = UniformWidth(within(controls.width, low, high))
        else:
            values = bspline.closed(controls.width, 1) if self.closed else controls.width
            width = SplineWidth(values, low, high)
        return grid, made, width

    def deposit(self, realised: Realised) -> Points:
        width = realised.width
        xy, volume = porosity.line_deposit(
            realised.lattice,
            width,
            self.height,
            self.lines_per_layer,
            self.stacking,
            closed=self.closed,
            least_spacing=self.apart,
            times=None if self.embedded is None else self.embedded.times,
        )
        shares = sum(self.stacking.layer_share(family) for family in FAMILIES)
        if self.embedded is not None and self._joined:
            # A border has one of the families end at it.
            widest = porosity.widest(width)
            places, length = self.embedded.ways(CLEAR * widest)
            section = section_area(widest, self.height)
            xy = jnp.concatenate([xy, places])
            volume = jnp.concatenate([volume, shares / 2 * section * length])
        if self.holes is not None:
            xy, volume = self.holes.cut(
                porosity.LayerDeposit(xy, volume), porosity.widest(width), self.height, shares
            )
        return Points(_at_middle(xy, self._depth), volume * self.stacking.layers)

    @property
    def _joined(self) -> bool:
        """Whether fine lines are joined where they end: with both families on a layer lines of the
        other one lie there already."""
        return not self.stacking.both_families

    @property
    def _depth(self) -> float:
        """Height of all layers together, mm."""
        return self.height * self.stacking.layers

    def cells(self, realised: Realised) -> tuple[Array, Array, Array]:
        xi, eta, xy, along = realised.lattice
        width = realised.width(xi.places[:, None], eta.places[None])
        local = porosity.cell_porosity(
            along, width, self.height, self.lines_per_layer, self.stacking
        )
        local = 1 - (1 - local) * self._times(xy)
        area = along.jacobian * xi.weights[:, None] * eta.weights
        points = _at_middle(xy[1:-1, 1:-1].reshape(-1, 2), self._depth)
        return points, local[1:-1, 1:-1].ravel(), area[1:-1, 1:-1].ravel() * self._depth

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        xi, eta, xy, walled = realised.lattice
        n_xi, n_eta = self.lines_per_layer
        least = limits.least_spacing or realised.width(xi.places[:, None], eta.places[None])
        # Beyond a fold spacing means nothing, and a division by J would blow up.
        positive = jnp.maximum(walled.jacobian, 1e-3 * jnp.abs(walled.jacobian).mean())
        times, finest = self._times(xy), self._times(xy, beyond=0.5)
        # Lines run up to two of the walls, and lie on none.
        closeness = [
            (finest * least * n_xi * norm(walled.eta) / positive)[1:-1],
            (finest * least * n_eta * norm(walled.xi) / positive)[:, 1:-1],
        ]
        if self.apart is not None:
            # Eta lines end where they would come too near.
            closeness.pop()
        inner = Tangents(*(tangent[1:-1, 1:-1] for tangent in walled))
        along_xi, along_eta = norm(inner.xi), norm(inner.eta)
        # Spans vary slowly: every second place will do.
        times = times[1:-1, 1:-1]
        spans = [(each / times)[::2, ::2] for each in (along_eta / n_eta, along_xi / n_xi)]
        lengths = [along_eta.mean(1), along_xi.mean(0)]
        return {
            "fold": (FOLD_FLOOR - walled.jacobian / inner.jacobian.mean()).ravel() / FOLD_FLOOR,
            "skew": (walled.skew / self.skew_limit).ravel() - 1,
            "spacing": jnp.concatenate([each.ravel() for each in closeness]) - 1,
            "span": jnp.stack(spans).ravel() / limits.longest_span - 1,
            "length": limits.least_road / jnp.concatenate(lengths) - 1,
        }

    def _times(self, xy: Array, *, beyond: float = 0.0) -> Array:
        """How many times as many lines as the base has lie at places (n, m, 2), mm."""
        if self.embedded is None:
            return jnp.ones(xy.shape[:-1])
        return self.embedded.times(xy, beyond=beyond)

    def skew(self, realised: Realised) -> Float[Array, "n m"]:
        """|cos| of the angle between the families where design looks, walls included."""
        return realised.lattice.along.skew

    def roughness(self, controls: Controls) -> Float[Array, " n"]:
        pieces = [jnp.zeros(0)]
        for values in jax.tree.leaves(controls):
            axes = [values.ndim - 1] if values is controls.spacing else range(values.ndim)
            around = 1
            if controls.crowding is not None and values is controls.crowding[0]:
                around = 0
            for axis in axes:
                count = values.shape[axis]
                if count > 2:
                    # On a ring the first is the neighbour of the last.
                    more = 2 if self.closed and axis == around else 0
                    whole = jnp.take(values, np.arange(count + more) % count, axis)
                    pieces.append(jnp.diff(whole, 2, axis=axis).ravel() / np.sqrt(values.size))
        return jnp.concatenate(pieces)

    def widths(self, realised: Realised) -> tuple[Array, Array]:
        places = jnp.linspace(0, 1, QUALITY_NODES)
        width = realised.width(places[:, None], places[None])
        return width.min(), width.max()

    def strokes(self, controls: Controls, points: int = 257) -> Iterator[Sequence[Lines]]:
        xi, eta = (
            jnp.asarray(Scan(family).places(int(comb)))
            for family, comb in zip(FAMILIES, self.comb, strict=True)
        )
        shape = _shape(self, controls)
        edge = margins(*shape, points, closed=self.closed)
        lines = traced(*shape, edge, (xi, eta))
        starts = np.zeros(len(eta), int)
        if self.apart is not None:
            starts = self._starts(np.asarray(_spacing(self, shape[0], eta, points)))
        made: dict[Scan, Lines] = {}
        for layer in self.stacking.scans:
            for scan in layer:
                if scan not in made:
                    xy, width = lines[FAMILIES.index(scan.family)]
                    part = slice(scan.phase, None, scan.phases)
                    level, xy, width = np.arange(len(xy[part])), xy[part], width[part]
                    if self.closed and scan.family == "xi":
                        xy, width = self._around(shape, edge, scan, xy, width)
                    elif self.closed:
                        level = self._levels(scan, len(level))
                    begin = starts[part] if scan.family == "eta" else np.zeros(len(xy), int)
                    made[scan] = Lines(
                        scan.family,
                        scan.parity,
                        level[: len(xy)],
                        [line[k:] for line, k in zip(xy, begin, strict=False)],
                        [line[k:] for line, k in zip(width, begin, strict=False)],
                        press=PRESS,
                    )
                    if self.embedded is not None:
                        made[scan] = with_fine(
                            made[scan],
                            self.embedded,
                            scan,
                            (int(self.comb[0]), int(self.comb[1])),
                            edge=edge,
                            trace=partial(along, *shape),
                            joined=self._joined,
                        )
            yield [made[scan] for scan in layer]

    @staticmethod
    def _levels(scan: Scan, count: int) -> np.ndarray:
        """Levels of the lines across a ring: they begin elsewhere on each layer."""
        return (np.arange(count) - scan.phase * count // scan.phases) % count

    def _starts(self, spacing: np.ndarray) -> np.ndarray:
        """The point at which each eta line of a disc starts, of all phases."""
        starts = np.zeros(len(spacing), int)
        for phase in range(self.stacking.phases):
            part = slice(phase, None, self.stacking.phases)
            level = self._levels(Scan("eta", phase, self.stacking.phases), len(spacing[part]))
            starts[part] = porosity.first_kept(spacing[part], level)
        return np.minimum(starts, spacing.shape[1] - 2)

    def _around(
        self, shape: _Shape, edge: Margins, scan: Scan, xy: np.ndarray, width: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """A layer's closed lines, or its spiral: they begin elsewhere on each layer."""
        pieces = width.shape[1]
        turn = scan.phase * pieces // scan.phases
        if self.spiral:
            count = int(float(self.comb[0]) / scan.phases * pieces)
            xy, width = map(np.asarray, spiral(*shape, edge, turn, pieces + 1, count))
            return xy[None], width[None]
        xy = np.roll(xy[:, :-1], -turn, axis=1)
        return np.concatenate([xy, xy[:, :1]], 1), np.roll(width, -turn, axis=1)

    @property
    def mean_by_count(self) -> bool:
        return True

    def counted(self, asked: float, laid: float) -> "GridLines":
        """The pattern with as many lines, of the family that has more, as the mean asks for."""
        if self.counts_fixed or laid <= 0:
            return self
        counts = [int(n) for n in self.comb]
        # Eta lines of a disc are as many as can be halved.
        more = int(np.argmax(counts)) if self.apart is None else 0
        share = laid / float(_volume(self))

        def model(extra: int) -> float:
            trial = [n + extra * (k == more) for k, n in enumerate(counts)]
            return share * float(_volume(self._with_comb(trial)))

        began, now = list(counts), model(0)
        # A second look, since turn-arounds change with the count; the third is for rounding.
        for _ in range(3):
            change = round((asked - now) / (model(1) - now))
            if change == 0:
                break
            counts[more] = max(1, counts[more] + change)
            now = model(0)
        return self if counts == began else self._with_comb(counts)

    def _with_comb(self, counts: Sequence[int]) -> "GridLines":
        return eqx.tree_at(lambda p: p.comb, self, comb_of(counts))

    def pictures(self, controls: Controls) -> dict[str, tuple[Panel, ...]]:
        """P and Q of functions that count a layer's lines; at walls as at the nearest nodes."""
        xy = _nodes(_shape(self, controls)[0])
        panels = [
            Panel(name, xy[..., 0], xy[..., 1], jnp.pad(lines * values, 1, mode="edge"))
            for name, lines, values in zip(
                ("P = lap(ξ)", "Q = lap(η)"), self.lines_per_layer, laplacians(xy), strict=True
            )
        ]
        return {"laplacians": tuple(panels)}

    def facts(self, controls: Controls) -> dict[str, Any]:
        """Lines of a layer, phases, and the quality of the map's grid of nodes."""
        xi, eta = (int(n) / self.stacking.phases for n in self.comb)
        measures = quality(np.asarray(_nodes(_shape(self, controls)[0])))
        return {
            "kind": "grid-lines",
            "map": self.kind,
            "lines_per_layer": {"xi": xi, "eta": eta},
            "phases": self.stacking.phases,
            "grid": {name: float(value) for name, value in measures._asdict().items()},
            **({} if self.embedded is None else {"embedded": self.embedded.facts}),
        }


PRESS = 0.25
"""The first and the last lines run along walls, and are pressed back on them from this share of a
road's width beyond."""

QUALITY_NODES = 65
"""Nodes each way of the grid whose quality is reported."""

FOLD_FLOOR = 0.02
"""J over its mean below which design is pushed back from folding."""


def comb_of(counts: Sequence[int]) -> tuple[Array, Array]:
    """Counts of lines as a pattern has them: numbers that XLA need not know when it compiles."""
    return jnp.asarray(float(counts[0])), jnp.asarray(float(counts[1]))


def _at_middle(xy: Array, depth: float) -> Array:
    """Points of a layer, (n, 2), at half the part's height, (n, 3)."""
    return jnp.concatenate([xy, jnp.full((len(xy), 1), depth / 2)], 1)


@eqx.filter_jit
def _volume(pattern: GridLines) -> Array:
    return pattern.deposit(pattern.realise(pattern.first)).volume.sum()


@eqx.filter_jit
def _shape(pattern: GridLines, controls: Controls) -> _Shape:
    grid, _, width = pattern.shape(controls)
    return grid, width


@eqx.filter_jit
def _nodes(grid: AbstractGridMap) -> Array:
    places = jnp.linspace(0, 1, QUALITY_NODES)
    return grid(places[:, None], places[None])


@eqx.filter_jit
def _spacing(pattern: GridLines, grid: AbstractGridMap, eta: Array, points: int) -> Array:
    """Of a layer's eta lines, as shares of `apart`, at the points traced of each."""
    run = jnp.linspace(0, 1, points)
    _, along = tangents(grid, run[:, None], eta[None])
    spacing = along.jacobian / (pattern.lines_per_layer[1] * norm(along.xi))
    return (spacing / pattern.apart).T
