"""In which order the lines of neighbouring bands come up on the layers.

The lines of a band are laid in turn, a phase each. Where two bands lie side by side along a side
that their blocks share, lines of both that are laid together are to be as far apart there as
within either: the phases go on from band to band, as far as all sides at once allow.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fdjax.part.blocks import Blocks

Floats = np.ndarray


class Beside(NamedTuple):
    """Two bands that lie side by side: their numbers, whether with their last lines, and how far
    they do, mm.
    """

    bands: tuple[int, int]
    last: tuple[bool, bool]
    length: float


class Turn(NamedTuple):
    """Line m of a band is laid in phase `begin + step * m`, up to whole turns; `step` is 1, -1."""

    begin: int
    step: int

    def phases(self, count: int, phases: int) -> Floats:
        """Of each line, (count,)."""
        return (self.begin + self.step * np.arange(count)) % phases


def besides(blocks: Blocks) -> tuple[Beside, ...]:
    """The pairs of bands of one family that lie side by side."""
    own = {(s.block, s.axis): (n, s) for n, band in enumerate(blocks.bands) for s in band.stretches}
    found = []
    for key, users in blocks.users.items():
        if len(users) < 2:
            continue
        # Along bottom and top run lines of eta.
        sides = [(*own[block, 1 - side % 2], side) for block, side in users]
        (one, _, _), (other, _, _) = sides
        if one == other or blocks.bands[one].family != blocks.bands[other].family:
            continue
        last = [(side in (1, 2)) != stretch.turned for _, stretch, side in sides]
        found.append(Beside((one, other), (last[0], last[1]), blocks.sides[key].length))
    return tuple(found)


def turns(counts: Sequence[int], beside: Sequence[Beside], phases: int) -> list[Turn]:
    """How each band takes its turn; `counts`: of their lines in all phases together."""
    chosen = [Turn(0, 1) for _ in counts]
    ways = [Turn(begin, step) for step in (1, -1) for begin in range(phases)]
    own: list[list[Beside]] = [[] for _ in counts]
    for pair in beside:
        for band in pair.bands:
            own[band].append(pair)

    def off(band: int, way: Turn, among: Sequence[int]) -> float:
        trial = {**{k: chosen[k] for k in among}, band: way}
        return sum(
            _uneven(pair, trial, counts, phases)
            for pair in own[band]
            if all(k in trial for k in pair.bands)
        )

    # One after the other, beside those that have theirs; then each anew beside all.
    order: list[int] = []
    left = set(range(len(counts)))
    while left:
        near = [p for p in beside if (p.bands[0] in left) != (p.bands[1] in left)]
        # The first of a group keeps its turn.
        longest = max(near, key=lambda pair: pair.length, default=None)
        band = min(left) if longest is None else next(k for k in longest.bands if k in left)
        chosen[band] = min(ways, key=lambda way: off(band, way, order))
        order.append(band)
        left.remove(band)
    for _ in range(_SWEEPS):
        before = list(chosen)
        for band in order:
            now = off(band, chosen[band], order)
            best = min(ways, key=lambda way: off(band, way, order))
            if off(band, best, order) < now - 1e-9:
                chosen[band] = best
        if chosen == before:
            break
    return chosen


_SWEEPS = 10


def _uneven(pair: Beside, turns: dict[int, Turn], counts: Sequence[int], phases: int) -> float:
    """How much the gaps between lines of one phase across a side differ from those within."""
    reach = []
    for band, last in zip(pair.bands, pair.last, strict=True):
        line = np.arange(phases)
        laid = turns[band].begin + turns[band].step * (counts[band] - 1 - line if last else line)
        # Of each phase its first line from the side.
        first = np.empty(phases, int)
        first[laid % phases] = line
        reach.append(first)
    gap = (reach[0] + reach[1] + 1) / phases
    return pair.length * float(((1 / gap - 1) ** 2).mean())
