"""How the keys of a job file are declared, read, checked and shown in one table."""

import dataclasses
import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fdjax.errors import InputError
from fdjax.units import length

EMPTY: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class Place:
    """Where a value stands, for errors and for what is relative to it.

    - `source`, `table`, `key`: the file, "[part]" and "size".
    - `folder`: the job file's folder; relative paths start there.
    - `unit`: of bare coordinates in the table.
    """

    source: str
    table: str = ""
    key: str = ""
    folder: Path = Path()
    unit: str = "mm"

    @property
    def where(self) -> str:
        inside = f"{self.table} {self.key}".strip()
        return f"{self.source}: {inside}" if inside else self.source

    def error(self, what: object) -> InputError:
        return InputError(f"{self.where}: {what}")

    def at(self, key: str) -> "Place":
        """The place of a key, or of a part of one as "[2]" or ".arc"."""
        return dataclasses.replace(self, key=self.key + key)


@dataclass(frozen=True)
class Kind:
    """What a key may hold: `text` says it in the table, `read` turns it into data or raises.

    `again`: whether it reads what it has read as the same.
    """

    text: str
    read: Callable[[Any, Place], Any]
    again: bool = False


def key(
    kind: Kind,
    meaning: str,
    *,
    default: Any = MISSING,
    shown: str | None = None,
    table: str | None = None,
) -> Any:
    """A dataclass field that is one key of the job; `default` as it would stand in the file.

    `shown` replaces the default in the table where it is worked out and not fixed. `table` is
    where a job says it, if that is not the table that the dataclass stands for.
    """
    metadata = {
        "kind": kind, "meaning": meaning, "default": default, "shown": shown, "table": table,
    }  # fmt: skip
    if default is MISSING:
        return field(metadata=metadata)
    value = None if default is None else kind.read(default, Place("default"))
    return field(default=value, metadata=metadata)


Keys = dict[str, "dataclasses.Field[Any]"]


def keys_of(cls: type, table: str | None = None) -> Keys:
    """The fields of a dataclass that are keys: those of its own table, or those of another."""
    own = {f.name: f for f in dataclasses.fields(cls) if "kind" in f.metadata}
    return {name: f for name, f in own.items() if f.metadata["table"] == table}


def read_values(
    declared: Keys,
    table: Any,
    place: Place,
    homes: Mapping[str, str] = EMPTY,
    tables: Iterable[str] = (),
) -> dict[str, Any]:
    """The keys of a TOML table that are declared, each read by its kind.

    `homes` says of keys that other tables have where they belong, `tables` names what may stand
    beside these keys. Raises `InputError` for an unknown key (naming the nearest), a missing one,
    and whatever the kinds refuse.
    """
    if not isinstance(table, Mapping):
        raise place.error("must be a table of keys")
    for name in table:
        if name not in declared:
            hint = f"it belongs in {homes[name]}" if name in homes else ""
            hint = hint or f'did you mean "{nearest(name, [*declared, *tables])}"?'
            raise place.error(f'unknown key "{name}" ({hint})')
    values = {}
    for name, f in declared.items():
        if name in table:
            values[name] = f.metadata["kind"].read(table[name], place.at(name))
        elif f.default is MISSING:
            raise place.error(f"{name} is missing ({f.metadata['meaning']})")
    return values


def check_values(table: Any) -> None:
    """Raise `InputError` for a value that a dataclass of keys was given in Python and that its key
    could not hold. NumPy's and JAX's numbers are numbers; kinds that do not read their own data
    again are left out.
    """
    for f in dataclasses.fields(table):
        value, kind = getattr(table, f.name), f.metadata.get("kind")
        if kind is not None and kind.again and not (value is None and f.default is None):
            kind.read(_plain(value), Place(type(table).__name__, key=f.name))


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.item() if getattr(value, "shape", None) == () else value


def rows(declared: Keys, prefix: str = "") -> list[tuple[str, str, str, str]]:
    """(key, what it may hold, default, meaning) of each key."""
    result = []
    for name, f in declared.items():
        default, shown = f.metadata["default"], f.metadata["shown"]
        if shown is None:
            shown = "required" if default is MISSING else f"`{_toml(default)}`"
        meaning = f.metadata["meaning"]
        result.append((f"`{prefix}{name}`", f.metadata["kind"].text, shown, meaning))
    return result


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word that looks most like this one."""
    return difflib.get_close_matches(word, list(known), 1, 0.0)[0]


def one_of(table: Any, names: tuple[str, ...], needed: str) -> None:
    """Raise `InputError` unless exactly one of these fields is given."""
    given = [name for name in names if getattr(table, name) is not None]
    if len(given) != 1:
        found = f"{' and '.join(given)} are given" if given else "none is given"
        raise InputError(f"{needed} needs exactly one of {', '.join(names)}; {found}")


# --- kinds of single values ---


def _number(value: Any, place: Place) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise place.error(f"{show(value)} is no number")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise place.error(f"{show(value)} is not finite")
    return result


def number(low: float, high: float = math.inf) -> Kind:
    """A number from `low` to `high`, both included."""
    text = f"{low:g} to {high:g}" if high < math.inf else f"{low:g} or more"
    text = "number" if low == -math.inf else text

    def read(value: Any, place: Place) -> float:
        result = _number(value, place)
        if not low <= result <= high:
            raise place.error(f"{show(value)} is out of range; {text} is possible")
        return result

    return Kind(text, read, again=True)


def whole(low: int, high: int) -> Kind:
    """A whole number from `low` to `high`, both included."""

    def read(value: Any, place: Place) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise place.error(f"{show(value)} is no whole number")
        if not low <= value <= high:
            raise place.error(f"{show(value)} is out of range; {low} to {high} is possible")
        return value

    return Kind(f"whole number, {low} to {high}", read, again=True)


def _positive_length(value: Any, place: Place) -> float:
    try:
        result = length(value, place.where)
    except OverflowError:
        raise place.error(f"{show(value)} is not finite") from None
    if not result > 0:
        raise place.error(f"{show(value)} must be more than 0")
    return result


def _text(value: Any, place: Place) -> str:
    if not isinstance(value, str) or not value.strip():
        raise place.error(f'{show(value)} must be text in quotes, as in "text"')
    return value


def _flag(value: Any, place: Place) -> bool:
    if not isinstance(value, bool):
        raise place.error(f"{show(value)} must be true or false")
    return value


def _file(value: Any, place: Place) -> Path:
    path = place.folder / _text(value, place)
    if not path.is_file():
        raise place.error(f"{path}: no such file")
    return path


def _unit(value: Any, place: Place) -> str:
    if not isinstance(value, str) or not value.isalpha():
        raise place.error(f'{show(value)} is no unit; write one like "mm" or "in"')
    length(f"1{value}", place.where)
    return value


LENGTH = Kind('length such as "0.4mm"', _positive_length, again=True)
TEXT = Kind("text", _text)
UNIT = Kind("mm, um, cm, m, in, mil, microstep", _unit)
FLAG = Kind("true or false", _flag, again=True)
FILE = Kind("file, relative to the job", _file)


def choice(*options: str) -> Kind:
    """One of some words."""

    def read(value: Any, place: Place) -> str:
        if value not in options:
            hint = f' (did you mean "{nearest(value, options)}"?)' if isinstance(value, str) else ""
            raise place.error(f"{show(value)} is not one of {', '.join(options)}{hint}")
        return value

    return Kind(", ".join(options), read, again=True)


# --- kinds of several values ---


def choices(*options: str, least: int = 1) -> Kind:
    """Some of some words, each once, at least one or, where `least` is 0, none."""
    one = choice(*options)

    def read(value: Any, place: Place) -> tuple[str, ...]:
        words = tuple(one.read(item, place) for item in _list(value, place))
        if len(words) < least:
            raise place.error(f"is empty; give some of {one.text}")
        for word in words:
            if words.count(word) > 1:
                raise place.error(f'"{word}" is given twice')
        return words

    return Kind(f"list of {one.text}", read, again=True)


def pair(kind: Kind) -> Kind:
    """Two values of one kind."""

    def read(value: Any, place: Place) -> tuple[Any, Any]:
        items = _list(value, place)
        if len(items) != 2:
            raise place.error(f"has {len(items)} values; 2 are needed")
        first, second = (kind.read(item, place.at(f"[{k}]")) for k, item in enumerate(items))
        return first, second

    return Kind(f"two of: {kind.text}", read, again=kind.again)


def several(one: Kind) -> Kind:
    """One or more values of one kind."""

    def read(value: Any, place: Place) -> tuple[Any, ...]:
        items = _list(value, place)
        if not items:
            raise place.error("is empty; one value or more is needed")
        return tuple(one.read(item, place.at(f"[{k}]")) for k, item in enumerate(items))

    return Kind(f"list of {one.text}", read, again=one.again)


def _coordinate(value: Any, place: Place) -> float:
    if isinstance(value, str):
        return length(value, place.where)
    return _number(value, place) * length(f"1{place.unit}", place.where)


def _point(value: Any, place: Place) -> tuple[float, float]:
    items = _list(value, place)
    if len(items) != 2:
        raise place.error(f"has {len(items)} coordinates; [x, y] is needed")
    return _coordinate(items[0], place), _coordinate(items[1], place)


COORDINATE = Kind("coordinate", _coordinate)
POINT = Kind("[x, y]", _point)


def points(fewest: int, most: int | None = None) -> Kind:
    """Places [x, y]; bare coordinates are in the table's unit, the result in mm."""
    many = f"{fewest}" if most == fewest else f"{fewest} or more"

    def read(value: Any, place: Place) -> tuple[tuple[float, float], ...]:
        items = _list(value, place)
        if len(items) < fewest or (most is not None and len(items) > most):
            raise place.error(f"has {len(items)} points; {many} are needed")
        return tuple(_point(item, place.at(f"[{k}]")) for k, item in enumerate(items))

    return Kind(f"{many} points [x, y]", read)


def _list(value: Any, place: Place) -> list[Any]:
    if not isinstance(value, list | tuple):
        raise place.error(f"{show(value)} must be a list in [ ]")
    return list(value)


def show(value: Any) -> str:
    """A value as an error shows it: short, and text in quotes."""
    text = f'"{value}"' if isinstance(value, str) else _toml(value)
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def _toml(value: Any) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{value}"'
        case list() | tuple():
            return "[" + ", ".join(_toml(item) for item in value) + "]"
        case dict():
            return "{" + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + "}"
        case _:
            return str(value)
