"""Putting a build together from the deposits and comments that a reader meets in a file."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fdjax.errors import InputError
from fdjax.formats import header
from fdjax.plan.toolpath import Build, Layer, Outline, Road
from fdjax.road.bead import road_width


@dataclass(frozen=True)
class _Deposit:
    path: NDArray[np.float64]
    section: NDArray[np.float64]
    z: float
    material: int
    family: str
    closed: bool


@dataclass
class _MarkedLayer:
    z: float
    height: float
    outline: Outline | None
    deposits: list[_Deposit] = field(default_factory=list)
    line: int = 0


def _marked_layer(line: str, settings: dict[str, str], outline: Outline | None) -> _MarkedLayer:
    """The layer that a mark begins. Raises `InputError` for a damaged one."""
    try:
        z, height = float(settings["z"]), float(settings["height"])
    except (KeyError, ValueError):
        z = height = math.nan
    if not (math.isfinite(z) and 0 < height < math.inf):
        raise InputError(f"{line.strip()!r}: z= and a positive height= are needed")
    return _MarkedLayer(z, height, outline)


def _material(settings: dict[str, str], tool: int | None) -> int | None:
    try:
        return int(settings["material"]) if "material" in settings else tool
    except ValueError:
        raise InputError(f"material {settings['material']!r} is no whole number") from None


class Marks:
    """What fdjax says in comments of a file, each with its line.

    - `layers`: with their lines. `heads`: lines before which a road ends; `own`: of each, the index
      in `settings` of what it says of the road behind it: whether it is closed, its family and its
      material or None. `primes`: lines and whether priming begins there.
    """

    def __init__(self) -> None:
        self.facts = header.Facts()
        self.layers: list[_MarkedLayer] = []
        self.heads: list[int] = []
        self.own: list[int] = []
        self.settings: list[tuple[bool, str, int | None]] = [(False, "", None)]
        self.primes: list[tuple[int, bool]] = []
        self.ended = False
        self._known: dict[str, int] = {}

    def feed(self, number: int, line: str) -> None:
        """Take a comment line. Raises `InputError` for a damaged mark."""
        own = self._known.get(line)
        if own is None:
            own = self._take(number, line)
        self.heads.append(number)
        self.own.append(own)

    def _take(self, number: int, line: str) -> int:
        if self.facts.feed(line):
            return 0
        word, settings = header.mark(line) or ("", {})
        if word == "layer":
            self.layers.append(_marked_layer(line, settings, self.facts.outline()))
            self.layers[-1].line = number
        elif word == "road":
            family = settings.get("family", "")
            self.settings.append(("closed" in settings, family, _material(settings, None)))
            self._known[line] = len(self.settings) - 1
            return self._known[line]
        elif word == "prime":
            self.primes.append((number, "begin" in settings))
        elif word == "end":
            self.ended = True
        return 0


class Assembly:
    """Collects what a file lays down.

    Files of fdjax mark their layers and roads in comments. In others a layer is all that lies at
    one z, its height the difference to the z below, and a road is closed if it ends where it
    began.
    """

    def __init__(self) -> None:
        self.facts = header.Facts()
        self.ended = False
        self._layers: list[_MarkedLayer] = []
        self._unmarked: list[_Deposit] = []
        self._road: dict[str, str] = {}

    def comment(self, line: str) -> None:
        """Take a comment line. Raises `InputError` for a damaged mark of a layer."""
        if self.facts.feed(line):
            return
        word, settings = header.mark(line) or ("", {})
        if word == "layer":
            self._layers.append(_marked_layer(line, settings, self.facts.outline()))
        elif word == "road":
            self._road = settings
        elif word == "end":
            self.ended = True

    def add(self, path: ArrayLike, section: ArrayLike, *, z: float, material: int) -> None:
        """A deposit along `path`, shape (n + 1, 2), mm in machine coordinates.

        `section` is the section's area on each segment, shape (n,), in any unit.
        """
        path = np.asarray(path, float)
        settings, self._road = self._road, {}
        if self.facts.written_by_fdjax:
            closed = "closed" in settings
        else:
            closed = len(path) > 3 and bool((path[0] == path[-1]).all())
        own = _material(settings, material) or 0
        deposit = _Deposit(
            path, np.asarray(section, float), z, own, settings.get("family", ""), closed
        )
        (self._layers[-1].deposits if self._layers else self._unmarked).append(deposit)

    @property
    def empty(self) -> bool:
        """Whether the file holds neither a deposit nor a layer."""
        return not self._layers and not self._unmarked

    def build(self, *, unit: float, layer_height: float | None, outline: Outline | None) -> Build:
        """The build; `unit` is the area, mm^2, of the sections' unit.

        `layer_height` and `outline`, where given, are used for every layer instead of what the
        file says. Raises `InputError` where a layer's height cannot be told.
        """
        layers = self._layers or self._layers_by_z(layer_height)
        origin = self.facts.numbers("origin", 2) or (0.0, 0.0)
        made = []
        for layer in layers:
            height = layer_height or layer.height
            roads = _roads(layer.deposits, height, unit, np.asarray(origin))
            filled = layer.outline if outline is None else outline
            made.append(Layer(layer.z, height, roads, filled))
        return Build(
            tuple(made),
            name=self.facts.get("name") or "part",
            origin=(origin[0], origin[1]),
            notes=self.facts.notes,
        )

    def _layers_by_z(self, layer_height: float | None) -> list[_MarkedLayer]:
        grouped: dict[float, list[_Deposit]] = {}
        for deposit in self._unmarked:
            grouped.setdefault(round(deposit.z, 4), []).append(deposit)
        levels = sorted(grouped)
        if levels[0] <= 0 and layer_height is None:
            raise InputError(
                f"deposits at Z = {levels[0]:g} mm tell no layer height; give the layer height"
            )
        heights = np.diff([0.0, *levels])
        return [
            _MarkedLayer(z, float(height), None, grouped[z])
            for z, height in zip(levels, heights, strict=True)
        ]


def _roads(
    deposits: list[_Deposit], height: float, unit: float, origin: NDArray[np.float64]
) -> tuple[Road, ...]:
    """The roads of one layer; their widths in one go, as most roads are short."""
    if not deposits:
        return ()
    sections = np.concatenate([deposit.section for deposit in deposits])
    ends = np.cumsum([len(deposit.section) for deposit in deposits])[:-1]
    widths = np.split(road_width(sections * unit, height), ends)
    return tuple(
        Road(
            (deposit.path[:-1] if deposit.closed else deposit.path) - origin,
            width,
            material=deposit.material,
            closed=deposit.closed,
            family=deposit.family,
        )
        for deposit, width in zip(deposits, widths, strict=True)
    )


def road_mark(comment: str, road: Road) -> str:
    """The comment line that heads a road in a file. Raises `InputError` for an odd family name."""
    if not all(letter.isalnum() or letter in "_-" for letter in road.family):
        raise InputError(f"road family {road.family!r}: letters, digits, _ and - can be written")
    material = f" material={road.material}" if road.material else ""
    family = f" family={road.family}" if road.family else ""
    return f"{comment} fdjax road{material}{family}{' closed' if road.closed else ''}"


def layer_mark(comment: str, layer: Layer) -> str:
    """The comment line that heads a layer in a file."""
    return f"{comment} fdjax layer z={float(layer.z)!r} height={float(layer.height)!r}"


def option(value: float | None, name: str) -> float | None:
    """A reader's length option, checked: None, or positive and finite, else `InputError`."""
    if value is not None and not 0 < value < math.inf:
        raise InputError(f"{name}: {value!r}; a positive length in mm is needed")
    return value
