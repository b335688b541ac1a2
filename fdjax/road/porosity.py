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


class LayerDeposit(NamedTuple):
    """Volume per layer, averaged over the layers, at sample points.

    - `xy`: shape (n, 2), mm; `volume`: shape (n,), mm^3.
    """

    xy: Float[Array, "n 2"]
    volume: Float[Array, " n"]


class Samples(NamedTuple):
    """Where design looks along one side of the unit square, from 0 to 1, both included.

    - `places`: shape (n,), rising; the first and the last are the walls.
    - `weights`: the parts of [0, 1] that places stand for, which add up to 1; 0 on the walls.
    - `lines`: the same for sums over the lines across that side: 0 also where no line is looked at.
    """

    places: Float[Array, " n"]
    weights: Float[Array, " n"]
    lines: Float[Array, " n"]

    @classmethod
    def between(cls, edges: np.ndarray, pieces: int = 1) -> "Samples":
        """Places in the parts of [0, 1] between `edges`: `pieces`, an odd number, in each.

        Lines are looked at in the middle of each part.
        """
        parts = np.diff(edges)
        shares = midpoints(pieces)
        places = (edges[:-1, None] + parts[:, None] * shares).ravel()
        lines = (parts[:, None] * (np.arange(pieces) == pieces // 2)).ravel()
        ends = np.zeros(1), np.ones(1)
        return cls(
            jnp.asarray(np.concatenate([ends[0], places, ends[1]])),
            jnp.asarray(np.pad(np.repeat(parts / pieces, pieces), 1)),
            jnp.asarray(np.pad(lines, 1)),
        )


class Lattice(NamedTuple):
    """A map and its tangents where design looks, walls included.

    - `xi`, `eta`: the samples along them, n and m.
    - `xy`: shape (n, m, 2), mm; `along`: tangents there.
    """

    xi: Samples
    eta: Samples
    xy: Float[Array, "n m 2"]
    along: Tangents

    @classmethod
    def of(cls, grid: AbstractGridMap, samples: tuple[Samples, Samples]) -> "Lattice":
        xi, eta = samples
        return cls(xi, eta, *tangents(grid, xi.places[:, None], eta.places[None]))


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
    def of(
        cls,
        across: Tangents,
        beside: Tangents,
        clearance: Float[Array, ""] | float,
        *,
        closed: bool = False,
    ) -> "Margins":
        """From the tangents on two lattices.

        The first and last rows of one, (n, m), are the walls of constant xi, and the first and last
        columns of the other, (p, q), those of constant eta.

        To first order: clearance times |r_eta| / J at the walls of constant xi, |r_xi| / J at the
        others, so that distances are taken square to the wall. `closed`: the others are none, but
        the cut of a ring.
        """
        ends = jnp.array([0, -1])
        xi = clearance * norm(across.eta[ends]) / across.jacobian[ends]
        eta = clearance * norm(beside.xi[:, ends])
        eta = jnp.zeros_like(eta) if closed else eta / beside.jacobian[:, ends]
        return cls(xi[0], xi[1], eta[:, 0], eta[:, 1])

    def shift_xi(self, u: Float[Array, " n"]) -> Float[Array, "n m"]:
        """What squeezes places u in [0, 1] between the margins, at each node along eta."""
        return self.left - u[:, None] * (self.left + self.right)

    def shift_eta(self, v: Float[Array, " m"]) -> Float[Array, "n m"]:
        """What squeezes places v in [0, 1] between the margins, at each node along xi."""
        return self.bottom[:, None] - v * (self.bottom + self.top)[:, None]


def line_deposit(
    lattice: Lattice,
    width: Callable[[Array, Array], Array],
    height: float,
    lines: tuple[Float[Array, ""], Float[Array, ""]],
    stacking: Stacking,
    *,
    closed: bool = False,
    left: tuple[Float[Array, " m"], Float[Array, " m"]] | None = None,
    least_spacing: Float[Array, ""] | float | None = None,
    times: Callable[[Array], Array] | None = None,
) -> LayerDeposit:
    """Where the families of grid lines put their material, turn-arounds included.

    - `width`: road width in mm as a function of (xi, eta).
    - `lines`: lines of each family on a layer that has it; need not be whole numbers, since with
      several phases the layers differ.
    - `closed`: whether the map is a ring along eta: there are no walls at its cut, lines of
      constant xi are closed and have no turn-arounds.
    - `left`: where the side xi = 0 is no wall everywhere, the share of a wall's clearance that
      lines keep from it, and the share of its turn-arounds that it has, at each place along eta.
    - `least_spacing`: of the eta lines of a disc, mm, which end early towards its middle, and turn
      around at its rim alone; see `kept`. None: all run from wall to wall.
    - `times`: as a function of the place (n, m, 2), mm, how many times as many lines lie there.

    Lines keep half a road from the walls: the lattice is squeezed by that much, to first order.
    Between two lines the path runs along one wall or the other in turn, so over the layers half
    of each wall is covered, less where a family begins and ends. Differentiable in everything but
    the integers.
    """
    xi, eta, along = lattice.xi, lattice.eta, lattice.along
    edge = Margins.of(along, along, widest(width) / 2, closed=closed)
    if left is not None:
        edge = edge._replace(left=edge.left * left[0])
    shift_xi, shift_eta = edge.shift_xi(xi.places), edge.shift_eta(eta.places)
    xy = lattice.xy + along.xi * shift_xi[..., None] + along.eta * shift_eta[..., None]
    area = section_area(width(xi.places[:, None] + shift_xi, eta.places + shift_eta), height)
    # Centre line on the mean layer along eta and along xi: the lines of a family, and on the walls
    # the turn-arounds of the other one.
    share = [stacking.layer_share(family) for family in FAMILIES]
    if closed:
        # Where the lines begin moves around from layer to layer; one gap has no turn.
        turns_along_eta = share[1] * jnp.full(len(eta.places), (1 - 1 / lines[1]) / 2)
        turns_along_xi = jnp.zeros(len(xi.places))
    else:
        turns_along_eta = share[1] * _covered(eta.places, lines[1])
        turns_along_xi = share[0] * _covered(xi.places, lines[0])
    walls_xi, walls_eta = _walls(xi.places)[:, None], _walls(eta.places)
    run_along_eta = share[0] * lines[0] * xi.lines[:, None]
    run_along_xi = share[1] * lines[1] * eta.lines
    if least_spacing is not None:
        walls_xi[0] = 0.0
        spacing = along.jacobian / (lines[1] * norm(along.xi))
        run_along_xi = run_along_xi * kept(spacing / least_spacing)
    if left is not None:
        walls_xi = walls_xi * jnp.where(np.arange(len(walls_xi))[:, None] == 0, left[1], 1.0)
    if times is not None:
        more = times(xy)
        run_along_eta, run_along_xi = more * run_along_eta, more * run_along_xi
    run_along_eta = run_along_eta + walls_xi * turns_along_eta
    run_along_xi = run_along_xi + walls_eta * turns_along_xi[:, None]
    along_eta = norm(along.eta) * (1 - edge.bottom - edge.top)[:, None] * eta.weights
    along_xi = norm(along.xi) * (1 - edge.left - edge.right) * xi.weights[:, None]
    volume = area * (run_along_eta * along_eta + run_along_xi * along_xi)
    return LayerDeposit(xy.reshape(-1, 2), volume.ravel())


def _walls(places: Float[Array, " n"]) -> np.ndarray:
    """1 at the first and the last place, 0 between."""
    return np.pad(np.zeros(len(places) - 2), 1, constant_values=1)


def _covered(places: Float[Array, " n"], lines: Float[Array, ""]) -> Float[Array, " n"]:
    """Share of the layers on which the path turns along the wall at these places."""
    return jnp.minimum(jnp.minimum(places, 1 - places) * lines, 1) / 2


HALVINGS = 8
"""So often at most the number of lines is halved."""

_EDGE = 0.4
"""Share of a spacing over which an end is smeared in design."""


def kept(spacing: Float[Array, "..."]) -> Float[Array, "..."]:
    """Share of the lines that are kept where all would be `spacing` least spacings apart.

    Half of them where that is below 1, a quarter below 1/2 and so on, as `first_kept` ends them;
    each step smeared, so that it can be differentiated.
    """
    powers = 2.0 ** np.arange(HALVINGS)
    clear = jnp.clip((spacing[..., None] * powers - 1) / _EDGE + 0.5, 0.0, 1.0)
    return (clear / (2 * powers)).sum(-1) + 0.5 / powers[-1]


KEPT = 0.72
"""Mean of `kept` times spacing where lines end by halves: density of those, in least spacings."""


def first_kept(spacing: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Of lines side by side, the point from which on each keeps its distance from the others.

    - `spacing`: of all of them, in least spacings, at the points of each, shape (lines, points).
    - `level`: of each line. One whose level can be halved h times has neighbours 2^h apart once
      the others have ended.

    >>> first_kept(np.array([[0.3, 0.6, 1.2]] * 4), np.arange(4)).tolist()
    [0, 2, 1, 2]
    """
    halved = np.sum(level[:, None] % 2 ** np.arange(1, HALVINGS + 1) == 0, axis=1)
    crowded = (spacing * 2.0 ** halved[:, None] < 1) & (halved < HALVINGS)[:, None]
    count = spacing.shape[1]
    return np.where(crowded.any(1), count - np.argmax(crowded[:, ::-1], axis=1), 0)


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
