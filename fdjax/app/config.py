"""The TOML job: every key declared once, checked at the edge, frozen afterwards.

Loads JAX with the pattern that a job names, not before.
"""
# ruff: noqa: RUF009 - `key` gives a dataclass field

import math
import re
import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fdjax.app.materials import FORMULA, Materials
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
    keys_of,
    number,
    one_of,
    read_values,
    rows,
    show,
    whole,
)
from fdjax.pattern import PATTERNS, settings_of

if TYPE_CHECKING:
    from fdjax.pattern.base import AbstractSettings


def _name(value: Any, place: Place) -> str:
    if not isinstance(value, str) or not re.fullmatch(r"\w[\w.-]{0,99}", value, re.A):
        raise place.error(f"{show(value)} cannot name files; use letters, digits, _ - and .")
    return value


def _machine(value: Any, place: Place) -> str:
    name = TEXT.read(value, place)
    return str(FILE.read(value, place)) if name.endswith(".toml") else name


NAME = Kind("letters, digits, _ - .", _name)
MACHINE = Kind("profile's name or `.toml` file", _machine)
PROPORTION = number(0, 1)
FILE_KINDS = ("gcode", "sml", "ssl")
ANY = (-math.inf, math.inf)


@dataclass(frozen=True)
class TargetSource:
    """`[target]`: the porosity that is asked for, and how well it must be met."""

    porosity: str | None = key(
        FORMULA,
        "void share at (x, y, z), 0 to 1, z above the bed; one of four",
        default=None,
        shown="-",
    )
    solid: str | None = key(
        FORMULA, "solid share at (x, y, z), one less the porosity", default=None, shown="-"
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
    unit: str = key(UNIT, "of x, y and z in the formula", default="mm")
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
class Design:
    """`[design]`: how controls move until the target is met; which, the pattern says."""

    objective: str = key(
        choice("windows", "cells"), "where the porosity error is summed", default="windows"
    )
    smoothness: float = key(number(0), "weight of the controls' roughness", default=1e-4)
    iterations: int | None = key(
        whole(0, 10000),
        "most steps of the optimiser",
        default=None,
        shown="60, of many controls 150",
    )
    span_limit: bool = key(FLAG, "keep to the machine's longest unsupported span", default=True)
    cut_corners: bool = key(
        FLAG, "cut turn-arounds short at walls that would hold too much", default=True
    )
    left_out: float = key(
        number(0, 1),
        "share of the roads that may be left out: too close or too short",
        default=0.02,
    )
    laplacians: bool = key(FLAG, "draw lap(xi) and lap(eta), P and Q of eq. (5)", default=False)
    export_failed: bool = key(FLAG, "write machine files even if the design fails", default=False)


@dataclass(frozen=True)
class Job:
    """One job file."""

    part: Part
    target: TargetSource
    pattern: "AbstractSettings"
    kind: str
    design: Design = Design()
    materials: Materials = Materials()
    name: str = key(NAME, "of the part and of its files", default="part", shown="the file's")
    machine: str = key(MACHINE, "whose limits the design keeps", default="marlin-0.4")
    gcode_machine: str = key(
        MACHINE, "that the G-code is for, where `machine` takes none", default="marlin-0.4"
    )
    sml_machine: str = key(
        MACHINE, "that the SML is for, where `machine` takes none", default="stratasys-fdm1650"
    )
    files: tuple[str, ...] | None = key(
        choices(*FILE_KINDS), "machine files to write", default=None,
        shown="those whose machines can lay the job",
    )  # fmt: skip

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all files that a design of this job may write."""
        machine_files = (f"{self.name}.{kind}" for kind in FILE_KINDS)
        return (*machine_files, *REPORTS)


REPORTS = ("report.json", "roads.png", "porosity.png", "laplacians.png")
"""What a design may write beside machine files."""

_TABLES = {"part": Part, "target": TargetSource, "design": Design, "materials": Materials}

KIND = choice(*PATTERNS)


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
    >>> job.kind, job.pattern.road_width
    ('isolines', 0.4)
    """
    homes = {f: f"[{at}]" for at, cls in _TABLES.items() for f in keys_of(cls)}
    top = Place(source, folder=folder)
    plain = {name: value for name, value in table.items() if name not in (*_TABLES, "pattern")}
    values: dict[str, Any] = {"name": re.sub(r"[^\w.-]", "_", name, flags=re.A)}
    values |= read_values(keys_of(Job), plain, top, homes, (*_TABLES, "pattern"))
    values["kind"] = _kind(table, top)
    settings = settings_of(values["kind"])
    own = keys_of(settings)
    in_design = keys_of(settings, "design")
    homes |= dict.fromkeys(own, "[pattern]") | dict.fromkeys(in_design, "[design]")
    read = {}
    for at in (*_TABLES, "pattern"):
        place = Place(source, f"[{at}]", folder=folder)
        if at not in table and at in ("part", "target"):
            raise top.error(f"table [{at}] is missing")
        section = table.get(at, {})
        if at == "part" and isinstance(section, dict) and "unit" in section:
            place = replace(place, unit=UNIT.read(section["unit"], place.at("unit")))
        if at in ("pattern", "design"):
            _check_kind(section, at, values["kind"], place)
        declared = own | {"kind": _KIND} if at == "pattern" else keys_of(_TABLES[at])
        declared = declared | in_design if at == "design" else declared
        read[at] = read_values(declared, section, place, homes)
    read["pattern"].pop("kind", None)
    for key_name in in_design:
        if key_name in read["design"]:
            read["pattern"][key_name] = read["design"].pop(key_name)
    for at, cls in (*_TABLES.items(), ("pattern", settings)):
        try:
            values[at] = cls(**read[at])
        except InputError as fault:
            # A pattern names the key first, which may stand in another table of the job.
            inside = at == "pattern" and str(fault).partition(":")[0] in in_design
            raise Place(source, "[design]" if inside else f"[{at}]").error(fault) from None
    return Job(**values)


def _kind(table: dict[str, Any], top: Place) -> str:
    """The kind of pattern that a job asks for; one that names a map wants lines of it."""
    section = table.get("pattern", {})
    if isinstance(section, dict) and "kind" in section:
        return KIND.read(section["kind"], replace(top, table="[pattern]", key="kind"))
    return "grid-lines" if isinstance(section, dict) and "map" in section else "isolines"


def _check_kind(section: Any, at: str, kind: str, place: Place) -> None:
    """Raise `InputError` for a key that only another kind of pattern has."""
    table = None if at == "pattern" else "design"
    own = keys_of(settings_of(kind), table)
    for other in PATTERNS:
        for name in section if isinstance(section, dict) and other != kind else ():
            if name not in own and name in keys_of(settings_of(other), table):
                raise place.error(f'{name} is for pattern kind "{other}"; this is "{kind}"')


@dataclass(frozen=True)
class _PatternKind:
    kind: str = key(
        KIND, "what the roads are", default="isolines", shown="`isolines`; `grid-lines` with `map`"
    )


_KIND = keys_of(_PatternKind)["kind"]


def table() -> str:
    """Every key as one Markdown table: key, what it may hold, default, meaning."""
    lines = [*rows(keys_of(Job))]
    for at, cls in _TABLES.items():
        lines += rows(keys_of(cls), f"{at}.")
    lines += rows({"kind": _KIND}, "pattern.")
    for kind in PATTERNS:
        for at in ("pattern", "design"):
            declared = keys_of(settings_of(kind), None if at == "pattern" else at)
            lines += [
                (name, text, shown, f"{kind}: {meaning}")
                for name, text, shown, meaning in rows(declared, f"{at}.")
            ]
    head = ["| key | value | default | meaning |", "|---|---|---|---|"]
    return "\n".join([*head, *("| " + " | ".join(row) + " |" for row in lines)])
