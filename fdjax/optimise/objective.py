"""What a design tries to make small, as residuals: porosity error, roughness, broken limits."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from fdjax.limits import Limits
from fdjax.pattern.base import AbstractPattern
from fdjax.road.deposit import Deposit
from fdjax.road.window import SoftWindows

jax.tree_util.register_dataclass(
    SoftWindows, ["size", "start", "room", "target", "full", "total"], ["steps"]
)

MARGIN = 0.01
"""Share of a limit that design keeps away from it."""

LEAST_WINDOW = 0.45
"""Share of a window that must be inside the part; measuring leaves out less than half."""

WHOLE = 4.0
"""Weight of the error of the part's mean beside the root mean square of its windows' errors."""

Term = Callable[[AbstractPattern, Any], Float[Array, "..."]]
"""Residuals of one's own, in units of porosity, of a pattern and what controls amount to in it."""


class Residuals(NamedTuple):
    """Residuals in units of porosity; the objective is half the sum of all squares.

    `error` squares and sums to the mean square error of porosity, weighted by volume; `mean` is
    the error of the whole part, none where the count of lines sees to it; `terms` are what a user
    adds.
    """

    error: Float[Array, " e"]
    roughness: Float[Array, " r"]
    penalties: dict[str, Array]
    mean: tuple[Array, ...] = ()
    terms: tuple[Array, ...] = ()


class Objective(eqx.Module):
    """The design objective of a pattern over controls.

    - `windows`: soft windows with their targets, or None to compare the pattern's own cells with
      `target`, a function (x, y, z) -> porosity of JAX arrays, which is needed only then.
    - `limits`: of the machine; `smoothness`: weight of the roughness of the controls;
      `barrier`: weight of broken limits, per share of violation.
    - `terms`: residuals of one's own, each a function of the pattern and what it realised.
    """

    pattern: AbstractPattern
    windows: Any
    target: Callable[..., Array] | None = eqx.field(static=True)
    limits: Limits = eqx.field(static=True)
    smoothness: float = 1e-3
    barrier: float = 3.0
    terms: tuple[Term, ...] = eqx.field(static=True, default=())

    def __call__(self, controls: Any) -> tuple[Residuals, Bool[Array, ""]]:
        """Residuals at these controls, and whether the pattern could be made there."""
        realised = self.pattern.realise(controls)
        return self.residuals(realised, controls), realised.made

    def residuals(self, realised: Any, controls: Any) -> Residuals:
        """Residuals of what these controls amount to."""
        if self.windows is None:
            error, mean = self._cell_error(realised), ()
        else:
            error, mean = self._window_errors(realised)
        broken = {
            name: self.barrier * jax.nn.relu(excess + MARGIN) / jnp.sqrt(excess.size)
            for name, excess in self.pattern.penalties(realised, self.limits).items()
        }
        roughness = self.smoothness * self.pattern.roughness(controls)
        terms = tuple(jnp.ravel(term(self.pattern, realised)) for term in self.terms)
        return Residuals(error, roughness, broken, mean, terms)

    def _window_errors(self, realised: Any) -> tuple[Float[Array, " e"], tuple[Array, ...]]:
        """Of the windows, and of the part as a whole."""
        windows: SoftWindows = self.windows
        deposit = self.pattern.deposit(realised)
        got = self._sums(windows, deposit)
        used = windows.room > LEAST_WINDOW * windows.full
        room = jnp.where(used, windows.room, 1.0)
        share = jnp.where(used, windows.room, 0.0)
        error = jnp.sqrt(share / share.sum()) * (got / room - windows.target)
        if self.pattern.mean_by_count:
            return error.ravel(), ()
        whole = (deposit.volume.sum() - windows.total) * windows.times / windows.room.sum()
        return error.ravel(), (WHOLE * whole,)

    @staticmethod
    def _sums(windows: SoftWindows, deposit: Deposit) -> Array:
        # A branch is a wall to XLA's fusion, which would else work out each point again for each
        # of the cells it is shared among.
        return jax.lax.cond(
            deposit.volume.ravel()[0] < jnp.inf,
            windows.sums,
            lambda _: jnp.zeros_like(windows.room),
            deposit,
        )

    def _cell_error(self, realised: Any) -> Float[Array, " e"]:
        assert self.target is not None
        xyz, local, volume = self.pattern.cells(realised)
        weight = jnp.sqrt(jnp.abs(volume) / jnp.abs(volume).sum())
        return (weight * (local - self.target(*xyz.T))).ravel()
