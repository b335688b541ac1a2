"""Elliptic lattices of several blocks, solved as one: lines run through the joins without a kink.

Each block is a rectangle of the plane of xi and eta, as long and as wide as its sides are in the
mean, and the equations of `winslow` hold at every node that four cells meet at, on shared sides
too, whose nodes are free. Where steps differ across a side, the three nodes across it are taken to
even steps by the parabola through them. At a corner of three blocks, or of five and more, the
plane has a cone, and the map there is a power of it, of which the corner is the mean of the nodes
next to it.

Newton's method, with SciPy's sparse elimination, which is kept near the solution: solved once,
outside of gradients.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from fdjax.errors import InputError
from fdjax.grid import operators, winslow
from fdjax.grid.algebraic import Spacings, Transfinite
from fdjax.grid.base import Sides
from fdjax.grid.block_net import Net
from fdjax.grid.elliptic import NodeMap
from fdjax.grid.spacing import SlopedSpacing
from fdjax.grid.transfer import Pair
from fdjax.grid.winslow import ControlFunctions
from fdjax.part.blocks import ENDS, Blocks, padded
from fdjax.part.curve import spline
from fdjax.part.ring import at
from fdjax.precision import require_float64
from fdjax.programs import program

Floats = NDArray[np.float64]

TOLERANCE = 1e-10
"""What the mean correction has to come down to, of that of the transfinite lattices."""

MOST_STEPS, HALVINGS = 40, 12
"""Steps of Newton's method, and how often one is halved at most."""

STALE = 0.1
"""An elimination is kept while a step brings the correction down to less than this share."""

SLOPES = 0.25, 1.75
"""Least and largest slope of a wall's spacing at its ends."""

ROUNDING = 1e-12
"""And of the region's size, which is what rounding leaves."""

MOST_NODES, NODES_IN_ALL = 33, 30_000
"""Nodes along a side of a block at most, and of all blocks."""

ELSE = "name other blocks with pattern.blocks, or leave pattern.smooth out"

ELIMINATION: Any = {"permc_spec": "MMD_AT_PLUS_A", "options": {"SymmetricMode": True}}

NONE = ControlFunctions(*[jnp.zeros(())] * 4)


class Joined(NamedTuple):
    """Solved lattices of blocks.

    - `nodes`: (n, 2), mm, each once; `net`: which of them are those of each block.
    - `steps`: of Newton's method; `correction`: mean correction, mm, at the start and at the end.
    """

    nodes: Floats
    net: Net
    steps: int
    correction: tuple[float, float]

    @property
    def lattices(self) -> Floats:
        """Of each block, (m, n, n, 2), mm."""
        return self.nodes[self.net.index]


def smoothed(blocks: Blocks) -> tuple[Blocks, NodeMap]:
    """The blocks with shared sides as the elliptic equations have them, and their maps.

    The maps' arrays have a leading axis of blocks. Raises what `solve` does.
    """
    found = solve(blocks, min(MOST_NODES, math.isqrt(NODES_IN_ALL // len(blocks.blocks))))
    return moved(blocks, found), mapped(blocks, found)


def stacked_sides(blocks: Blocks) -> Sides:
    """The sides of all blocks, each curve with a leading axis of blocks."""
    count = len(blocks.blocks)
    curves = padded([blocks.side(block, k) for k in range(4) for block in range(count)])
    return Sides(*(
        jax.tree.map(lambda *parts: jnp.asarray(np.stack(parts)), *curves[k : k + count])
        for k in range(0, 4 * count, count)
    ))  # fmt: skip


def solve(blocks: Blocks, n: int) -> Joined:
    """Lattices of n x n nodes a block, n >= 5, with the elliptic equations across all joins.

    Nodes of walls stay: evenly spaced, but as dense before as behind a join that ends at a wall
    which runs on there. Corners of blocks within the part move. Raises `InputError`, with the
    place, where lattices fold or the equations are not solved.
    """
    require_float64()
    net = Net.of(blocks, n)
    r = np.empty((net.index.max() + 1, 2))
    r[net.index] = _started(stacked_sides(blocks), wall_spacings(blocks), n)
    found = _newton(net, r)
    _check(found)
    return found


def moved(blocks: Blocks, found: Joined) -> Blocks:
    """The blocks with their shared sides and corners where the solved ones are."""
    sides = dict(blocks.sides)
    for key, users in blocks.users.items():
        if len(users) == 2:
            sides[key] = spline(found.nodes[found.net.along(blocks, key)])
    return replace(blocks, nodes=found.nodes[: len(blocks.nodes)], sides=sides)


def mapped(blocks: Blocks, found: Joined) -> NodeMap:
    """The maps of solved blocks, their arrays with a leading axis; walls are kept exactly."""
    every = range(len(blocks.blocks))
    kept = [[len(blocks.users[key]) == 1 for key in blocks.keys(block)] for block in every]
    grid = jax.vmap(NodeMap.through)(
        jnp.asarray(found.lattices), stacked_sides(blocks), wall_spacings(blocks)
    )
    return eqx.tree_at(lambda own: own.kept, grid, tuple(jnp.array(kept, float).T))


def wall_spacings(blocks: Blocks) -> Spacings:
    """Of all sides: even, but where a wall runs on past a join as dense before as behind it."""
    slopes = np.ones((len(blocks.blocks), 4, 2))
    walls = {key: users[0] for key, users in blocks.users.items() if len(users) == 1}
    set_by_join = np.zeros(slopes.shape, bool)
    for vertex in range(len(blocks.nodes)):
        ends = [(key, user) for key, user in walls.items() if vertex in key]
        if len(ends) != 2 or (blocks.blocks == vertex).sum() != 2:
            continue
        reach = [blocks.extents[b, k % 2] for _, (b, k) in ends]
        length = [blocks.sides[key].length for key, _ in ends]
        speed = sum(length) / sum(reach)
        for (_, (b, k)), own, size in zip(ends, reach, length, strict=True):
            last = int(blocks.blocks[b][ENDS[k][1]] == vertex)
            slopes[b, k, last] = speed * own / size
            set_by_join[b, k, last] = True
    # Parabolas where one end is free.
    free = ~set_by_join & set_by_join[..., ::-1]
    slopes = np.where(free, 2 - slopes[..., ::-1], slopes)
    slopes = jnp.asarray(np.clip(slopes, *SLOPES))
    return Spacings(*(SlopedSpacing(slopes[:, k, 0], slopes[:, k, 1]) for k in range(4)))


@program
def _started(sides: Sides, spacings: Spacings, n: int) -> Float[Array, "m n n 2"]:
    run = jnp.linspace(0, 1, n)
    return jax.vmap(lambda *own: Transfinite(*own)(run[:, None], run[None]))(sides, spacings)


def _newton(net: Net, r: Floats) -> Joined:
    system = _System.of(net, len(r))
    first = size = _size(net, r)
    goal = _goal(r, first)
    folded = bool(_folded(r[net.index]))
    steps, factors = 0, None
    while size > goal and steps < MOST_STEPS:
        fresh = factors is None
        if factors is None:
            factors = system.eliminated(net, r)
        change = system.change(factors, net, r)
        for halving in range(HALVINGS + 1):
            trial = r.copy()
            trial[system.own] += 0.5**halving * change
            now, folds = _size(net, trial), bool(_folded(trial[net.index]))
            if now < size and (folded or not folds):
                break
        else:
            if fresh:
                break
            factors = None
            continue
        # An elimination serves as long as it does about as well as the next one would.
        factors = factors if now < STALE * size else None
        r, size, folded, steps = trial, now, folds, steps + 1
    return Joined(r, net, steps, (first, size))


def _goal(r: Floats, first: float) -> float:
    return max(TOLERANCE * first, ROUNDING * float(np.ptp(r, axis=0).max()))


class _System(NamedTuple):
    """Where the entries of the linearised equations stand.

    - `own`: the nodes that move, (M,); `rows`, `columns`: of the entries; `inner`: those of nodes
      that move.
    """

    own: NDArray[np.intp]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    inner: NDArray[np.bool_]

    @classmethod
    def of(cls, net: Net, count: int) -> "_System":
        own = np.concatenate([net.around[:, 1, 1], [odd.node for odd in net.odd]]).astype(int)
        free = np.full(count, -1)
        free[own] = np.arange(len(own))
        two = np.arange(2)
        near = free[net.around][:, None, :, :, None]
        shape = (len(near), 2, 3, 3, 2)
        parts = [np.broadcast_arrays(
            2 * np.arange(len(near)).reshape(-1, 1, 1, 1, 1) + two.reshape(1, 2, 1, 1, 1),
            np.where(near < 0, -1, 2 * near + two), np.empty(shape),
        )[:2]]  # fmt: skip
        for odd in net.odd:
            around = free[[odd.node, *odd.near]]
            parts.append(np.broadcast_arrays(
                2 * free[odd.node] + two, np.where(around < 0, -1, 2 * around)[:, None] + two
            ))  # fmt: skip
        rows, columns = (np.concatenate([part[k].ravel() for part in parts]) for k in (0, 1))
        return cls(own, rows, columns, columns >= 0)

    def eliminated(self, net: Net, r: Floats) -> Any:
        """The linearised equations, eliminated; `None` where they are singular."""
        entries = [np.asarray(_slopes(r[net.around], net.ratio)).ravel()]
        entries += [np.repeat([-1.0, *odd.weights], 2) for odd in net.odd]
        size, inner = 2 * len(self.own), self.inner
        places = self.rows[inner], self.columns[inner]
        matrix = coo_array((np.concatenate(entries)[inner], places), (size, size))
        try:
            return splu(matrix.tocsc(), **ELIMINATION)
        except RuntimeError:  # what SciPy raises for a singular matrix
            return None

    def change(self, factors: Any, net: Net, r: Floats) -> Floats:
        """Newton's step, (M, 2), mm; no numbers where there is none."""
        if factors is None:
            return np.full((len(self.own), 2), np.nan)
        rhs = [np.asarray(_residuals(r[net.around], net.ratio)).ravel()]
        rhs += [odd.off(r) for odd in net.odd]
        return -factors.solve(np.concatenate(rhs)).reshape(-1, 2)


def _evened(nodes: Float[Array, "3 3 2"], ratio: Float[Array, " 2"]) -> Float[Array, "3 3 2"]:
    """Nodes taken to even steps along both axes, each by the parabola through three."""
    for axis in (0, 1):
        before, here, after = jnp.moveaxis(nodes, axis, 0)
        t = ratio[axis]
        # One step beyond the middle one of nodes at -1, 0 and t.
        beyond = (1 - t) / (1 + t) * before + 2 * (t - 1) / t * here + 2 / (t * (1 + t)) * after
        nodes = jnp.stack([before, here, beyond], axis)
    return nodes


def _residual(nodes: Float[Array, "3 3 2"], ratio: Float[Array, " 2"]) -> Float[Array, " 2"]:
    return winslow.residual(_evened(nodes, ratio), NONE)[0, 0]


_residuals = jax.jit(jax.vmap(_residual))
"""Of nodes (N, 3, 3, 2) and ratios (N, 2), (N, 2)."""

_slopes = jax.jit(jax.vmap(jax.jacrev(_residual)))
"""And their derivatives by the nodes around, (N, 2, 3, 3, 2)."""


@jax.jit
def _corrections(nodes: Float[Array, "N 3 3 2"], ratio: Float[Array, "N 2"]) -> Array:
    return jax.vmap(lambda *own: winslow.correction(_evened(*own), NONE)[0, 0])(nodes, ratio)


def _size(net: Net, r: Floats) -> float:
    """Mean absolute correction of a coordinate, mm."""
    corrections = [np.asarray(_corrections(r[net.around], net.ratio))]
    corrections += [odd.off(r)[None] for odd in net.odd]
    return float(np.abs(np.concatenate(corrections)).mean())


def _lanes(lattices: Any) -> Pair:
    """Blocks side by side, as `transfer` has lattices."""
    return jnp.moveaxis(lattices[..., 0], 0, 2), jnp.moveaxis(lattices[..., 1], 0, 2)


_folded = jax.jit(lambda lattices: operators.folded(_lanes(lattices)).any())


def _check(found: Joined) -> None:
    lattices, (first, last) = found.lattices, found.correction
    areas = operators.corner_jacobians(_lanes(lattices))
    least = np.min([np.asarray(area) for area in areas], 0)
    i, j, block = np.unravel_index(least.argmin(), least.shape)
    if not least[i, j, block] > 0:
        raise InputError(
            f"blocks: smoothed lines would cross at {at(lattices[block, i, j])}; {ELSE}"
        )
    if last > _goal(found.nodes, first):
        raise InputError(
            f"blocks: the equations of smooth joins are not solved, corrections of {last:.2g} mm "
            f"are left of {first:.2g} mm; {ELSE}"
        )
