"""What a design tries to make small, as residuals: porosity error, roughness, broken limits."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from fdjax.limits import Limits
from fdjax.pattern.base import AbstractPattern, Penalties
from fdjax.road.window import SoftWindows

jax.tree_util.register_dataclass(SoftWindows, ["size", "start", "area", "target", "total"], [])

MARGIN = 0.01
"""Share of a limit that design keeps away from it."""


LEAST_WINDOW = 0.45
"""Share of a window that must be inside the outline; measuring leaves out less than half."""


class Residuals(NamedTuple):
    """Residuals in units of porosity; the objective is half the sum of all squares.

    `error` squares and sums to the area-weighted mean square error of porosity.
    """

    error: Float[Array, " e"]
    roughness: Float[Array, " r"]
    penalties: Penalties


class Objective(eqx.Module):
    """The design objective of a pattern over controls.

    - `windows`: soft windows with their targets, or None to compare the pattern's own cells with
      `target`, a function (x, y) -> porosity of JAX arrays.
    - `limits`: of the machine; `smoothness`: weight of the roughness of the controls;
      `barrier`: weight of broken limits, per share of violation.
    """

    pattern: AbstractPattern
    windows: Any
    target: Callable[[Array, Array], Array] = eqx.field(static=True)
    layer_height: float
    limits: Limits = eqx.field(static=True)
    smoothness: float = 1e-3
    barrier: float = 3.0

    def __call__(self, controls: Any) -> tuple[Residuals, Bool[Array, ""]]:
        """Residuals at these controls, and whether the pattern could be made there."""
        realised = self.pattern.realise(controls)
        return self.residuals(realised, controls), realised.made

    def residuals(self, realised: Any, controls: Any) -> Residuals:
        """Residuals of what these controls amount to."""
        error = self._cell_error(realised) if self.windows is None else self._error(realised)
        penalties = self.pattern.penalties(realised, self.limits)
        broken = Penalties(
            *(
                self.barrier * jax.nn.relu(excess + MARGIN) / jnp.sqrt(excess.size)
                for excess in penalties
            )
        )
        roughness = self.smoothness * self.pattern.roughness(controls)
        return Residuals(error, roughness, broken)

    def _error(self, realised: Any) -> Float[Array, " e"]:
        windows, (xy, volume) = self.windows, self.pattern.deposit(realised)
        # XLA finishes what a condition takes, and would else work out each point again for each
        # of the four cells it is shared among.
        sums = jax.lax.cond(
            volume[0] < jnp.inf, windows.sums, lambda *_: jnp.zeros_like(windows.area), xy, volume
        )
        got = sums / self.layer_height
        used = windows.area > LEAST_WINDOW * windows.size**2
        area = jnp.where(used, windows.area, 1.0)
        share = jnp.where(used, windows.area, 0.0)
        difference = got / area - windows.target
        return (jnp.sqrt(share / share.sum()) * difference).ravel()

    def _cell_error(self, realised: Any) -> Float[Array, " e"]:
        xy, local, area = self.pattern.cells(realised)
        weight = jnp.sqrt(jnp.abs(area) / jnp.abs(area).sum())
        return (weight * (local - self.target(xy[..., 0], xy[..., 1]))).ravel()
