"""What shapes the lines of a map."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Controls(eqx.Module):
    """The real numbers that shape the lines; None where the pattern's own value stays.

    - `spacing`: log density of lines along bottom, right, top and left, cubic B-splines, shape
      (4, K).
    - `stretching`: the free number of the stretching along x and y, see `STRETCHINGS`, shape (2,).
    - `phi`, `psi`: control functions of the unit square, cubic B-splines, shape (K, L); they add
      to the pattern's constants.
    - `width`: road width as the free number of `width.within`, shape () or, as a spline, (K, L).
    - `crowding`: log density of the xi lines along xi, shape (R, K), at R places along eta, and of
      the eta lines along eta, (S, L), at S places along xi: cubic B-splines both ways.

    On a closed map splines over eta are periodic.
    """

    spacing: Float[Array, "4 K"] | None = None
    stretching: Float[Array, " 2"] | None = None
    phi: Float[Array, "K L"] | None = None
    psi: Float[Array, "K L"] | None = None
    width: Float[Array, "..."] | None = None
    crowding: tuple[Float[Array, "R K"], Float[Array, "S L"]] | None = None

    def roughness(self, *, closed: bool) -> Float[Array, " n"]:
        """Second differences of neighbours, on a `closed` map all around; to be kept small."""
        pieces = [jnp.zeros(0)]
        for values in jax.tree.leaves(self):
            axes = [values.ndim - 1] if values is self.spacing else range(values.ndim)
            around = 1
            if self.crowding is not None and values is self.crowding[0]:
                around = 0
            for axis in axes:
                count = values.shape[axis]
                if count > 2:
                    # On a ring the first is the neighbour of the last.
                    more = 2 if closed and axis == around else 0
                    whole = jnp.take(values, np.arange(count + more) % count, axis)
                    pieces.append(jnp.diff(whole, 2, axis=axis).ravel() / np.sqrt(values.size))
        return jnp.concatenate(pieces)
