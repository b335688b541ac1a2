"""What a pattern is: strokes, and a deposit that can be differentiated, from a set of controls.

A pattern is one file: the settings that a job may give, with the pattern that they begin, and one
line in the table `PATTERNS` of `fdjax.pattern`.
"""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from fdjax.keys import LENGTH, choice, key, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.road.deposit import Deposit
from fdjax.road.stacking import MODES, Stacking
from fdjax.road.stroke import Stroke
from fdjax.target.target import Target

Penalties = dict[str, Array]
"""By how much a pattern leaves what is allowed, as shares, by kind of limit; zero or less is
within. One value for each place looked at."""


class Panel(NamedTuple):
    """A function of the place on one layer, to be drawn.

    `x`, `y`: of a lattice, mm, arrays of shapes (n,) and (m,) or both (n, m); `values`: (n, m).
    """

    name: str
    x: Any
    y: Any
    values: Any


class AbstractPattern(eqx.Module):
    """A way to fill a part. `controls` are the pattern's own pytree of real arrays.

    `realise` turns controls into what the questions below are asked of, a pytree of the pattern's
    own with a boolean `made`: whether the pattern could be made there.
    """

    @abstractmethod
    def controls(self) -> Any:
        """The controls to start from."""

    @abstractmethod
    def at(self, controls: Any) -> "AbstractPattern":
        """The same pattern, starting from these controls."""

    def mended(self) -> "AbstractPattern":
        """The pattern with what a design holds fixed as suits its controls now: a design goes on
        from it. Itself where nothing changes.
        """
        return self

    @abstractmethod
    def realise(self, controls: Any) -> Any: ...

    @abstractmethod
    def deposit(self, realised: Any) -> Deposit:
        """Where the material of all layers goes."""

    @abstractmethod
    def cells(self, realised: Any) -> tuple[Array, Array, Array]:
        """Points xyz (n, 3), mm, local porosity (n,) and volume (n,) of the pattern's own cells."""

    @abstractmethod
    def penalties(self, realised: Any, limits: Limits) -> Penalties: ...

    @abstractmethod
    def roughness(self, controls: Any) -> Float[Array, " n"]:
        """Differences of neighbouring controls, to be kept small."""

    @abstractmethod
    def widths(self, realised: Any) -> tuple[Array, Array]:
        """Least and largest road width, mm."""

    @abstractmethod
    def strokes(self, controls: Any) -> Iterator[Sequence[Stroke]]:
        """What is to be laid on each layer, from the bed upwards."""

    @abstractmethod
    def facts(self, controls: Any) -> dict[str, Any]:
        """What a report says of the pattern, by name: numbers, words, and lists of these."""

    def pictures(self, controls: Any) -> dict[str, tuple[Panel, ...]]:
        """What can be drawn of the pattern's functions, by name: panels to stand side by side.

        "laplacians": lap(xi) and lap(eta), P and Q of eq. (5), 1/mm^2, on the top layer.
        """
        return {}

    def scale(self, step: Any) -> Any:
        """Controls as an optimiser steps through them: what a step of these amounts to.

        Linear. A pattern whose controls are many rescales them so that all matter alike.
        """
        return step

    @property
    def mean_by_count(self) -> bool:
        """Whether the part's mean is met by the count of lines and not by the controls."""
        return False

    @property
    def patience(self) -> float | None:
        """Gain of the objective over four improvements below which a design ends, if the pattern
        knows better than the optimiser."""
        return None

    @property
    def correcting(self) -> int:
        """Most evaluations that a correction by what a plan lays is worth."""
        return 30

    def counted(self, asked: float, laid: float) -> "AbstractPattern":
        """The pattern with as many lines as bring what is laid nearest to what is asked, mm^3.

        `laid` is what a plan of the pattern at its own controls was seen to hold.
        """
        return self


def mode_key() -> Any:
    """The key `mode`, alike in all patterns of two families."""
    return key(
        choice(*MODES),
        "families on alternate layers or both on each; staggered from layer to layer or not",
        default="alternate-staggered",
    )


def phases_key() -> Any:
    """The key `phases`, likewise."""
    return key(
        whole(2, 100), "staggered: layers of a family over which its lines are shifted", default=5
    )


def road_width_key() -> Any:
    """The key `road_width`, likewise."""
    return key(LENGTH, "road width, or where the design starts", default="0.4mm")


def corrections_key(often: int | None, shown: str | None = None) -> Any:
    """The key `corrections`, likewise; `shown` as the default where that is None."""
    return key(
        whole(0, 10),
        "most times that what the plan lays beside the model is made up for",
        default=often,
        shown=shown,
        table="design",
    )


class AbstractSettings:
    """What a user says of a pattern, as a frozen dataclass whose fields are keys of a job.

    - `mode`, `phases`: how families follow each other from layer to layer, see `road.stacking`; a
      pattern without families leaves the mode as it is.
    - `road_width`: mm, or where the design starts; `controls`: what the design may change.
    - `corrections`: how often a design is worth correcting by what a plan of it lays, at most:
      after the first correction only while a window of the plan misses by more than `enough`.
    - `count`: what a solid share counts, in design, correction and report, one of `bead.SECTIONS`.
    """

    count: str = "volume"
    mode: str = "alternate"
    phases: int
    road_width: float
    controls: tuple[str, ...]
    corrections: int = 0
    enough: ClassVar[float] = 0.0

    @abstractmethod
    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> AbstractPattern:
        """The pattern before any design, for windows of side `window`, mm.

        Raises `InputError` where part, target and settings do not go together.
        """

    def stacking(self, layers: int) -> Stacking:
        """The families of each layer. Raises `InputError` for phases that do not fit the mode."""
        return Stacking(self.mode, self.phases if self.mode.endswith("staggered") else 1, layers)

    @property
    def cells_first(self) -> bool:
        """Whether a design meets the pattern's own cells before windows."""
        return False

    @property
    def window_steps(self) -> int:
        """Windows of a design to a window's side, even: their edges rise over one such step."""
        return 2

    @property
    def width_is_free(self) -> bool:
        """Whether the design changes road widths."""
        return bool({"width", "width_field"} & set(self.controls))
