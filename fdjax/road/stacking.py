"""Which lines lie on which layer: the paper's four scan-line modes, with any number of phases.

Loads no JAX. A family of lines shares one comb of equally spaced places u in (0, 1); with P
phases, layer after layer takes every P-th place of the comb, so P layers together are P times as
fine as one.
"""

from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError

FAMILIES = ("xi", "eta")
"""Lines of constant xi, which run along eta, and lines of constant eta, which run along xi."""

MODES = ("alternate", "both", "alternate-staggered", "both-staggered")
"""The families on alternate layers or both on each, in place or staggered (paper, scan-line)."""


@dataclass(frozen=True)
class Scan:
    """One family's lines on one layer.

    - `family`: "xi" or "eta".
    - `phase` of `phases`: which places of the family's comb the layer takes.
    - `parity`: whether the first turn-around is at the far side (0) or the near one (1).
    """

    family: str
    phase: int = 0
    phases: int = 1
    parity: int = 0

    def places(self, comb: int) -> NDArray[np.float64]:
        """Places u in (0, 1) of this layer's lines, out of a comb of `comb` lines in all phases.

        >>> Scan("xi", phase=1, phases=2).places(6)
        array([0.25      , 0.58333333, 0.91666667])
        """
        return (np.arange(self.phase, comb, self.phases) + 0.5) / comb


@dataclass(frozen=True)
class Stacking:
    """How families and phases follow each other from layer to layer.

    - `mode`: one of `MODES`. Modes that are not staggered have one phase.
    - `phases`: layers of one family over which its lines are staggered, at least 2 if staggered.
    - `layers`: number of layers.

    Raises `InputError` for values outside these ranges.
    """

    mode: str = "alternate"
    phases: int = 1
    layers: int = 2

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise InputError(f'mode: "{self.mode}" is not one of {", ".join(MODES)}')
        if self.layers < 1:
            raise InputError(f"layers: {self.layers}; at least 1")
        if self.staggered and self.phases < 2:
            raise InputError(f'phases: {self.phases}; mode "{self.mode}" needs at least 2')
        if not self.staggered and self.phases != 1:
            raise InputError(
                f'phases: {self.phases}; mode "{self.mode}" has 1, use a staggered one'
            )

    @property
    def staggered(self) -> bool:
        return self.mode.endswith("staggered")

    @property
    def both_families(self) -> bool:
        """Whether each layer holds both families, so that they cross at nodes."""
        return self.mode.startswith("both")

    @property
    def scans(self) -> tuple[tuple[Scan, ...], ...]:
        """The scans of each layer, from the bed upwards."""
        if self.both_families:
            return tuple(
                tuple(self._scan(family, k) for family in FAMILIES) for k in range(self.layers)
            )
        return tuple((self._scan(FAMILIES[k % 2], k // 2),) for k in range(self.layers))

    def layer_share(self, family: str) -> float:
        """Share of the layers that hold this family."""
        return sum(scan.family == family for layer in self.scans for scan in layer) / self.layers

    def _scan(self, family: str, number: int) -> Scan:
        # A step near half the comb lets neighbouring layers support each other. The parity makes
        # the turn-arounds, which repeat every second gap, spread evenly over all the phases.
        step = next(s for s in range(max(self.phases // 2, 1), 0, -1) if gcd(s, self.phases) == 1)
        phase = number * step % self.phases
        return Scan(family, phase, self.phases, phase % 2)
