"""Reading a TOML table into a frozen dataclass, strictly: every key known, present and sane."""

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, field, fields
from typing import Any, TypeVar

from fdjax import units
from fdjax.errors import InputError
from fdjax.formats import template

Reader = Callable[[Any, str], Any]
"""Turns a TOML value into the field's value; the text says in errors where the value stands."""

T = TypeVar("T")


def key(read: Reader, **options: Any) -> Any:
    """A dataclass field that is read from the TOML key of its own name by `read`."""
    return field(metadata={"read": read}, **options)


def table(cls: type[T]) -> Callable[[Any, str], T]:
    """Reads a TOML table into the dataclass `cls`, whose fields were made by `key`."""

    def read(value: Any, where: str) -> T:
        if not isinstance(value, Mapping):
            raise InputError(f"{where}: {value!r} is no table of keys")
        separator = "" if where.endswith(": ") else "."
        known = {f.name: f for f in fields(cls)}  # pyright: ignore[reportArgumentType]
        for name in value:
            if name not in known:
                near = difflib.get_close_matches(name, known, 1, 0.0)[0]
                raise InputError(f"{where}{separator}{name}: unknown key (did you mean {near}?)")
        read_values = {}
        for name, spec in known.items():
            if name in value:
                read_values[name] = spec.metadata["read"](value[name], f"{where}{separator}{name}")
            elif spec.default is MISSING:
                raise InputError(f"{where}{separator}{name}: missing value")
        return cls(**read_values)

    return read


def tables(cls: type[T]) -> Callable[[Any, str], tuple[T, ...]]:
    """Reads a list of TOML tables into dataclasses, as `table` does one."""
    one = table(cls)

    def read(value: Any, where: str) -> tuple[T, ...]:
        if not isinstance(value, list):
            raise InputError(f"{where}: {value!r}; a list of tables is needed")
        return tuple(one(item, f"{where}[{k}]") for k, item in enumerate(value))

    return read


def length(least: float, most: float) -> Reader:
    """A length as `units.length` reads it, from `least` to `most` mm."""

    def read(value: Any, where: str) -> float:
        return _within(units.length(value, where), least, most, where, " mm")

    return read


def lengths(count: int, least: float, most: float) -> Reader:
    """So many lengths in a list, each from `least` to `most` mm."""
    one = length(least, most)

    def read(value: Any, where: str) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != count:
            raise InputError(f"{where}: {value!r}; a list of {count} lengths is needed")
        return tuple(one(item, where) for item in value)

    return read


def span(least: float, most: float) -> Reader:
    """A smallest and a largest length in a list, in mm."""
    both = lengths(2, least, most)

    def read(value: Any, where: str) -> tuple[float, float]:
        low, high = both(value, where)
        if low > high:
            raise InputError(f"{where}: the smallest, {low:g} mm, is above the largest, {high:g}")
        return low, high

    return read


def number(least: float, most: float) -> Reader:
    """A number from `least` to `most`."""

    def read(value: Any, where: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{where}: {value!r} is no number")
        return _within(float(value), least, most, where)

    return read


def pair(least: float, most: float) -> Reader:
    """A list of two numbers, each from `least` to `most`."""
    one = number(least, most)

    def read(value: Any, where: str) -> tuple[float, float]:
        if not isinstance(value, list) or len(value) != 2:
            raise InputError(f"{where}: {value!r}; a list of two numbers is needed")
        return one(value[0], where), one(value[1], where)

    return read


def whole(least: int, most: int, *, odd: bool = False) -> Reader:
    """A whole number from `least` to `most`, odd ones only if `odd`."""

    def read(value: Any, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputError(f"{where}: {value!r} is no whole number")
        if odd and value % 2 == 0:
            raise InputError(f"{where}: {value} is even; an odd code is needed")
        return _within(value, least, most, where)

    return read


def flag(value: Any, where: str) -> bool:
    """Reads true or false."""
    if not isinstance(value, bool):
        raise InputError(f"{where}: {value!r} is neither true nor false")
    return value


def text(value: Any, where: str) -> str:
    """Reads a text of one line."""
    if not isinstance(value, str) or not value.isprintable():
        raise InputError(f"{where}: {value!r} is no text of one line")
    return value


def choice(*allowed: str) -> Reader:
    """One of these texts."""

    def read(value: Any, where: str) -> str:
        if value not in allowed:
            raise InputError(f"{where}: {value!r}; one of {', '.join(allowed)} is needed")
        return value

    return read


def lines(*placeholders: str) -> Reader:
    """A list of texts, each of one line, in which these `{placeholders}` may stand."""

    def read(value: Any, where: str) -> tuple[str, ...]:
        if not isinstance(value, list):
            raise InputError(f"{where}: {value!r}; a list of texts is needed")
        result = tuple(text(item, where) for item in value)
        template.check(result, placeholders, where)
        return result

    return read


def _within(value: T, least: float, most: float, where: str, unit: str = "") -> T:
    if not (math.isfinite(value) and least <= value <= most):  # pyright: ignore
        raise InputError(f"{where}: {value:g}{unit} is absurd; {least:g} to {most:g}{unit} can be")
    return value
