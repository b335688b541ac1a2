"""Machine profiles: what a machine can lay down and how its files say it, read from TOML."""

# ruff: noqa: RUF009  (`key` is dataclasses.field)

import difflib
import re
import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from fdjax.errors import InputError
from fdjax.formats import strict
from fdjax.formats.strict import key, table
from fdjax.formats.template import GCODE_NAMES, SML_NAMES, check
from fdjax.limits import Limits
from fdjax.moves import Point

_FOLDER = Path(__file__).parent / "profiles"


@dataclass(frozen=True)
class Extrusion:
    """Filament diameter in mm; `flow` multiplies the filament that a volume takes."""

    filament: float = key(strict.length(0.5, 10))
    flow: float = key(strict.number(0.1, 10))


@dataclass(frozen=True)
class Motion:
    """Speeds in mm/s."""

    first_layer_speed: float = key(strict.number(0.1, 1000))
    print_speed: float = key(strict.number(0.1, 1000))
    travel_speed: float = key(strict.number(0.1, 1000))
    z_speed: float = key(strict.number(0.1, 1000))


@dataclass(frozen=True)
class Temperature:
    """Temperatures in degrees Celsius; 0 is off."""

    nozzle: int = key(strict.whole(0, 500))
    bed: int = key(strict.whole(0, 200))


@dataclass(frozen=True)
class Retraction:
    """Filament pulled back before a travel: mm and mm/s; `hop` lifts the nozzle, mm.

    Travels shorter than `least_travel` (mm) are made without.
    """

    length: float = key(strict.length(0, 20))
    speed: float = key(strict.number(0.1, 1000))
    hop: float = key(strict.length(0, 10))
    least_travel: float = key(strict.length(0, 1000))


@dataclass(frozen=True)
class Cooling:
    """Part fan, 0 to 1, switched on after so many layers."""

    fan: float = key(strict.number(0, 1))
    layers_without: int = key(strict.whole(0, 1000))


@dataclass(frozen=True)
class Tool:
    """One of several tools.

    - `nozzle`: degrees Celsius while it lays; `standby`: while another does, 0 leaves it as hot;
      `ahead`: so many seconds before its turn it is told to heat, as roads and travel take at their
      speeds. At its turn it is waited for.
    - `retract`: mm pulled back before a travel; None is what holds for all; `park`: mm pulled back
      before another takes over, and given back when it is its turn again; None is `retract`.
    """

    nozzle: int = key(strict.whole(0, 500))
    standby: int = key(strict.whole(0, 500), default=0)
    ahead: float = key(strict.number(0, 3600), default=0.0)
    retract: float | None = key(strict.length(0, 20), default=None)
    park: float | None = key(strict.length(0, 100), default=None)


@dataclass(frozen=True)
class Tower:
    """A square on the bed, laid solid layer by layer as far up as tools change, to prime them.

    - `at`: its corner of least x and y, machine coordinates, mm; `side`: mm, rounded to whole
      roads, and larger where that takes.
    - `purge`: mm^3 that each change of tool lays at least.
    """

    at: tuple[float, float] = key(strict.lengths(2, -10_000, 10_000))
    side: float = key(strict.length(2, 200))
    purge: float = key(strict.number(0, 1000), default=0.0)


@dataclass(frozen=True)
class Gcode:
    """What the G-code writer needs of a machine.

    - `tools`: how many it has; `one_nozzle`: whether they share one; `relative_e`: M83, else M82.
    - `start`: code that heats and homes; `prime`: code that deposits outside the part, relative
      E; `end`: code that turns everything off. `template.GCODE_NAMES` lists the placeholders.
    - `tool`: of each tool, where there are several; `tower`: where they are primed, or None.
    """

    tools: int = key(strict.whole(1, 16))
    relative_e: bool = key(strict.flag)
    start: tuple[str, ...] = key(strict.lines(*GCODE_NAMES))
    prime: tuple[str, ...] = key(strict.lines(*GCODE_NAMES))
    end: tuple[str, ...] = key(strict.lines(*GCODE_NAMES))
    extrusion: Extrusion = key(table(Extrusion))
    motion: Motion = key(table(Motion))
    temperature: Temperature = key(table(Temperature))
    retraction: Retraction = key(table(Retraction))
    cooling: Cooling = key(table(Cooling))
    tool: tuple[Tool, ...] = key(strict.tables(Tool), default=())
    tower: Tower | None = key(table(Tower), default=None)
    one_nozzle: bool = key(strict.flag, default=False)

    @property
    def heaters(self) -> int:
        """How many nozzles are heated."""
        return 1 if self.one_nozzle else self.tools

    def tool_at(self, number: int) -> Tool:
        """What is known of a tool, with what holds for all where it says nothing of its own."""
        own = self.tool[number] if self.tool else Tool(self.temperature.nozzle)
        retract = self.retraction.length if own.retract is None else own.retract
        park = retract if own.park is None else own.park
        return replace(own, retract=retract, park=park)


@dataclass(frozen=True)
class Sml:
    """What the SML writer and reader need of a machine.

    - `speed`, `travel_speed`: microsteps/s; `acceleration`: thousands of microsteps/s^2.
    - `pre_delay`, `pre_code`: seconds of flow before a road, and its flow code.
    - `start_code`: flow code at the road's start (odd), in force for `start_steps` microsteps;
      `rollback_code` (odd): from `rollback_steps` before the road's end.
    - `area_per_code`: mm^2 of section per unit of an even flow code.
    - `mark`: what stands before a road's set-up; `comment`: what starts a comment line.
    - `stop`: commands before a travel; `layer`: the Z command with `{z}` in microsteps;
      `materials`: the command that selects each material; `header` and `footer`: command lines,
      with the placeholders of `template.SML_NAMES`.
    """

    speed: int = key(strict.whole(1, 32767))
    travel_speed: int = key(strict.whole(1, 32767))
    acceleration: int = key(strict.whole(1, 1000))
    pre_delay: float = key(strict.number(0, 6.5535))
    pre_code: int = key(strict.whole(0, 255))
    start_code: int = key(strict.whole(1, 127, odd=True))
    start_steps: int = key(strict.whole(1, 1000))
    rollback_steps: int = key(strict.whole(1, 1000))
    rollback_code: int = key(strict.whole(139, 255, odd=True))
    area_per_code: float = key(strict.number(1e-6, 1))
    mark: str = key(strict.text)
    comment: str = key(strict.text)
    stop: tuple[str, ...] = key(strict.lines())
    layer: str = key(strict.text)
    materials: tuple[str, ...] = key(strict.lines())
    header: tuple[str, ...] = key(strict.lines(*SML_NAMES))
    footer: tuple[str, ...] = key(strict.lines(*SML_NAMES))


@dataclass(frozen=True)
class Stream:
    """How to talk to a machine, and what to check before.

    - `firmware`: marlin, klipper, rrf, grbl or sml; `auto`: whatever answers.
    - `baud`: bits a second; `bytesize`, `parity`: of a byte on the line; `handshake`: of SML, one
      or more of enq-ack, xon-xoff and dtr.
    - `acceleration`: mm/s^2; `corner_speed`: mm/s, change of velocity that is made at once. Both
      for the time that a print takes.
    - `hottest`: nozzle and bed, degrees Celsius; `coldest`: nozzle that may push filament, 0 for a
      machine that pushes cold material; `density`: of the material, g/cm^3.
    - `longest_push`: mm of filament in one move without X and Y; `largest_section`: mm^2 of a road;
      of Klipper, where 0 means its own (50 mm, 4 x nozzle^2).
    - `park`: X and Y of a pause, None for the bed's rear left corner; `park_lift`, `park_retract`:
      mm that the nozzle rises and filament is pulled back in a pause.
    """

    firmware: str = key(strict.choice("auto", "marlin", "klipper", "rrf", "grbl", "sml"))
    baud: int = key(strict.whole(300, 4_000_000))
    bytesize: int = key(strict.whole(7, 8), default=8)
    parity: str = key(strict.choice("none", "even", "odd"), default="none")
    handshake: tuple[str, ...] = key(strict.lines(), default=())
    acceleration: float = key(strict.number(1, 100_000), default=1000.0)
    corner_speed: float = key(strict.number(0, 1000), default=8.0)
    hottest: tuple[float, float] = key(strict.pair(0, 600), default=(275.0, 120.0))
    coldest: float = key(strict.number(0, 500), default=150.0)
    density: float = key(strict.number(0.1, 30), default=1.24)
    longest_push: float = key(strict.length(0, 10_000), default=0.0)
    largest_section: float = key(strict.number(0, 10_000), default=0.0)
    park: tuple[float, ...] | None = key(strict.lengths(2, -10_000, 10_000), default=None)
    park_lift: float = key(strict.length(0, 100), default=10.0)
    park_retract: float = key(strict.length(0, 20), default=2.0)


HANDSHAKES = ("enq-ack", "xon-xoff", "dtr")
"""Ways in which an SML machine says that its buffer is full."""


@dataclass(frozen=True)
class Machine:
    """What every machine says of itself; lengths in mm.

    - `name`, `title`; `format`: "gcode" or "sml", which of the tables below it must have.
    - `bed`: x, y and z; `nozzle`: its bore.
    - `bed_origin`: machine coordinates of the bed's front left corner; half the bed below 0 where
      its centre is 0, as with deltas. `lowest`: least X, Y and Z that the head reaches, as for a
      purge before the bed's edge; None means `bed_origin` and 0.
    - `road_width`, `layer_height`: smallest and largest.
    - `least_road`: shortest whole road, from flow on to flow off; `longest_span`: longest road
      that nothing below supports.
    - `lift_length`: deposit that takes as long as one lift and set-down; a detour along a wall is
      preferred to lifting where it is shorter than this and the travel together.
    - `least_spacing`: of roads of one family; None means the road width, so roads may touch.
    - `unverified`: dotted keys that no public source confirms.
    - `stream`: how to talk to it.
    """

    name: str = key(strict.text)
    title: str = key(strict.text)
    format: str = key(strict.choice("gcode", "sml"))
    bed: tuple[float, float, float] = key(strict.lengths(3, 10, 10_000))
    nozzle: float = key(strict.length(0.05, 10))
    road_width: tuple[float, float] = key(strict.span(0.01, 50))
    layer_height: tuple[float, float] = key(strict.span(0.005, 20))
    least_road: float = key(strict.length(0, 1000))
    longest_span: float = key(strict.length(0.01, 1000))
    lift_length: float = key(strict.length(0, 1000))
    least_spacing: float | None = key(strict.length(0.01, 1000), default=None)
    bed_origin: tuple[float, ...] = key(strict.lengths(2, -10_000, 10_000), default=(0.0, 0.0))
    lowest: tuple[float, ...] | None = key(strict.lengths(3, -10_000, 10_000), default=None)
    unverified: tuple[str, ...] = key(strict.lines(), default=())
    gcode: Gcode | None = key(table(Gcode), default=None)
    sml: Sml | None = key(table(Sml), default=None)
    stream: Stream = key(table(Stream), default=Stream("auto", 115200))

    @property
    def room(self) -> tuple[Point, Point]:
        """Least and largest x, y and z that the head reaches, mm."""
        x, y = self.bed_origin
        a, b, c = self.lowest or (x, y, 0.0)
        return (a, b, c), (x + self.bed[0], y + self.bed[1], self.bed[2])

    @property
    def parking(self) -> tuple[float, float]:
        """X and Y of a pause, mm."""
        (x, y) = self.stream.park or (self.bed_origin[0], self.bed_origin[1] + self.bed[1])
        return x, y

    @property
    def limits(self) -> Limits:
        """What it can lay, as design and checks take it."""
        return Limits(**{each.name: getattr(self, each.name) for each in fields(Limits)})


def names() -> list[str]:
    """Names of the bundled profiles.

    >>> names()
    ['marlin-0.4', 'marlin-0.4-dual', 'stratasys-fdm1650']
    """
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def load(name_or_path: str | Path) -> Machine:
    """The machine of a bundled profile's name or of a path to a TOML file.

    Raises `InputError` for a profile that is not there, is no TOML, has an unknown key, or has a
    missing or absurd value; the message names profile, table and key.

    >>> load("marlin-0.4").road_width
    (0.3, 0.8)
    """
    given = str(name_or_path)
    path = _FOLDER / f"{given}.toml" if given in names() else Path(name_or_path)
    where = f"profile {given}"
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        near = difflib.get_close_matches(given, names(), 1, 0.0)[0]
        raise InputError(
            f'{where}: no such machine or file (did you mean "{near}"? known: {", ".join(names())})'
        ) from None
    except (OSError, ValueError) as error:  # unreadable, not text, or not TOML
        raise InputError(f"{where}: cannot be read as TOML ({error})") from None
    machine = table(Machine)(data, f"{where}: ")
    _check(machine, where)
    return machine


def _check(machine: Machine, where: str) -> None:
    if getattr(machine, machine.format) is None:
        raise InputError(f"{where}: {machine.format}: missing table (format is {machine.format!r})")
    for dotted in machine.unverified:
        value: Any = machine
        for part in dotted.split("."):
            value = getattr(value, part, None)
        if value is None:
            raise InputError(f"{where}: unverified: there is no key {dotted!r}")
    low, high = machine.room
    if any(a >= b for a, b in zip(low, high, strict=True)):
        raise InputError(f"{where}: lowest: must be below bed_origin + bed")
    for name in machine.stream.handshake:
        if name not in HANDSHAKES:
            known = ", ".join(HANDSHAKES)
            raise InputError(f"{where}: stream.handshake: {name!r}; one of {known} is needed")
    if machine.gcode is not None:
        _check_tools(machine.gcode, where)
    if machine.sml is not None:
        sml = machine.sml
        check([sml.layer], ["z"], f"{where}: sml.layer")
        if not re.fullmatch(r"[A-Za-z]{2}\{z\};", sml.layer):
            raise InputError(f"{where}: sml.layer: {sml.layer!r}; one command such as 'AZ{{z}};'")
        for name in ("header", "footer", "stop"):
            for line in getattr(sml, name):
                if not line.rstrip().endswith(";"):
                    raise InputError(f"{where}: sml.{name}: {line!r} does not end in ;")
        for line in sml.materials:
            if not re.fullmatch(r"[A-Za-z]{2}[^;]*;", line):
                raise InputError(f"{where}: sml.materials: {line!r}; one command such as 'SP1;'")
        if not sml.comment.strip() or sml.comment[0].isalnum() or ";" in sml.comment:
            raise InputError(f"{where}: sml.comment: {sml.comment!r}; a sign such as '#'")
        if not sml.materials or len(set(sml.materials)) < len(sml.materials):
            raise InputError(f"{where}: sml.materials: one command a material, all different")


def _check_tools(gcode: Gcode, where: str) -> None:
    count = len(gcode.tool)
    if count not in (0, gcode.tools):
        raise InputError(f"{where}: gcode.tool: {count} tables for {gcode.tools} tools; one each")
    for number, tool in enumerate(gcode.tool):
        if gcode.one_nozzle and tool.standby:
            raise InputError(
                f"{where}: gcode.tool[{number}].standby: {tool.standby} C, but all tools share one "
                "nozzle (one_nozzle); 0 is right"
            )
