"""Porosity, and where a pattern of grid lines puts its material, differentiably.

The one definition, for design and for measuring alike: the solid share of a window is the volume
deposited on centre lines inside it (section area of `road.bead`; what overlaps counts twice) over
the outline's area in it (less holes) times the height of the layers; porosity = 1 - solid share.

Here the lines of a family are replaced by their mean over all phases: a density of centre line
per area. With P phases the written roads differ from it by at most half a line's volume in a
window, however the windows lie.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fdjax.grid.base import AbstractGridMap, Tangents, norm, tangents
from fdjax.road.bead import section_area
from fdjax.road.stacking import FAMILIES, Stacking


class Deposit(NamedTuple):
    """Volume per layer, averaged over the layers, at sample points.

    - `xy`: shape (n, 2), mm; `volume`: shape (n,), mm^3.
    """

    xy: Float[Array, "n 2"]
    volume: Float[Array, " n"]


class Samples(NamedTuple):
    """Places in (0, 1), shape (n,), and the parts of [0, 1] they stand for, which add up to 1."""

    places: Float[Array, " n"]
    weights: Float[Array, " n"]

    @classmethod
    def between(cls, edges: np.ndarray) -> "Samples":
        """The middles of the parts of [0, 1] between these edges."""
        return cls(jnp.asarray((edges[1:] + edges[:-1]) / 2), jnp.asarray(np.diff(edges)))


class FamilySamples(NamedTuple):
    """Where design looks at one family: `across` its lines, and along their `run`."""

    across: Samples
    run: Samples


def equal_edges(spacing: Callable[[np.ndarray], np.ndarray], count: int) -> np.ndarray:
    """Edges of `count` parts of [0, 1] whose images under `spacing`, a rising map, are equal."""
    fine = np.linspace(0, 1, 2049)
    return np.interp(np.linspace(0, 1, count + 1), spacing(fine), fine)


def whole_lines(edges: np.ndarray, comb: int) -> np.ndarray:
    """The edges moved so that each part holds whole lines of a comb of equally spaced places.

    Where the comb is coarser than the parts, each line gets a part of its own.
    """
    return np.unique(np.round(edges * comb)) / comb


def midpoints(count: int) -> np.ndarray:
    """Middles of `count` equal parts of [0, 1]."""
    return (np.arange(count) + 0.5) / count


class Margins(NamedTuple):
    """How far in xi and in eta a clearance from the walls reaches, along each wall."""

    left: Float[Array, " m"]
    right: Float[Array, " m"]
    bottom: Float[Array, " n"]
    top: Float[Array, " n"]

    @classmethod
    def of(cls, walls: Tangents, clearance: Float[Array, ""] | float) -> "Margins":
        """From the tangents on a lattice (n, m) whose outer lines are the walls.

        To first order: clearance times |r_eta| / J at the walls of constant xi, |r_xi| / J at the
        others, so that distances are taken square to the wall.
        """
        xi = clearance * norm(walls.eta[jnp.array([0, -1])]) / walls.jacobian[jnp.array([0, -1])]
        eta = clearance * norm(walls.xi[:, jnp.array([0, -1])])
        eta = eta / walls.jacobian[:, jnp.array([0, -1])]
        return cls(xi[0], xi[1], eta[:, 0], eta[:, 1])

    def shift_xi(self, u: Float[Array, " n"]) -> Float[Array, "n m"]:
        """What squeezes places u in [0, 1] between the margins, at each node along eta."""
        return self.left - u[:, None] * (self.left + self.right)

    def shift_eta(self, v: Float[Array, " m"]) -> Float[Array, "n m"]:
        """What squeezes places v in [0, 1] between the margins, at each node along xi."""
        return self.bottom[:, None] - v * (self.bottom + self.top)[:, None]


def line_deposit(
    grid: AbstractGridMap,
    width: Callable[[Array, Array], Array],
    height: float,
    lines: tuple[Float[Array, ""], Float[Array, ""]],
    stacking: Stacking,
    samples: tuple[FamilySamples, FamilySamples],
) -> Deposit:
    """Where the families of grid lines put their material, turn-arounds included.

    - `width`: road width in mm as a function of (xi, eta).
    - `lines`: lines of each family on a layer that has it; need not be whole numbers, since with
      several phases the layers differ.
    - `samples`: of the xi family and of the eta family.

    Lines keep half a road from the walls: the lattice is squeezed by that much, to first order.
    Between two lines the path runs along one wall or the other in turn, so over the layers half
    of each wall is covered, less where a family begins and ends. Differentiable in everything but
    the integers.
    """
    clearance = widest(width) / 2
    xy, volume = [], []
    for family, (across, run) in enumerate(samples):
        # The lattice of samples, and the walls around it.
        axes = (across, run) if family == 0 else (run, across)
        u, v = (jnp.concatenate([jnp.zeros(1), each.places, jnp.ones(1)]) for each in axes)
        points, along = tangents(grid, u[:, None], v[None])
        edge = Margins.of(along, clearance)
        shift_xi, shift_eta = edge.shift_xi(u), edge.shift_eta(v)
        points += along.xi * shift_xi[..., None] + along.eta * shift_eta[..., None]
        area = section_area(width(u[:, None] + shift_xi, v[None] + shift_eta), height)
        if family == 0:
            length = norm(along.eta) * (1 - edge.bottom - edge.top)[:, None]
        else:
            points, area = points.swapaxes(0, 1), area.T
            length = (norm(along.xi) * (1 - edge.left - edge.right)).T
        # Centre line on the mean layer: this family's lines, and where the other one turns along
        # the two walls beside them.
        own = stacking.layer_share(FAMILIES[family]) * lines[family] * across.weights[:, None]
        turns = stacking.layer_share(FAMILIES[1 - family]) * _covered(run.places, lines[1 - family])
        shares = jnp.concatenate(
            [turns[None], jnp.broadcast_to(own, (len(own), len(turns))), turns[None]]
        )
        points, area, length = points[:, 1:-1], area[:, 1:-1], length[:, 1:-1]
        xy.append(points.reshape(-1, 2))
        volume.append((area * length * shares * run.weights).ravel())
    return Deposit(jnp.concatenate(xy), jnp.concatenate(volume))


def _covered(places: Float[Array, " n"], lines: Float[Array, ""]) -> Float[Array, " n"]:
    """Share of the layers on which the path turns along the wall at these places."""
    return jnp.minimum(jnp.minimum(places, 1 - places) * lines, 1) / 2


def widest(width: Callable[[Array, Array], Array]) -> Float[Array, ""]:
    """The largest road width on a lattice of 17 x 17 places."""
    places = jnp.linspace(0, 1, 17)
    return width(places[:, None], places[None]).max()


def cell_porosity(
    along: Tangents,
    width: Float[Array, "..."] | float,
    height: float,
    lines: tuple[Float[Array, ""] | float, Float[Array, ""] | float],
    stacking: Stacking,
) -> Float[Array, "..."]:
    """Porosity of the lines alone, cell by cell: `1 - (a / h) sum_f share_f / spacing_f`.

    `spacing_xi = J / (n_xi |r_eta|)`, `spacing_eta = J / (n_eta |r_xi|)`, a the section area, h the
    layer height and share_f the share of layers with the family. It knows neither walls nor
    turn-arounds: right inside, high by what they add along a wall.
    """
    density = 0.0
    for family, n, tangent in zip(FAMILIES, lines, (along.eta, along.xi), strict=True):
        density = density + stacking.layer_share(family) * n * norm(tangent) / along.jacobian
    return 1 - section_area(width, height) / height * density
