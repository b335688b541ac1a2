"""Lines of a map, traced: from wall to wall, off those beside them, or round and round."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fdjax.grid.base import AbstractGridMap, tangents
from fdjax.pattern.slit_lines import mirrored, on_base, walled
from fdjax.pattern.width import AbstractWidth
from fdjax.programs import program
from fdjax.road import porosity
from fdjax.road.porosity import Margins

_BATCH = 32
"""Lines are traced in batches of so many, so that another count is no other program."""


@program
def margins(
    grid: AbstractGridMap,
    width: AbstractWidth,
    points: int,
    *,
    closed: bool,
    tail: float | None = None,
) -> Margins:
    """Off the walls that a family runs along, lines keep half of the widest road.

    `tail`: of a C-grid, whose side xi = 0 is a wall from there to 1 - `tail` only.
    """
    run, ends = jnp.linspace(0, 1, points), jnp.array([0.0, 1.0])
    _, xi_walls = tangents(grid, ends[:, None], run[None])
    _, eta_walls = tangents(grid, run[:, None], ends[None])
    edge = Margins.of(xi_walls, eta_walls, porosity.widest(width) / 2, closed=closed)
    if tail is None:
        return edge
    return mirrored(edge._replace(left=edge.left * walled(on_base(grid, run), tail)))


def traced(
    grid: AbstractGridMap, width: AbstractWidth, edge: Margins, combs: tuple[Array, Array]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of both families, points of the lines from wall to wall, and their widths.

    `combs`: places of the xi lines, (lines, points or 1), and of the eta lines, (lines,).
    """
    combs, edge = jax.device_get((combs, edge))
    run = np.linspace(0, 1, len(edge.left))
    of_xi = combs[0] + edge.left - combs[0] * (edge.left + edge.right)
    of_eta = combs[1][:, None] + edge.shift_eta(combs[1]).T
    xy, widths = along(
        grid,
        width,
        np.concatenate([of_xi, np.broadcast_to(run, of_eta.shape)]),
        np.concatenate([np.broadcast_to(run, of_xi.shape), of_eta]),
    )
    families = slice(len(of_xi)), slice(len(of_xi), None)
    return [(xy[each], widths[each]) for each in families]


def along(
    grid: AbstractGridMap,
    width: AbstractWidth,
    xi: np.ndarray,
    eta: np.ndarray,
    *,
    closed: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Points of lines through places xi, eta, (lines, points), and the widths between them.

    `closed`: around a ring, on which eta may go on beyond 1.
    """
    count, points = xi.shape
    padded = ((0, -count % _BATCH), (0, 0))
    batches = (np.pad(each, padded).reshape(-1, _BATCH, points) for each in (xi, eta))
    made = [_batch(grid, width, u, v, closed) for u, v in zip(*batches, strict=True)]
    xy, widths = map(np.concatenate, zip(*made, strict=True))
    return xy[:count], widths[:count]


@program
def _batch(
    grid: AbstractGridMap, width: AbstractWidth, xi: Any, eta: Any, closed: bool
) -> tuple[Array, Array]:
    """Points of lines, and the widths between them."""
    middle_xi, middle_eta = (xi[:, 1:] + xi[:, :-1]) / 2, (eta[:, 1:] + eta[:, :-1]) / 2
    if closed:
        eta, middle_eta = (
            jnp.where(each > 1, each - jnp.floor(each), each) for each in (eta, middle_eta)
        )
    return grid(xi, eta), width(middle_xi, middle_eta)


@program
def spiral(
    grid: AbstractGridMap,
    width: AbstractWidth,
    edge: Margins,
    turn: int,
    points: int,
    count: int,
) -> tuple[Array, Array]:
    """Points and widths of `xi = k / count`, k from 0 to `count`, `points` - 1 to a turn.

    `turn`: of these, where it begins. As many turns as lines on a layer; the phases differ in where
    it begins, so that together they lie as the closed lines do.
    """
    run = jnp.linspace(0, 1, points)
    at = (jnp.arange(count + 1) + turn) % (points - 1)
    xi = jnp.arange(count + 1) / count
    xi = xi + edge.left[at] - xi * (edge.left[at] + edge.right[at])
    return grid(xi, run[at]), width((xi[1:] + xi[:-1]) / 2, (run[at[:-1]] + run[1]) / 2)
