"""Machine profiles as text for people."""

import dataclasses
from typing import Any

from fdjax.formats import profile

_NOTE = (
    "(?) no public source confirms this value: check it, and correct it in a copy of the profile"
)


def listing() -> str:
    """The bundled profiles, one a line."""
    machines = [profile.load(name) for name in profile.names()]
    wide = max(len(machine.name) for machine in machines)
    return "\n".join(f"{machine.name:{wide}}  {machine.title}" for machine in machines)


def description(name: str) -> str:
    """Every value of the profile of this name or file; unverified ones are marked (?).

    Raises `InputError` as `profile.load` does.
    """
    machine = profile.load(name)
    lines = [f"{machine.name}: {machine.title}", "lengths in mm", ""]
    lines += _table(machine, "", frozenset(machine.unverified))
    if machine.unverified:
        lines += ["", _NOTE]
    return "\n".join(lines)


def _table(values: Any, prefix: str, unverified: frozenset[str]) -> list[str]:
    lines, tables = [], []
    for field in dataclasses.fields(values):
        value = getattr(values, field.name)
        key = prefix + field.name
        if dataclasses.is_dataclass(value):
            tables += ["", f"[{key}]", *_table(value, f"{key}.", unverified)]
        elif value is not None and key not in ("name", "title", "unverified"):
            mark = " (?)" if key in unverified else ""
            lines.append(f"{field.name:18} {_text(value)}{mark}")
    return lines + tables


def _text(value: Any) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:g}"
        case tuple() if all(isinstance(item, str) for item in value):
            return " | ".join(value)
        case tuple():
            return ", ".join(map(_text, value))
        case _:
            return str(value)
