"""What laying strokes gives."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fdjax.plan.order import order_roads
from fdjax.plan.toolpath import Road, lengths_of

SHORTEST_ROAD = 3.0
"""A road shorter than so many of its widths is not worth laying alone."""


@dataclass(frozen=True, eq=False)
class Laid:
    """The roads in the order in which they are laid, and as roads what was left out for room."""

    roads: tuple[Road, ...] = ()
    left_out: tuple[Road, ...] = ()

    @classmethod
    def of(
        cls,
        roads: Sequence[Road],
        shortest: ArrayLike,
        *,
        start: ArrayLike | None,
        left_out: Iterable[Road] = (),
    ) -> "Laid":
        """Those that are at least as long as `shortest`, mm, one length or one each, in order.

        They start near `start`; the others join what was left out.
        """
        lengths = lengths_of(roads)
        long = lengths >= np.broadcast_to(np.asarray(shortest, float), len(roads))
        short = [road for road, keep in zip(roads, long, strict=True) if not keep]
        roads = [road for road, keep in zip(roads, long, strict=True) if keep]
        return cls(tuple(order_roads(roads, start=start)), (*left_out, *short))


def shortest_road(width: NDArray[np.float64], least_road: float) -> float:
    """Length, mm, that a road of these widths has at least, on a machine with this least road."""
    return max(SHORTEST_ROAD * float(width.mean()), least_road)
