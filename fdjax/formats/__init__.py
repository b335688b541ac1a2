"""Machine files: one module a format, each with a reader and a writer."""

import contextlib
import importlib
import inspect
import os
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from fdjax.errors import InputError

if TYPE_CHECKING:
    from fdjax.formats.profile import Machine
    from fdjax.plan.toolpath import Build

FORMATS = {
    ".gcode": "fdjax.formats.gcode",
    ".gco": "fdjax.formats.gcode",
    ".g": "fdjax.formats.gcode",
    ".sml": "fdjax.formats.sml",
    ".ssl": "fdjax.formats.ssl",
}
"""Module of each file suffix; loaded on first use.

A module has `write(build, machine)` and `read(text, ...)`, and `fit(build, machine)` where the
format rounds what the roads are; `READS_BYTES` where `read` is better off without decoded text.
"""


def module(path: str | Path) -> ModuleType:
    """The module for a file of this name. Raises `InputError` for a suffix that is not known."""
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: unknown kind of file; known are {', '.join(FORMATS)}")
    return importlib.import_module(FORMATS[suffix])


def write_file(build: "Build", path: str | Path, machine: "Machine | str | Path") -> None:
    """Write a build as the machine file that the path's suffix names.

    The roads are those of the format's `fit`. `machine` may also be the name or path of a profile.
    The file appears whole or not at all: it is written under another name beside `path` and then
    renamed. Raises `InputError` for a suffix that is not known, a folder that cannot be written,
    and whatever the format cannot hold.
    """
    path = Path(path)
    writer = module(path).write
    if isinstance(machine, str | Path):
        from fdjax.formats import profile

        machine = profile.load(machine)
    text = writer(build, machine)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8")
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def read_file(path: str | Path, **options: Any) -> "Build":
    """The build that a machine file holds; `options` go to the format's `read` unless None.

    `machine` may also be the name or path of a profile. Raises `InputError`, naming the file, where
    it cannot be read or is not what its suffix says, and for an option that its format has no use
    for.
    """
    reader = module(path).read
    reads_bytes = getattr(module(path), "READS_BYTES", False)
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in inspect.signature(reader).parameters:
            raise InputError(f"{path}: a {Path(path).suffix} file has no use for {name!r}")
    if isinstance(given.get("machine"), str | Path):
        from fdjax.formats import profile

        given["machine"] = profile.load(given["machine"])
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    # Windows' shells rewrite files in UTF-16, and editors put a byte-order mark before UTF-8.
    if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        data = data.decode("utf-16", errors="replace").encode()
    data = data.removeprefix(BOM_UTF8)
    text = data if reads_bytes else data.decode(errors="replace")
    try:
        return reader(text, **given)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
