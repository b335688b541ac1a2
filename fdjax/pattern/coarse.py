"""Steps of many points that also move together: how an optimiser gets to long waves at once.

Least squares of densities hardly feel points that all move alike, so an iteration that knows the
points one by one comes by long waves slowly. With lattices of fewer and fewer points added to the
points' own steps, coarse ones weighted by their distance, all waves matter alike (Bramble, Pasciak,
Xu 1990).
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Lattice(NamedTuple):
    """A lattice of hats over points.

    - `place`, `share`: the four lattice nodes around each point and their shares, (n, 4).
    - `whole`: sum of the shares at each lattice node, shape (m,); `step`: distance of these, mm.
    """

    place: Any
    share: Any
    whole: Any
    step: Any

    @classmethod
    def over(cls, xy: Any, count: int) -> "Lattice":
        """With `count` cells along the longer side of the box around points (n, 2), mm."""
        low, high = xy.min(0), xy.max(0)
        step = float((high - low).max()) / count
        at = (xy - low) / step
        cell = np.clip(np.floor(at), 0, count - 1).astype(int)
        x, y = (at - cell).T
        place = np.stack(
            [(cell[:, 0] + i) * (count + 1) + cell[:, 1] + j for i in (0, 1) for j in (0, 1)], 1
        )
        share = np.stack([(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y], 1)
        whole = np.bincount(place.ravel(), share.ravel(), (count + 1) ** 2)
        return cls(place, share, np.maximum(whole, 1e-9), step)

    def moved(self, step: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
        """What the lattice adds to steps of the points: their mean around, times its distance."""
        pulled = (
            jnp.zeros((len(self.whole), 2))
            .at[self.place]
            .add(self.share[..., None] * step[:, None])
        )
        mean = pulled / self.whole[:, None]
        return self.step * (self.share[..., None] * mean[self.place]).sum(1)
