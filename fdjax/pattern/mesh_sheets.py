"""Sheets: what of which mesh some layers hold alike."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from fdjax.part.part import Part, Slab
from fdjax.pattern.mesh_sizes import Stack


class Sheet(NamedTuple):
    """What some layers hold alike: the number of its mesh, what of it is laid, and the layers."""

    mesh: int
    kind: str
    slabs: tuple[Slab, ...]
    z: float


def sheets_of(part: Part, kinds: tuple[str, ...], phases: int, flat: bool) -> Iterator[Sheet]:
    """Alike layers take the sheets in turn; else each layer has one, with a mesh of its own."""
    if not flat:
        for k, (slab, middle) in enumerate(zip(part.slabs, part.middles, strict=True)):
            yield Sheet(k, kinds[k % len(kinds)], (slab,), float(middle))
        return
    count = min(phases * len(kinds), len(part.slabs))
    for k in range(count):
        kind = kinds[k % len(kinds)]
        yield Sheet(k // len(kinds), kind, part.slabs[k::count], part.height / 2)


def stacks_of(sheets: list[Sheet]) -> list[Stack]:
    """The layers that hold each mesh."""
    found = []
    for mesh in range(1 + max(sheet.mesh for sheet in sheets)):
        own = [sheet for sheet in sheets if sheet.mesh == mesh]
        slabs = tuple(slab for sheet in own for slab in sheet.slabs)
        kinds = tuple(sheet.kind for sheet in own for _ in sheet.slabs)
        found.append(Stack(slabs, kinds, own[0].z))
    return found


def offsets(counts: list[int]) -> list[int]:
    """Where pieces of these lengths begin, laid end to end, and the end of the last."""
    return [0, *np.cumsum(counts).tolist()]


class Pieces(NamedTuple):
    """Parts of edges, short beside a window: their edge, and where they start and end on it.

    Shape (q,) each, the places as shares of the edge.
    """

    edge: Any
    start: Any
    end: Any


def corners_of(xy: np.ndarray, edges: np.ndarray) -> float:
    """Road widths by which the two roads beside an edge are shorter than it, together, in the mean.

    In an angle t between two edges the road half a width inside loses cot(t / 2) widths.
    """
    ends = np.concatenate([edges, edges[:, ::-1]])
    along = xy[ends[:, 1]] - xy[ends[:, 0]]
    angle = np.arctan2(along[:, 1], along[:, 0])
    order = np.lexsort((angle, ends[:, 0]))
    node, angle = ends[order, 0], angle[order]
    degree = np.bincount(node, minlength=len(xy))
    first = np.cumsum(degree) - degree
    following = np.arange(len(node)) + 1
    last = following == (first + degree)[node]
    following[last] = first[node[last]]
    turn = (angle[following] - angle) % (2 * np.pi)
    # Nodes at the rim of a mesh have faces on one side only.
    whole = (degree[node] > 2) & (turn > 0) & (turn < np.pi)
    return float((1 / np.tan(turn[whole] / 2)).sum() / whole.sum() * 2)


def pieces_of(length: np.ndarray, longest: float) -> Pieces:
    """Equal parts of edges of these lengths, none longer than this, mm."""
    count = np.maximum(np.ceil(length / longest), 1).astype(int)
    edge = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    return Pieces(edge, number / count[edge], (number + 1) / count[edge])
