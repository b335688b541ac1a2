"""Sheets: what of which mesh some layers hold alike."""

from collections.abc import Iterator
from typing import NamedTuple

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
