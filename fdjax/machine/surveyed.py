"""What a machine file will do, as a survey finds it."""

from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

from fdjax.errors import InputError
from fdjax.machine.findings import Finding
from fdjax.moves import Point


@dataclass(frozen=True)
class LayerStart:
    """A layer's first line in the file, its z in mm if it deposits, and the seconds before it."""

    line: int
    z: float | None
    seconds: float


@dataclass(frozen=True)
class Survey:
    """What a file will do.

    - `lines`: of the file; `commands`: how many of them are sent.
    - `seconds`: that motion and waits take; heating and homing come on top.
    - `volume`: of material, mm^3; `filament`: mm of it, 0 for SML; `grams`: by the machine's
      density. What is pulled back and pushed again counts once; priming counts.
    - `deposits`, `moves`: smallest and largest x, y, z on the bed, mm, of deposits other than the
      priming that fdjax marks, and of all motion but homing; None where there is none.
    - `nozzle`, `bed`: the highest temperatures asked for, degrees Celsius.
    """

    lines: int
    commands: int
    layers: tuple[LayerStart, ...]
    seconds: float
    volume: float
    filament: float
    grams: float
    deposits: tuple[Point, Point] | None
    moves: tuple[Point, Point] | None
    nozzle: float
    bed: float
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that forbid sending."""
        return tuple(finding for finding in self.findings if finding.severity == "error")

    def refuse(self, path: Path) -> None:
        """Raise `InputError` for a file that must not be sent."""
        if self.errors:
            more = len(self.errors) - 1
            first = str(self.errors[0]).removeprefix("error: ")
            raise InputError(f"{path}: {first}" + (f"; and {more} more" if more else ""))

    @property
    def starts(self) -> list[int]:
        """The file lines at which layers begin."""
        return [layer.line for layer in self.layers]

    def layer_of(self, line: int) -> int:
        """The layer that a file line lies in, from 1; 0 before the first."""
        return bisect_right(self.layers, line, key=lambda layer: layer.line)
