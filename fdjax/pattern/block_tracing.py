"""Lines of blocks, traced: off the walls beside them, and on from block to block."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fdjax.grid.base import AbstractGridMap, tangents
from fdjax.part.blocks import Band
from fdjax.pattern.width import PlacedWidth
from fdjax.programs import program
from fdjax.road.porosity import Margins

Floats = np.ndarray

_BATCH = 32
"""Lines are traced in batches of so many, so that another count is no other program."""

_RAMP = 0.3
"""Share of a block over which lines come back that keep off a wall of the block before."""


@program
def edges(grid: AbstractGridMap, width: PlacedWidth, block: Any, points: int) -> Margins:
    own, run, ends = _one(grid, block), jnp.linspace(0, 1, points), jnp.array([0.0, 1.0])
    _, across = tangents(own, ends[:, None], run[None])
    _, beside = tangents(own, run[:, None], ends[None])
    return Margins.of(across, beside, width.ends[1] / 2)


def squeezed(band: Band, edge: list[Margins], walls: Floats) -> list[tuple[Floats, Floats]]:
    """How far a band's lines keep from the walls at its two sides, for each of its stretches.

    As shares of the band's breadth, at points along the lines. Where a wall ends the lines come
    back slowly, so that they have no step there.
    """
    found = []
    for stretch in band.stretches:
        own = edge[stretch.block]
        sides = [(own.left, 3), (own.right, 1)]
        if stretch.axis == 1:
            sides = [(own.bottom, 0), (own.top, 2)]
        pair = [margin * walls[stretch.block, k] for margin, k in sides]
        pair = pair[::-1] if stretch.turned else pair
        found.append([margin[::-1] if stretch.back else margin for margin in pair])
    count = len(found)
    ramp = np.maximum(1 - np.linspace(0, 1, len(found[0][0])) / _RAMP, 0.0)
    ramp = ramp**2 * (3 - 2 * ramp)
    smooth = [[margin.copy() for margin in pair] for pair in found]
    for k in range(count if band.closed else count - 1):
        after = (k + 1) % count
        for side in (0, 1):
            end, begin = found[k][side][-1], found[after][side][0]
            # Both come to the larger of the two at the join.
            joint = max(end, begin)
            smooth[k][side] += (joint - end) * ramp[::-1]
            smooth[after][side] += (joint - begin) * ramp
    return [(first, last) for first, last in smooth]


def traced(
    grid: AbstractGridMap,
    width: PlacedWidth,
    band: Band,
    comb: int,
    margins: list[tuple[Floats, Floats]],
) -> tuple[Floats, Floats]:
    """Points of a band's lines and their widths; higher levels lie on the right."""
    more, points = -comb % _BATCH, len(margins[0][0])
    places = np.append((np.arange(comb) + 0.5) / comb, np.full(more, 0.5))[:, None]
    run = np.linspace(0, 1, points)[None]
    xy, widths = [], []
    for number, (stretch, (first, last)) in enumerate(zip(band.stretches, margins, strict=True)):
        own = places + first * (1 - places) - last * places
        own = 1 - own if stretch.turned else own
        along = np.broadcast_to(1 - run if stretch.back else run, own.shape)
        pair = (own, along) if stretch.axis == 0 else (along, own)
        pieces = [
            _batch(grid, width, np.asarray(stretch.block), *(each[k : k + _BATCH] for each in pair))
            for k in range(0, len(own), _BATCH)
        ]
        course, wide = map(np.concatenate, zip(*pieces, strict=True))
        xy.append(course[:comb, 1 if number else 0 :])
        widths.append(wide[:comb])
    course, wide = np.concatenate(xy, 1), np.concatenate(widths, 1)
    if band.closed:
        course[:, -1] = course[:, 0]
    start = band.stretches[0]
    if (start.axis == 0) == (start.turned == start.back):
        return course, wide
    return course[:, ::-1], wide[:, ::-1]


def _one(grid: AbstractGridMap, block: Any) -> Any:
    """The map of one block."""
    arrays, rest = eqx.partition(grid, eqx.is_array)
    return eqx.combine(jax.tree.map(lambda part: part[block], arrays), rest)


@program
def _batch(
    grid: AbstractGridMap, width: PlacedWidth, block: Any, xi: Any, eta: Any
) -> tuple[Array, Array]:
    xy = _one(grid, block)(xi, eta)
    return xy, width((xy[:, 1:] + xy[:, :-1]) / 2)
