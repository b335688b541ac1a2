"""What a pattern is: roads, and a porosity that can be differentiated, from a set of controls.

Adding a pattern is one new file and one line in the table `PATTERNS` of `fdjax.pattern`.
"""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from fdjax.limits import Limits
from fdjax.road.porosity import Deposit


class Penalties(NamedTuple):
    """By how much a pattern leaves what is allowed, as shares; zero or less is within.

    - `fold`: J below its floor; `skew`: lines that meet at too sharp an angle; `spacing`: roads of
      one family too close; `span`: unsupported spans too long; `length`: lines too short.
    """

    fold: Float[Array, " n"]
    skew: Float[Array, " n"]
    spacing: Float[Array, " n"]
    span: Float[Array, " n"]
    length: Float[Array, " n"]


class Lines(NamedTuple):
    """One family's lines on one layer, from wall to wall, as the plan takes them.

    - `family`, `parity`: as in `road.stacking.Scan`.
    - `xy`: shape (lines, points, 2), mm; `width`: shape (lines, points - 1), mm.
    """

    family: str
    parity: int
    xy: NDArray[np.float64]
    width: NDArray[np.float64]


class AbstractPattern(eqx.Module):
    """A way to fill a layer domain. `controls` are the pattern's own pytree of real arrays.

    `realise` turns controls into what the questions below are asked of, a pytree of the pattern's
    own with a boolean `made`: whether the pattern could be made there.
    """

    @abstractmethod
    def controls(self) -> Any:
        """The controls to start from."""

    @abstractmethod
    def realise(self, controls: Any) -> Any: ...

    @abstractmethod
    def deposit(self, realised: Any) -> Deposit:
        """Where the material goes, a layer's mean."""

    @abstractmethod
    def cells(self, realised: Any) -> tuple[Array, Array, Array]:
        """Points xy (..., 2), local porosity (...) and area (...) of the pattern's own cells."""

    @abstractmethod
    def penalties(self, realised: Any, limits: Limits) -> Penalties: ...

    @abstractmethod
    def roughness(self, controls: Any) -> Float[Array, " n"]:
        """Differences of neighbouring controls, to be kept small."""

    @abstractmethod
    def lines(self, controls: Any) -> list[list[Lines]]:
        """The lines of each layer, from the bed upwards."""
