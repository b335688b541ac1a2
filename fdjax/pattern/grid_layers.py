"""Lines of a map as they are laid, layer by layer."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fdjax.grid.base import AbstractGridMap, norm, tangents
from fdjax.pattern.embedded_lines import with_fine
from fdjax.pattern.grid_controls import Controls
from fdjax.pattern.grid_tracing import along, margins, spiral, traced
from fdjax.pattern.slit_lines import across, around, eta_places, on_base, xi_places
from fdjax.pattern.width import AbstractWidth
from fdjax.programs import program
from fdjax.road import porosity
from fdjax.road.porosity import Margins
from fdjax.road.stacking import FAMILIES, Scan
from fdjax.road.stroke import Lines

if TYPE_CHECKING:
    from fdjax.pattern.grid_lines import GridLines

Floats = np.ndarray
Shape = tuple[AbstractGridMap, AbstractWidth]

PRESS = 0.25
"""The first and the last lines run along walls, and are pressed back on them from this share of a
road's width beyond."""


def layers(pattern: "GridLines", controls: Controls, points: int) -> Iterator[Sequence[Lines]]:
    """What is to be laid on each layer, of lines traced at so many points."""
    counts = int(pattern.comb[0]), int(pattern.comb[1])
    xi, eta = (Scan(family).places(count) for family, count in zip(FAMILIES, counts, strict=True))
    xi = xi[:, None]
    shape = shape_of(pattern, controls)
    tail, phases = pattern.tail, pattern.stacking.phases
    begins = eta
    if tail is not None:
        run, eta = (
            around(_on_base(shape[0], each), tail) for each in (np.linspace(0, 1, points), eta)
        )
        xi, eta = xi_places(run, counts[0], phases), eta_places(eta, counts[1], phases)
        begins = _on_base(shape[0], eta)
    edge = margins(*shape, points, closed=pattern.closed, tail=tail)
    lines = traced(*shape, edge, (jnp.asarray(xi), jnp.asarray(eta)))
    starts = np.zeros(len(eta), int)
    if pattern.apart is not None:
        spacing = _spacing(pattern, shape[0], jnp.asarray(eta), points)
        starts = _starts(pattern, np.asarray(spacing))
    made: dict[Scan, Lines] = {}
    for layer in pattern.stacking.scans:
        for scan in layer:
            if scan in made:
                continue
            part = slice(scan.phase, None, scan.phases)
            xy, width = (each[part] for each in lines[FAMILIES.index(scan.family)])
            level = np.arange(len(xy))
            if pattern.closed and scan.family == "xi":
                xy, width = _around(pattern, shape, edge, scan, xy, width)
            elif pattern.closed:
                level = _levels(scan, len(level))
            elif tail is not None and scan.family == "eta":
                xy, width, level = across(xy, width, begins[part], tail)
            begin = starts[part] if scan.family == "eta" else np.zeros(len(xy), int)
            own = Lines(
                scan.family,
                scan.parity,
                level[: len(xy)],
                [line[k:] for line, k in zip(xy, begin, strict=False)],
                [line[k:] for line, k in zip(width, begin, strict=False)],
                press=PRESS,
            )
            if pattern.embedded.zones:
                trace = partial(along, *shape, closed=pattern.closed)
                own = with_fine(
                    own, pattern.embedded, scan, counts, edge=edge, trace=trace,
                    joined=pattern.joined, closed=pattern.closed,
                )  # fmt: skip
            made[scan] = own
        yield [made[scan] for scan in layer]


def _on_base(grid: AbstractGridMap, eta: Floats) -> Floats:
    return np.asarray(_begins(grid, jnp.asarray(eta)))


@program
def _begins(grid: AbstractGridMap, eta: Array) -> Array:
    return on_base(grid, eta)


def _levels(scan: Scan, count: int) -> Floats:
    """Levels of the lines across a ring: they begin elsewhere on each layer."""
    return (np.arange(count) - scan.phase * count // scan.phases) % count


def _starts(pattern: "GridLines", spacing: Floats) -> Floats:
    """The point at which each eta line of a disc starts, of all phases."""
    starts, phases = np.zeros(len(spacing), int), pattern.stacking.phases
    for phase in range(phases):
        part = slice(phase, None, phases)
        level = _levels(Scan("eta", phase, phases), len(spacing[part]))
        starts[part] = porosity.first_kept(spacing[part], level)
    return np.minimum(starts, spacing.shape[1] - 2)


def _around(
    pattern: "GridLines", shape: Shape, edge: Margins, scan: Scan, xy: Floats, width: Floats
) -> tuple[Floats, Floats]:
    """A layer's closed lines, or its spiral: they begin elsewhere on each layer."""
    pieces = width.shape[1]
    turn = scan.phase * pieces // scan.phases
    if pattern.spiral:
        count = int(float(pattern.comb[0]) / scan.phases * pieces)
        xy, width = map(np.asarray, spiral(*shape, edge, turn, pieces + 1, count))
        return xy[None], width[None]
    xy = np.roll(xy[:, :-1], -turn, axis=1)
    return np.concatenate([xy, xy[:, :1]], 1), np.roll(width, -turn, axis=1)


@program
def shape_of(pattern: "GridLines", controls: Controls) -> Shape:
    """The map and the road width that controls give."""
    grid, _, width = pattern.shape(controls)
    return grid, width


@program
def _spacing(pattern: "GridLines", grid: AbstractGridMap, eta: Array, points: int) -> Array:
    """Of a layer's eta lines, as shares of `apart`, at the points traced of each."""
    run = jnp.linspace(0, 1, points)
    _, along = tangents(grid, run[:, None], eta[None])
    spacing = along.jacobian / (pattern.lines_per_layer[1] * norm(along.xi))
    return (spacing / pattern.apart).T
