"""Where the lines of one block of several put their material, with walls at some of its sides."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fdjax.grid.base import Tangents, norm
from fdjax.road.porosity import Lattice, LayerDeposit, Margins, Samples


class Families(NamedTuple):
    """The two families of lines of a block, of constant xi and of constant eta.

    - `lines`: of each on a layer that has it; `shares`: of the layers that have it; shapes (2,).
    - `walls`: 1 where the lines end at bottom, right, top and left, 0 where they run on; (4,).
    """

    lines: Float[Array, " 2"]
    shares: Float[Array, " 2"]
    walls: Float[Array, " 4"]


def patch_deposit(
    lattice: Lattice,
    area: Float[Array, "n m"],
    clearance: Float[Array, ""] | float,
    families: Families,
) -> LayerDeposit:
    """What `porosity.line_deposit` gives, of a block that others adjoin.

    - `area`: of a road's section at the lattice, mm^2; `clearance`: of centre lines from walls, mm.
    """
    xi, eta, along = lattice.xi, lattice.eta, lattice.along
    bottom, right, top, left = families.walls
    edge = wall_margins(along, clearance, families.walls)
    shift = (
        along.xi * edge.shift_xi(xi.places)[..., None]
        + along.eta * edge.shift_eta(eta.places)[..., None]
    )
    lines, shares = families.lines, families.shares
    run_along_eta = shares[0] * lines[0] * xi.lines[:, None] + jnp.outer(
        _at_ends(xi, left, right), shares[1] * _covered(eta, lines[1], bottom, top)
    )
    run_along_xi = shares[1] * lines[1] * eta.lines + jnp.outer(
        shares[0] * _covered(xi, lines[0], left, right), _at_ends(eta, bottom, top)
    )
    along_eta = norm(along.eta) * (1 - edge.bottom - edge.top)[:, None] * eta.weights
    along_xi = norm(along.xi) * (1 - edge.left - edge.right) * xi.weights[:, None]
    volume = area * (run_along_eta * along_eta + run_along_xi * along_xi)
    return LayerDeposit((lattice.xy + shift).reshape(-1, 2), volume.ravel())


def wall_margins(
    along: Tangents, clearance: Float[Array, ""] | float, walls: Float[Array, " 4"]
) -> Margins:
    """How far centre lines keep from those sides of a block that are walls, see `Families`."""
    bottom, right, top, left = walls
    edge = Margins.of(along, along, clearance)
    return Margins(edge.left * left, edge.right * right, edge.bottom * bottom, edge.top * top)


def _at_ends(samples: Samples, first: Array, last: Array) -> Array:
    """1 at the first and the last place where these are walls, 0 elsewhere."""
    inner = np.zeros(len(samples.places) - 2)
    return jnp.concatenate([first[None], inner, last[None]])


def _covered(samples: Samples, lines: Array, first: Array, last: Array) -> Array:
    """Share of the layers on which the path turns along the wall, less beside other walls."""
    begin = jnp.where(first > 0, samples.places * lines, 1.0)
    end = jnp.where(last > 0, (1 - samples.places) * lines, 1.0)
    return jnp.minimum(jnp.minimum(begin, end), 1.0) / 2
