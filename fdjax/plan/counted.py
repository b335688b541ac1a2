"""What of a build counts as solid, and where: the volume laid, or what is covered from above."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.plan.covered import Covered
from fdjax.plan.segments import Segments
from fdjax.plan.toolpath import Build, Layer
from fdjax.road.bead import SECTIONS

Floats = NDArray[np.float64]


class Counted(NamedTuple):
    """Straight pieces of a layer, and what each counts.

    - `start`, `end`: shape (n, 2), mm; `volume`: shape (n,), mm^3, that is laid on them, or covered
      times the layer's height.
    """

    start: Floats
    end: Floats
    volume: Floats

    @classmethod
    def of(cls, layer: Layer, count: str) -> "Counted":
        """Raises `InputError` for a `count` that is none of `SECTIONS`."""
        if count not in SECTIONS:
            raise InputError(f'count: "{count}" is not one of {", ".join(SECTIONS)}')
        segments = Segments.of(layer.roads)
        if count == "volume":
            volume = segments.areas(layer.height) * segments.length
            return cls(segments.start, segments.end, volume)
        covered = Covered.by(segments)
        return cls(covered.start, covered.end, covered.area * layer.height)


def total(build: Build, count: str) -> float:
    """What a build counts in all, mm^3.

    >>> from fdjax.plan.toolpath import Road
    >>> cross = [Road([(0, 5), (10, 5)], 0.4), Road([(5, 0), (5, 10)], 0.4)]
    >>> round(total(Build((Layer(0.2, 0.2, cross),)), "coverage"), 2)
    1.62
    """
    return sum(float(Counted.of(layer, count).volume.sum()) for layer in build.layers)


def deposits(build: Build, step: float, count: str) -> tuple[Floats, Floats]:
    """`Build.deposits` of what counts: middles (n, 3), mm, and volumes (n,), mm^3, of pieces no
    longer than `step`, mm.
    """
    if count == "volume":
        return build.deposits(step)
    places, volumes = [np.zeros((0, 3))], [np.zeros(0)]
    for layer in build.layers:
        start, end, volume = Counted.of(layer, count)
        many = np.maximum(np.ceil(np.hypot(*(end - start).T) / step), 1).astype(int)
        owner = np.repeat(np.arange(len(many)), many)
        number = np.arange(len(owner)) - np.repeat(np.cumsum(many) - many, many)
        share = ((number + 0.5) / many[owner])[:, None]
        xy = (1 - share) * start[owner] + share * end[owner]
        places.append(np.column_stack([xy, np.full(len(xy), layer.z - layer.height / 2)]))
        volumes.append((volume / many)[owner])
    return np.concatenate(places), np.concatenate(volumes)
