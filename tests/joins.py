"""How sharply lines turn where blocks join."""

import jax
import jax.numpy as jnp
import numpy as np

from fdjax.grid.base import tangents

MIDDLE = jnp.linspace(0.1, 0.9, 33)


def kinks(blocks, grid, t=MIDDLE):
    """The angle by which lines that run on across shared sides turn there, degrees.

    `grid`: the blocks' maps, with a leading axis; `t`: places along the sides. (sides, len(t)).
    """
    found = []
    for key, users in blocks.users.items():
        if len(users) < 2 or key in blocks.broken:
            continue
        ways = []
        for sign, (block, k) in zip((1, -1), users, strict=True):
            own = jax.tree.map(lambda part, block=block: part[block], grid)
            low_first = int(blocks.blocks[block][((0, 1, 3, 0)[k])]) == key[0]
            run, still = (t if low_first else 1 - t), jnp.full_like(t, k in (1, 2))
            xi, eta = (run, still) if k % 2 == 0 else (still, run)
            _, along = tangents(own, xi, eta)
            across = along.eta if k % 2 == 0 else along.xi
            ways.append(np.asarray(across) * (1 if k in (1, 2) else -1) * sign)
        (a, b), (c, d) = ways[0].T, ways[1].T
        found.append(np.degrees(np.abs(np.arctan2(a * d - b * c, a * c + b * d))))
    return np.array(found)
