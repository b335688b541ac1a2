"""Grid lines as roads: two families of lines of a map of the unit square."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.errors import InputError
from fdjax.grid import bspline
from fdjax.grid.base import AbstractGridMap, Sides, Tangents, norm
from fdjax.grid.laplacians import laplacians
from fdjax.grid.quality import quality
from fdjax.grid.solvers import AbstractSolver, Newton
from fdjax.limits import Limits
from fdjax.pattern.base import AbstractPattern, Panel, Penalties
from fdjax.pattern.embedded import Embedded
from fdjax.pattern.embedded_lines import border_joins
from fdjax.pattern.grid_controls import Controls
from fdjax.pattern.grid_layers import layers, shape_of
from fdjax.pattern.maps import CLOSED, MAPS, NEED_BASE
from fdjax.pattern.slit_lines import on_base, on_hole, walled
from fdjax.pattern.width import AbstractWidth, SplineWidth, UniformWidth, within
from fdjax.programs import program
from fdjax.road import porosity
from fdjax.road.deposit import Points
from fdjax.road.holes import Holes
from fdjax.road.porosity import Lattice, Samples
from fdjax.road.stacking import FAMILIES, Stacking
from fdjax.road.stroke import Lines


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
    - `tail`: of a C-grid, from which eta of its base on to 1 - `tail` the side xi = 0 is the hole's
      wall; elsewhere it is the cut, both sides of which are one. Else None.
    - `spiral`: whether a closed map's xi lines are one spiral on each layer.
    - `embedded`: zones in which a map with four sides has finer lines between its own.
    - `notes`: what was found of the map as it was made.
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
    tail: float | None = None
    spiral: bool = eqx.field(static=True, default=False)
    embedded: Embedded = eqx.field(static=True, default=Embedded(()))
    notes: tuple[str, ...] = eqx.field(static=True, default=())

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
            values = values if self.tail is None else bspline.folded(values)
            width = SplineWidth(values, low, high)
        return grid, made, width

    def deposit(self, realised: Realised) -> Points:
        width, left = realised.width, None
        if self.tail is not None:
            begins = on_base(realised.grid, self.samples[1].places)
            left = walled(begins, self.tail), on_hole(begins, self.tail)
        xy, volume = porosity.line_deposit(
            realised.lattice,
            width,
            self.height,
            self.lines_per_layer,
            self.stacking,
            closed=self.closed,
            left=left,
            least_spacing=self.apart,
            times=self.embedded.times if self.embedded.zones else None,
        )
        shares = sum(self.stacking.layer_share(family) for family in FAMILIES)
        if self.joined:
            # A border has one of the families end at it.
            places, more = border_joins(
                self.embedded, porosity.widest(width), self.height, shares / 2
            )
            xy, volume = jnp.concatenate([xy, places]), jnp.concatenate([volume, more])
        if self.holes is not None:
            xy, volume = self.holes.cut(
                porosity.LayerDeposit(xy, volume), porosity.widest(width), self.height, shares
            )
        return Points(_at_middle(xy, self._depth), volume * self.stacking.layers)

    @property
    def joined(self) -> bool:
        """Whether fine lines are joined where they end: with both families on a layer lines of the
        other one lie there already."""
        return bool(self.embedded.zones) and not self.stacking.both_families

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
        local = 1 - (1 - local) * self.embedded.times(xy)
        area = along.jacobian * xi.weights[:, None] * eta.weights
        points = _at_middle(xy[1:-1, 1:-1].reshape(-1, 2), self._depth)
        return points, local[1:-1, 1:-1].ravel(), area[1:-1, 1:-1].ravel() * self._depth

    def penalties(self, realised: Realised, limits: Limits) -> Penalties:
        xi, eta, xy, walled = realised.lattice
        n_xi, n_eta = self.lines_per_layer
        least = limits.least_spacing or realised.width(xi.places[:, None], eta.places[None])
        # Beyond a fold spacing means nothing, and a division by J would blow up.
        positive = jnp.maximum(walled.jacobian, 1e-3 * jnp.abs(walled.jacobian).mean())
        times, finest = self.embedded.times(xy), self.embedded.times(xy, beyond=0.5)
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

    def skew(self, realised: Realised) -> Float[Array, "n m"]:
        """|cos| of the angle between the families where design looks, walls included."""
        return realised.lattice.along.skew

    def roughness(self, controls: Controls) -> Float[Array, " n"]:
        return controls.roughness(closed=self.closed)

    def widths(self, realised: Realised) -> tuple[Array, Array]:
        places = jnp.linspace(0, 1, QUALITY_NODES)
        width = realised.width(places[:, None], places[None])
        return width.min(), width.max()

    def strokes(self, controls: Controls, points: int = 257) -> Iterator[Sequence[Lines]]:
        return layers(self, controls, points)

    @property
    def mean_by_count(self) -> bool:
        return True

    def counted(self, asked: float, laid: float) -> "GridLines":
        """The pattern with as many lines, of the family that has more, as the mean asks for."""
        if self.counts_fixed or laid <= 0:
            return self
        counts = [int(n) for n in self.comb]
        # Eta lines of a disc are as many as can be halved, xi lines of a C on each layer as many.
        more = int(np.argmax(counts)) if self.apart is None else 0
        more = more if self.tail is None else 1
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
        xy = _nodes(shape_of(self, controls)[0])
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
        measures = quality(np.asarray(_nodes(shape_of(self, controls)[0])))
        return {
            "kind": "grid-lines",
            "map": self.kind,
            "lines_per_layer": {"xi": xi, "eta": eta},
            "phases": self.stacking.phases,
            "grid": {name: float(value) for name, value in measures._asdict().items()},
            **({"embedded": self.embedded.facts} if self.embedded.zones else {}),
            **({"warnings": list(self.notes)} if self.notes else {}),
        }


QUALITY_NODES = 65
"""Nodes each way of the grid whose quality is reported."""

FOLD_FLOOR = 0.02
"""J over its mean below which design is pushed back from folding."""


def comb_of(counts: Sequence[int]) -> tuple[Array, Array]:
    """Counts of lines as a pattern has them: numbers that XLA need not know when it compiles."""
    return jax.device_put((np.asarray(counts[0], float), np.asarray(counts[1], float)))


def _at_middle(xy: Array, depth: float) -> Array:
    """Points of a layer, (n, 2), at half the part's height, (n, 3)."""
    return jnp.concatenate([xy, jnp.full((len(xy), 1), depth / 2)], 1)


@program
def _volume(pattern: GridLines) -> Array:
    return pattern.deposit(pattern.realise(pattern.first)).volume.sum()


@program
def _nodes(grid: AbstractGridMap) -> Array:
    places = jnp.linspace(0, 1, QUALITY_NODES)
    return grid(places[:, None], places[None])
