"""How many lines each band of blocks begins with, and where bands are cut for the target's sake.

All outside the gradient loop. As many lines leave a block of a band as enter it, and spacings only
move them about within it: what a block holds as a whole follows from the numbers of lines alone.
Where blocks of one band ask for too different numbers it is cut between them, at a side from which
its lines turn back.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import combinations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.optimize import lsq_linear
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fdjax.errors import InputError
from fdjax.grid.base import AbstractGridMap, Tangents, norm, tangents
from fdjax.limits import Limits
from fdjax.part.blocks import Blocks
from fdjax.part.ring import at
from fdjax.pattern.reach import check_reachable
from fdjax.programs import program
from fdjax.road.bead import section_area
from fdjax.road.porosity import midpoints
from fdjax.road.stacking import FAMILIES, Stacking
from fdjax.target.target import Target

Floats = np.ndarray
Side = tuple[int, int]

SQUARE = 0.05
"""How much the numbers of lines care for cells as wide as long, beside what is asked."""

ROOM = 0.9
"""Share of the lines that a band has room for, of which it begins with no more."""

AMISS = 5e-3
"""Error of porosity, as blocks are in the mean, for which a band is not cut."""

WORTH = 0.8
"""A cut leaves no more than this share of that error."""

_STRIPS, _FINE = 4, 3
"""Strips of a block along either axis, and places across each: lines of one family bring to none
more than is asked there."""


@dataclass(frozen=True, eq=False)
class Demand:
    """What blocks ask of their lines; arrays with an axis of blocks, then one of axes.

    - `blocks`; `area`: of each, mm^2, (m,); `solid`: length of line on the mean layer that brings
      porosity down by 1 in each, mm, (m,).
    - `asked`: length of line on the mean layer, mm, (m,); `length`: that one line a layer of
      constant xi, and of eta, brings of it, (m, 2).
    - `turn`: length that the path takes along each side where lines end there, mm, (m, 4).
    - `least`, `most`: lines a layer, (m, 2).
    """

    blocks: Blocks
    area: Floats
    solid: Floats
    asked: Floats
    length: Floats
    turn: Floats
    least: Floats
    most: Floats

    @classmethod
    def of(
        cls,
        blocks: Blocks,
        grid: AbstractGridMap,
        target: Target,
        *,
        width: float,
        height: float,
        stacking: Stacking,
        limits: Limits,
    ) -> "Demand":
        """`grid`: the blocks' maps, with a leading axis.

        Raises `InputError` for a block whose lines cross, and for a target beyond what spacing
        and span allow.
        """
        xy, along = _lattice(grid)
        xy, jacobian = np.asarray(xy), np.asarray(along.jacobian)
        if not (jacobian > 0).all():
            worst = np.unravel_index(jacobian.argmin(), jacobian.shape)
            raise InputError(
                f"blocks: lines between the sides of a block would cross at {at(xy[worst])}; cut "
                'it in two with pattern.blocks, or use pattern kind "isolines"'
            )
        solid = 1 - np.asarray(target(xy[..., 0], xy[..., 1]))
        family = np.stack([blocks.family, 1 - blocks.family], 1)
        shares = np.array([stacking.layer_share(each) for each in FAMILIES])[family]
        places = np.concatenate([xy.reshape(-1, 2), np.zeros((solid.size, 1))], 1)
        lengths = float(shares[0].sum()), float(shares[0].sum())
        check_reachable(
            solid.ravel(), places, height=height, lengths=lengths, widths=(width, width),
            limits=limits,
        )  # fmt: skip
        a_solid = height / float(section_area(width, height))
        asked = solid * a_solid * jacobian
        least_spacing = limits.least_spacing or width
        length, least, most = (np.zeros(family.shape) for _ in range(3))
        for k, tangent in enumerate((along.eta, along.xi)):
            own = np.asarray(norm(tangent))
            across = jacobian / own
            length[:, k] = shares[:, k] * own.mean((1, 2))
            # Strips across the lines, from one to the other end of them.
            strip = asked.mean(1 + k) / (shares[:, k, None] * own.mean(1 + k))
            strip = strip.reshape(-1, _STRIPS, _FINE).mean(2)
            room = across.mean(1 + k) / least_spacing
            most[:, k] = np.minimum(strip.min(1), ROOM * room.min(1))
            least[:, k] = across.mean(1 + k).max(1) / limits.longest_span
        least = np.maximum(least, 1 / stacking.phases)
        # Half of each side, on the layers of the lines that end there.
        turn = [
            [shares[b, k % 2] * blocks.side(b, k).length / 2 for k in range(4)]
            for b in range(len(family))
        ]
        area = jacobian.mean((1, 2))
        return cls(
            blocks, area, area * a_solid, asked.mean((1, 2)), length, np.array(turn),
            least, np.maximum(most, 1.02 * least),
        )  # fmt: skip

    def counts(self, cuts: Iterable[Side]) -> tuple[Floats, float]:
        """Lines a layer of each block's two bands, (m, 2), with bands cut at some sides.

        And the error of porosity that they leave, as the blocks are in the mean.
        """
        blocks, count = self.blocks, len(self.area)
        ends = {*blocks.broken, *cuts}
        pairs = []
        asked = self.asked.copy()
        for key, users in blocks.users.items():
            if len(users) == 2 and key not in ends:
                # Of constant xi lines cross bottom and top: sides 0 and 2.
                pairs.append([2 * b + k % 2 for b, k in users])
            else:
                for user in users:
                    asked[user[0]] -= self.turn[user]
        i, j = np.array(pairs, int).reshape(-1, 2).T
        links = coo_array((np.ones(len(i)), (i, j)), (2 * count, 2 * count))
        bands, band = connected_components(links, directed=False)
        low, high = np.zeros(bands), np.full(bands, np.inf)
        np.maximum.at(low, band, self.least.ravel())
        np.minimum.at(high, band, self.most.ravel())
        weight = np.sqrt(self.area / self.area.sum()) / self.solid
        met, alike = np.zeros((2, count, bands))
        for block, k in np.ndindex(count, 2):
            own = weight[block] * self.length[block, k]
            met[block, band[2 * block + k]] += own
            alike[block, band[2 * block + k]] += SQUARE * (1 - 2 * k) * own
        goal = weight * asked
        found = lsq_linear(
            np.concatenate([met, alike]), np.append(goal, np.zeros(count)),
            bounds=(low, np.maximum(high, 1.02 * low)),
        ).x  # fmt: skip
        return found[band].reshape(-1, 2), float(np.sqrt(((met @ found - goal) ** 2).sum()))

    def cut(self) -> Blocks:
        """The blocks with bands cut where that brings what is asked much nearer."""
        blocks = self.blocks
        free = [key for key, users in blocks.users.items() if len(users) == 2]
        free = [key for key in free if key not in blocks.broken]
        cuts: list[Side] = []
        _, error = self.counts(cuts)
        while error > AMISS:
            best, chosen = WORTH * error, None
            # A closed band that is cut once is still one.
            for size in (1, 2):
                for more in combinations(free, size):
                    _, left = self.counts([*cuts, *more])
                    if left < best * (1 - 1e-6):
                        best, chosen = left, more
                if chosen is not None:
                    break
            if chosen is None:
                break
            cuts += chosen
            free = [key for key in free if key not in chosen]
            error = best
        return replace(blocks, cuts=frozenset(cuts))


@program
def _lattice(grid: AbstractGridMap) -> tuple[Array, Tangents]:
    places = jnp.asarray(midpoints(_STRIPS * _FINE))
    return eqx.filter_vmap(lambda own: tangents(own, places[:, None], places[None]))(grid)
