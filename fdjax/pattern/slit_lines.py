"""Lines of a C-grid, which is cut open from the outline to a hole: they know nothing of the cut.

A line of constant xi runs along one side of the cut, around the hole and back along the other side;
one of constant eta that begins on the cut goes on beyond it. Both need that what lies on one side
of the cut is what lies on the other, mirrored: place u of a comb there is place 1 - u. Each phase
of a family is therefore led around the hole to the phase that mirrors it.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fdjax.arrays import namespace
from fdjax.grid.base import AbstractGridMap
from fdjax.grid.respaced import Respaced
from fdjax.road.porosity import Margins

Floats = np.ndarray

_RAMP = 0.15
"""Share of the cut, next to the hole, over which it becomes a wall: so design has no step there."""

_FAR = 1_000_003
"""Levels of lines that begin on the hole and of those that cross the cut lie so far apart."""


def on_base(grid: AbstractGridMap, eta: Float[Array, " m"]) -> Float[Array, " m"]:
    """Where lines of constant eta begin, on xi = 0 of the map that is spaced anew."""
    assert isinstance(grid, Respaced)
    return grid.places(jnp.zeros_like(eta), eta)[1]


def walled(eta: Float[Array, " m"], tail: float) -> Float[Array, " m"]:
    """What share of a wall's clearance xi lines keep from xi = 0, 1 on all of the hole.

    `eta` as `on_base` has it.
    """
    from_end = jnp.minimum(eta, 1 - eta)
    return jnp.clip(1 - (tail - from_end) / (_RAMP * tail), 0.0, 1.0)


def on_hole(eta: Float[Array, " m"], tail: float) -> Float[Array, " m"]:
    """1 where lines of constant eta begin on the hole, 0 where on the cut, smeared."""
    from_end = jnp.minimum(eta, 1 - eta)
    return jnp.clip(0.5 - (tail - from_end) / (_RAMP * tail), 0.0, 1.0)


def around(eta: Any, tail: float) -> Any:
    """How far around the hole: 0 on the one side of the cut, 1 on the other."""
    return namespace(eta).clip((eta - tail) / (1 - 2 * tail), 0.0, 1.0)


def _moves(comb: int, phases: int) -> list[tuple[int, Callable[[Floats], Floats]]]:
    """Of each phase, by how many places of a comb its lines move, and what share of it by when.

    Phase p becomes the one that mirrors it. A phase and the one that it becomes change places, so
    that the mean over the phases keeps its density; each such pair on a stretch of its own of the
    way around the hole, so that all others are apart there.
    """
    partner = [(comb - 1 - phase) % phases for phase in range(phases)]
    pairs = sorted({min(p, q) for p, q in enumerate(partner) if p != q})

    def moved(share: Floats, number: int) -> Floats:
        run = np.clip(share * len(pairs) - number, 0.0, 1.0)
        return run**2 * (3 - 2 * run)

    return [
        (q - p, partial(moved, number=pairs.index(min(p, q)) if p != q else 0))
        for p, q in enumerate(partner)
    ]


def xi_places(share: Floats, comb: int, phases: int) -> Floats:
    """Places u of all lines of constant xi, (comb, points), `share` around the hole (points,).

    `comb` is a multiple of `phases`, so that lines of each layer end where they began.
    """
    steps = [by * moved(share) for by, moved in _moves(comb, phases)]
    return np.stack([(k + 0.5 + steps[k % phases]) / comb for k in range(comb)])


def eta_places(share: Floats, comb: int, phases: int) -> Floats:
    """Places of all lines of constant eta, (comb,), `share` around the hole at equal steps."""
    number = np.arange(comb)
    found = (number + 0.5) / comb
    for phase, (by, moved) in enumerate(_moves(comb, phases)):
        own = number[phase::phases]
        # None where a line is on the first side of the cut, all where it comes to the other.
        before, after = share[own], share[np.clip(own + by, 0, comb - 1)]
        found[own] += by * moved(before / np.maximum(before + 1 - after, 1e-300)) / comb
    return found


def mirrored(edge: Margins) -> Margins:
    """The margins at both ends of the cut made one, where lines from both sides are to meet."""
    fade = (1 - jnp.linspace(0, 1, len(edge.bottom))) ** 4
    off = fade * (edge.top[0] - edge.bottom[0]) / 2
    return edge._replace(bottom=edge.bottom + off, top=edge.top - off)


def across(
    xy: Floats, width: Floats, begin: Floats, tail: float
) -> tuple[list[Floats], list[Floats], Floats]:
    """Lines of constant eta of a layer with those joined that meet on the cut, and their levels.

    - `xy`, `width`: of each line, from xi = 0 outwards; `begin`: where on that side, as `on_base`.
    """
    count = int(min((begin < tail).sum(), (begin > 1 - tail).sum()))
    lines, widths = [], []
    for k in range(count):
        here, beyond = xy[k][::-1], xy[-1 - k]
        meeting = (here[-1:] + beyond[:1]) / 2
        lines.append(np.concatenate([here[:-1], meeting, beyond[1:]]))
        widths.append(np.concatenate([width[k][::-1], width[-1 - k]]))
    on_hole = slice(count, len(xy) - count)
    level = np.concatenate([np.arange(count)[::-1], _FAR + np.arange(len(xy) - 2 * count)])
    return [*lines, *xy[on_hole]], [*widths, *width[on_hole]], level
