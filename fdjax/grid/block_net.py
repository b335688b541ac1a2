"""Lattices of several blocks as one net: which nodes they share, and which lie around each."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.part.blocks import ENDS, Blocks

Floats = NDArray[np.float64]
Whole = NDArray[np.intp]
Side = tuple[int, int]


class Odd(NamedTuple):
    """A corner of three blocks, or of five and more.

    - `node`; `near`: the nearest on each side that meets there; `weights` of these, 1 together.
    """

    node: int
    near: Whole
    weights: Floats

    def off(self, r: Floats) -> Floats:
        """What it lies off their mean, (2,), of nodes r, (n, 2)."""
        return self.weights @ r[self.near] - r[self.node]


@dataclass(frozen=True, eq=False)
class Net:
    """The nodes of all blocks, each once; those of walls stay.

    - `index`: node numbers of each block's lattice, (m, n, n).
    - `around`: of each node that four cells meet at, the three by three around it, (N, 3, 3).
    - `ratio`: the step after it over the step before it, along both axes of these, (N, 2).
    - `odd`: the others.
    """

    index: Whole
    around: Whole
    ratio: Floats
    odd: tuple[Odd, ...]

    @classmethod
    def of(cls, blocks: Blocks, n: int) -> "Net":
        """`n`: nodes along each side of each block."""
        index = _numbered(blocks, n)
        inside = np.stack([
            index[:, 1 + di : n - 1 + di, 1 + dj : n - 1 + dj]
            for di in (-1, 0, 1) for dj in (-1, 0, 1)
        ], -1).reshape(-1, 3, 3)  # fmt: skip
        around, ratio = [inside], [np.ones((len(inside), 2))]
        step = blocks.extents / (n - 1)
        for key, users in blocks.users.items():
            if len(users) == 2:
                side = _strip(blocks, index, key, users[0], 0)
                lines = [_strip(blocks, index, key, user, 1) for user in users]
                across = np.stack([lines[0], side, lines[1]], -1)
                around.append(np.stack([across[:-2], across[1:-1], across[2:]], 1))
                before, after = (step[b, 1 - k % 2] for b, k in users)
                ratio.append(np.broadcast_to([1.0, after / before], (n - 2, 2)))
        odd = []
        for vertex in range(len(blocks.nodes)):
            turn = _turned(blocks, vertex)
            if turn is None:
                continue
            near = [_beside(blocks, index, vertex, key) for key in turn.sides]
            steps = np.array([step[b, k % 2] for b, k in (blocks.users[s][0] for s in turn.sides)])
            if len(near) != 4:
                # There x + iy is a power 4 / k of xi + i eta.
                weights = steps ** (-4 / len(near))
                odd.append(Odd(vertex, np.array(near), weights / weights.sum()))
                continue
            far = [_diagonal(blocks, index, vertex, block) for block in turn.blocks]
            east, north, west, south = near
            cross = [[far[2], west, far[1]], [south, vertex, north], [far[3], east, far[0]]]
            around.append(np.array(cross)[None])
            ratio.append(np.array([[steps[0] / steps[2], steps[1] / steps[3]]]))
        return cls(index, np.concatenate(around), np.concatenate(ratio), tuple(odd))

    def along(self, blocks: Blocks, key: Side) -> Whole:
        """The nodes of a side, from its lower corner onwards, (n,)."""
        return _strip(blocks, self.index, key, blocks.users[key][0], 0)


@dataclass(frozen=True)
class _Turn:
    """The sides that meet at a corner, in turn, and the block after each."""

    sides: list[Side]
    blocks: list[int]


def _turned(blocks: Blocks, vertex: int) -> _Turn | None:
    """None for a corner on a wall."""
    own = {
        block: [key for key in blocks.keys(block) if vertex in key]
        for block in np.flatnonzero((blocks.blocks == vertex).any(1)).tolist()
    }
    if any(len(blocks.users[side]) < 2 for sides in own.values() for side in sides):
        return None
    block = next(iter(own))
    turn = _Turn([own[block][0]], [block])
    while True:
        (side,) = (each for each in own[turn.blocks[-1]] if each != turn.sides[-1])
        if side == turn.sides[0]:
            return turn
        (beyond,) = (b for b, _ in blocks.users[side] if b != turn.blocks[-1])
        turn.sides.append(side)
        turn.blocks.append(beyond)


def _numbered(blocks: Blocks, n: int) -> Whole:
    """Corners first, then the nodes of sides, then those within blocks."""
    count = len(blocks.nodes)
    index = np.empty((len(blocks.blocks), n, n), int)
    index[:, 0, 0], index[:, -1, 0], index[:, -1, -1], index[:, 0, -1] = blocks.blocks.T
    for key, users in blocks.users.items():
        own = np.arange(count, count + n - 2)
        count += n - 2
        for user in users:
            # A view of the lattice, written to.
            _strip(blocks, index, key, user, 0)[1:-1] = own
    for lattice in index:
        lattice[1:-1, 1:-1] = np.arange(count, count + (n - 2) ** 2).reshape(n - 2, n - 2)
        count += (n - 2) ** 2
    return index


def _strip(blocks: Blocks, index: Whole, key: Side, user: tuple[int, int], depth: int) -> Whole:
    """The nodes so many lines off a side of a block, from the side's lower corner onwards."""
    block, k = user
    lattice = index[block]
    line = (
        lattice[:, depth], lattice[-1 - depth], lattice[:, -1 - depth], lattice[depth]
    )[k]  # fmt: skip
    return line if int(blocks.blocks[block][ENDS[k][0]]) == key[0] else line[::-1]


def _beside(blocks: Blocks, index: Whole, vertex: int, key: Side) -> int:
    strip = _strip(blocks, index, key, blocks.users[key][0], 0)
    return int(strip[1] if key[0] == vertex else strip[-2])


def _diagonal(blocks: Blocks, index: Whole, vertex: int, block: int) -> int:
    corner = int(np.flatnonzero(blocks.blocks[block] == vertex)[0])
    return int(index[block][((1, 1), (-2, 1), (-2, -2), (1, -2))[corner]])
