"""Lines of a C-grid, which is cut open from the outline to a hole: they know nothing of the cut.

A line of constant xi runs along one side of the cut, around the hole and back along the other side;
one of constant eta that begins on the cut goes on beyond it. Both need that what lies on one side
of the cut is what lies on the other, mirrored: place u of a comb there is place 1 - u. Each phase
of a family is therefore led around the hole to the phase that mirrors it.
"""

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
"""Share of the cut, next to the hole, on which xi lines come to the distance that walls ask for."""

_FAR = 1_000_003
"""Levels of lines that begin on the hole and of those that cross the cut lie so far apart."""


def on_base(grid: AbstractGridMap, eta: Float[Array, " m"]) -> Float[Array, " m"]:
    """Where lines of constant eta begin, on xi = 0 of the map that is spaced anew."""
    assert isinstance(grid, Respaced)
    return grid.places(jnp.zeros_like(eta), eta)[1]


def walled(eta: Float[Array, " m"], tail: float) -> Float[Array, " m"]:
    """How much of a wall the side xi = 0 is, 1 on the hole; `eta` as `on_base` has it."""
    from_end = jnp.minimum(eta, 1 - eta)
    return jnp.clip(1 - (tail - from_end) / (_RAMP * tail), 0.0, 1.0)


def on_hole(eta: Float[Array, " m"], tail: float) -> Float[Array, " m"]:
    """1 where lines of constant eta begin on the hole, 0 where on the cut."""
    return jnp.where((eta >= tail) & (eta <= 1 - tail), 1.0, 0.0)


def around(eta: Any, tail: float) -> Any:
    """How far around the hole: 0 on the one side of the cut, 1 on the other."""
    return namespace(eta).clip((eta - tail) / (1 - 2 * tail), 0.0, 1.0)


def _steps(share: Floats, comb: int, phases: int) -> list[Floats]:
    """By how many places of a comb the lines of each phase have moved, of the share around.

    Phase p becomes the one that mirrors it. A phase and the one that it becomes change places, so
    that the mean over the phases keeps its density; each such pair on a stretch of its own, so that
    all others are apart there.
    """
    partner = [(comb - 1 - phase) % phases for phase in range(phases)]
    pairs = sorted({min(p, q) for p, q in enumerate(partner) if p != q})
    found = []
    for p, q in enumerate(partner):
        number = pairs.index(min(p, q)) if p != q else 0
        run = np.clip(share * max(len(pairs), 1) - number, 0.0, 1.0)
        found.append((q - p) * run**2 * (3 - 2 * run))
    return found


def xi_places(share: Floats, comb: int, phases: int) -> Floats:
    """Places u of all lines of constant xi, (comb, points), `share` around the hole (points,)."""
    steps = _steps(share, comb, phases)
    return np.stack([(k + 0.5 + steps[k % phases]) / comb for k in range(comb)])


def eta_places(share: Floats, comb: int, phases: int) -> Floats:
    """Places of all lines of constant eta, (comb,), `share` around the hole at equal steps."""
    steps = _steps(share, comb, phases)
    return np.array([(k + 0.5 + steps[k % phases][k]) / comb for k in range(comb)])


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
