"""The TOML job: every key declared once, checked at the edge, frozen afterwards. Loads no JAX."""
# ruff: noqa: RUF009 - `key` gives a dataclass field

import math
import re
import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from fdjax.app.part import Part
from fdjax.errors import InputError
from fdjax.keys import (
    FILE,
    FLAG,
    LENGTH,
    TEXT,
    UNIT,
    Kind,
    Place,
    choice,
    choices,
    key,
    number,
    one_of,
    pair,
    read_values,
    rows,
    show,
    whole,
)


def _name(value: Any, place: Place) -> str:
    if not isinstance(value, str) or not re.fullmatch(r"\w[\w.-]{0,99}", value, re.A):
        raise place.error(f"{show(value)} cannot name files; use letters, digits, _ - and .")
    return value


def _machine(value: Any, place: Place) -> str:
    name = TEXT.read(value, place)
    return str(FILE.read(value, place)) if name.endswith(".toml") else name


def _formula(value: Any, place: Place) -> str:
    from fdjax.target.expression import Expression

    text = value if isinstance(value, str) else show(value)
    try:
        return Expression(text).text
    except InputError as fault:
        raise place.error(fault) from None


NAME = Kind("letters, digits, _ - .", _name)
MACHINE = Kind("profile's name or `.toml` file", _machine)
FORMULA = Kind("formula in x, y", _formula)
PROPORTION = number(0, 1)
FILE_KINDS = ("gcode", "sml", "ssl")
ANY = (-math.inf, math.inf)


@dataclass(frozen=True)
class TargetSource:
    """`[target]`: the porosity that is asked for, and how well it must be met."""

    porosity: str | None = key(
        FORMULA, "void share at (x, y), 0 to 1; one of four", default=None, shown="-"
    )
    solid: str | None = key(
        FORMULA, "solid share at (x, y), one less the porosity", default=None, shown="-"
    )
    image: Path | None = key(
        FILE, "grey picture over the outline's bounding box, top row at largest y", default=None,
        shown="-",
    )  # fmt: skip
    array: Path | None = key(
        FILE, "`.npy` array over the bounding box, axes x, y", default=None, shown="-"
    )
    quantity: str = key(choice("porosity", "solid"), "what image or array give", default="porosity")
    low: float = key(number(*ANY), "what black, or a value 0, stands for", default=0.0)
    high: float = key(number(*ANY), "what white, or a value 1, stands for", default=1.0)
    unit: str = key(UNIT, "of x and y in the formula", default="mm")
    tolerance: float = key(
        PROPORTION, "largest RMS porosity error in windows that is accepted", default=0.02
    )
    window: float = key(LENGTH, "side of the windows of the report", default="5mm")

    def __post_init__(self) -> None:
        one_of(self, ("porosity", "solid", "image", "array"), "a target")
        sampled = self.image is not None or self.array is not None
        for f in fields(self):
            for_samples = f.name in ("quantity", "low", "high")
            if for_samples and not sampled and getattr(self, f.name) != f.default:
                raise InputError(f"{f.name} is for an image or array")
        if sampled and self.unit != "mm":
            raise InputError("unit is for a formula")


@dataclass(frozen=True)
class Pattern:
    """`[pattern]`: the map whose lines are the roads."""

    map: str = key(
        choice("uniform", "stretched", "two-boundary", "transfinite", "elliptic"),
        "map of the unit square into the outline",
        default="transfinite",
    )
    mode: str = key(
        choice("alternate", "both", "alternate-staggered", "both-staggered"),
        "families on alternate layers or both on each; staggered from layer to layer or not",
        default="alternate-staggered",
    )
    phases: int = key(
        whole(2, 100), "staggered: layers of a family over which its lines are shifted", default=5
    )
    road_width: float = key(LENGTH, "road width, or where the design starts", default="0.4mm")
    lines: tuple[int, int] | None = key(
        pair(whole(1, 10000)), "number of xi lines and of eta lines", default=None, shown="chosen"
    )
    nodes: tuple[int, int] = key(
        pair(whole(5, 1025)), "nodes of the elliptic solver along xi and eta", default=[33, 33]
    )
    beta: tuple[float, float] = key(
        pair(number(1)),
        "stretched: beta of eq. (1) along x and y, over 1; the nearer to 1, the stronger",
        default=[1.1, 1.1],
    )
    alpha: tuple[float, float] = key(
        pair(number(0, 0.5)),
        "stretched: alpha of eq. (1); 0.5 draws lines to both ends, 0 to the last",
        default=[0.5, 0.5],
    )
    phi: float = key(number(-1000, 1000), "elliptic: control along xi, unit square", default=0.0)
    psi: float = key(number(-1000, 1000), "elliptic: control along eta, unit square", default=0.0)
    phi_index: float | None = key(
        number(-10, 10), "phi per index step of `nodes`, as in the paper", default=None, shown="-"
    )
    psi_index: float | None = key(
        number(-10, 10), "psi per index step of `nodes`, as in the paper", default=None, shown="-"
    )

    p: float = key(
        number(*ANY), "elliptic: P of eq. (5), lap(xi), unit square, 1/mm^2", default=0.0
    )
    q: float = key(
        number(*ANY), "elliptic: Q of eq. (5), lap(eta), unit square, 1/mm^2", default=0.0
    )
    solver: str = key(
        choice("newton", "multigrid", "sor"),
        "elliptic: multigrid from about 100 nodes a side; `sor` is the paper's, at w = 1.8",
        default="newton",
    )

    def __post_init__(self) -> None:
        for name in ("phi", "psi"):
            if getattr(self, name) != 0 and getattr(self, f"{name}_index") is not None:
                raise InputError(f"give {name} or {name}_index, not both")
        if min(self.beta) <= 1:
            raise InputError("beta: both must be more than 1")
        if not set(self.alpha) <= {0.0, 0.5}:
            raise InputError("alpha: each must be 0 or 0.5")

    @property
    def phi_psi(self) -> tuple[float, float]:
        """phi and psi of the unit square, however they were given."""
        phi = self.phi if self.phi_index is None else self.phi_index * (self.nodes[0] - 1)
        psi = self.psi if self.psi_index is None else self.psi_index * (self.nodes[1] - 1)
        return phi, psi


@dataclass(frozen=True)
class Design:
    """`[design]`: what may move until the target is met."""

    controls: tuple[str, ...] = key(
        choices("spacing", "stretching", "phi", "psi", "width", "width_field"),
        "what the design may change",
        default=["spacing"],
    )
    knots: int | None = key(
        whole(4, 64), "spline coefficients of each side's spacing", default=None, shown="by window"
    )
    field_knots: tuple[int, int] = key(
        pair(whole(4, 64)), "spline coefficients of a field along xi and eta", default=[8, 6]
    )
    objective: str = key(
        choice("windows", "cells"), "where the porosity error is summed", default="windows"
    )
    smoothness: float = key(number(0), "weight of the controls' roughness", default=1e-4)
    iterations: int = key(whole(0, 10000), "most steps of the optimiser", default=60)
    span_limit: bool = key(FLAG, "keep to the machine's longest unsupported span", default=True)
    export_failed: bool = key(FLAG, "write machine files even if the design fails", default=False)


@dataclass(frozen=True)
class Job:
    """One job file."""

    part: Part
    target: TargetSource
    pattern: Pattern = Pattern()
    design: Design = Design()
    name: str = key(NAME, "of the part and of its files", default="part", shown="the file's")
    machine: str = key(MACHINE, "whose limits the design keeps", default="marlin-0.4")
    gcode_machine: str = key(
        MACHINE, "that the G-code is for, where `machine` takes none", default="marlin-0.4"
    )
    sml_machine: str = key(
        MACHINE, "that the SML is for, where `machine` takes none", default="stratasys-fdm1650"
    )
    files: tuple[str, ...] = key(
        choices(*FILE_KINDS), "machine files to write", default=list(FILE_KINDS)
    )

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all files that a design of this job may write."""
        machine_files = (f"{self.name}.{kind}" for kind in FILE_KINDS)
        return (*machine_files, "report.json", "grid.png", "porosity.png")


_TABLES = {"part": Part, "target": TargetSource, "pattern": Pattern, "design": Design}


def load(path: str | Path) -> Job:
    """The job in a TOML file. Raises `InputError` with file, table and key in one line."""
    path = Path(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as fault:
        raise InputError(f"{path}: cannot be read: {fault.strerror or fault}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no text in UTF-8") from None
    except (ValueError, RecursionError) as fault:
        raise InputError(f"{path}: is not TOML: {fault}") from None
    return parse(table, source=path.name, folder=path.parent, name=path.stem)


def parse(
    table: dict[str, Any], *, source: str = "job", folder: Path = Path(), name: str = "part"
) -> Job:
    """The job in a table as TOML gives it; `source` names it in errors.

    >>> job = parse({"part": {"shape": "cosine_top"}, "target": {"porosity": 0.65}})
    >>> job.pattern.road_width
    0.4
    """
    homes = {f.name: f"[{at}]" for at, cls in _TABLES.items() for f in fields(cls)}
    top = Place(source, folder=folder)
    plain = {name: value for name, value in table.items() if name not in _TABLES}
    values: dict[str, Any] = {"name": re.sub(r"[^\w.-]", "_", name, flags=re.A)}
    values |= read_values(Job, plain, top, homes)
    for at, cls in _TABLES.items():
        place = Place(source, f"[{at}]", folder=folder)
        if at not in table and at in ("part", "target"):
            raise top.error(f"table [{at}] is missing")
        section = table.get(at, {})
        if at == "part" and isinstance(section, dict) and "unit" in section:
            place = replace(place, unit=UNIT.read(section["unit"], place.at("unit")))
        read = read_values(cls, section, place, homes)
        try:
            values[at] = cls(**read)
        except InputError as fault:
            raise place.error(fault) from None
    return Job(**values)


def table() -> str:
    """Every key as one Markdown table: key, what it may hold, default, meaning."""
    lines = [*rows(Job)]
    for at, cls in _TABLES.items():
        lines += rows(cls, f"{at}.")
    head = ["| key | value | default | meaning |", "|---|---|---|---|"]
    return "\n".join([*head, *("| " + " | ".join(row) + " |" for row in lines)])
