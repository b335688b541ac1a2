"""A machine file as what is sent of it: its commands, line by line, never loaded whole."""

import hashlib
import math
import re
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from fdjax.errors import InputError
from fdjax.formats import FORMATS
from fdjax.formats.profile import Machine
from fdjax.gcode.firmware import firmware_of
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import code_of
from fdjax.machine.sml_state import SmlState

_LAYER = re.compile(r"\W*fdjax layer |;\s*(LAYER:|LAYER_CHANGE)")
_LOOK = 256
"""Lines after which the file is looked at again, whether it is the one that was checked."""
_CHUNK = 1 << 18
"""Bytes that are read together."""
_FACT = re.compile(r"\W*fdjax (\S+) = (.*)")


class Command(NamedTuple):
    """What is sent of one line of the file: no comments, no frame, never empty."""

    text: str
    line: int


State = GcodeState | SmlState


def switched_on(machine: Machine, firmware: str) -> GcodeState:
    """A machine that takes G-code, with its filament, before the first line."""
    if machine.gcode is None:
        return GcodeState(firmware_of(firmware))
    extrusion = machine.gcode.extrusion
    area = math.pi / 4 * extrusion.filament**2
    return GcodeState(
        firmware_of(firmware),
        filament_area=area,
        flow=extrusion.flow,
        one_nozzle=machine.gcode.one_nozzle,
    )


@dataclass(frozen=True)
class Program:
    """A G-code or SML file for a machine.

    Raises `InputError` for a file that is not there, is of another kind or of another language
    than the machine's.
    """

    path: Path
    machine: Machine

    def __post_init__(self) -> None:
        suffix = self.path.suffix.lower()
        language = FORMATS.get(suffix, "").rpartition(".")[2]
        if language not in ("gcode", "sml"):
            raise InputError(f"{self.path}: unknown kind of file; .gcode, .gco, .g or .sml")
        if getattr(self.machine, language) is None:
            raise InputError(
                f"{self.path}: {self.machine.name} takes no {language}; "
                "name the machine that the file was written for"
            )
        try:
            with self.path.open("rb") as file:
                head = file.read(4096)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror})") from None
        _ = self._stamp
        if head.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
            raise InputError(f"{self.path}: the file is UTF-16; save it as UTF-8")
        if b"\0" in head:
            raise InputError(f"{self.path}: the file is binary")

    @cached_property
    def _stamp(self) -> tuple[int, int]:
        """Size and time of the file when it was first looked at."""
        found = self.path.stat()
        return found.st_size, found.st_mtime_ns

    @property
    def has_changed(self) -> bool:
        """Whether the file is another one than when it was first looked at."""
        found = self.path.stat()
        return (found.st_size, found.st_mtime_ns) != self._stamp

    def _check(self) -> None:
        if self.has_changed:
            raise InputError(f"{self.path}: has changed since it was checked")

    @cached_property
    def language(self) -> str:
        """ "gcode" or "sml"."""
        return "sml" if self.path.suffix.lower() == ".sml" else "gcode"

    def state(self, firmware: str | None = None) -> State:
        """The machine before the first line; its firmware is the profile's unless given."""
        if self.machine.sml is not None and self.language == "sml":
            return SmlState(self.machine.sml)
        return switched_on(self.machine, firmware or self.machine.stream.firmware)

    def lines(self) -> Iterator[tuple[int, str]]:
        """Number and text of every line. Raises `InputError` once the file has changed."""
        self._check()
        with self.path.open(encoding="utf-8-sig", errors="replace") as file:
            for number, line in enumerate(file, 1):
                if number % _LOOK == 0:
                    self._check()
                yield number, line
        self._check()

    def chunks(self) -> Iterator[bytes]:
        """The lines' bytes, many lines at a time, each line with an end like that of `lines`.

        Raises `InputError` once the file has changed.
        """
        self._check()
        with self.path.open("rb") as file:
            chunk = file.read(_CHUNK).removeprefix(BOM_UTF8)
            while chunk := chunk + file.readline():
                self._check()
                yield chunk.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
                chunk = file.read(_CHUNK)
        self._check()

    def commands(self, after: int = 0) -> Iterator[Command]:
        """What there is to send of the lines after one."""
        for number, line in self.lines():
            if number > after:
                text = self.code(line)
                if text:
                    yield Command(text, number)

    def code(self, line: str) -> str:
        """A line of the file without comments and frame; empty where nothing is left."""
        if self.language == "sml":
            comment = self.machine.sml.comment if self.machine.sml else "#"
            return "" if line.lstrip().startswith(comment) else line.strip()
        return code_of(line)

    def is_layer(self, line: str) -> bool:
        """Whether a line is a comment that begins a layer."""
        return line[:1] in ";#" and _LAYER.match(line) is not None

    def facts(self) -> dict[str, str]:
        """What the head of a file of fdjax says of it, without values that span lines."""
        found = {}
        for number, line in self.lines():
            match = _FACT.match(line)
            if match is not None:
                found.setdefault(match[1], match[2].strip())
            elif number > 64:
                break
        return found

    def digest(self) -> str:
        """SHA-256 of the file."""
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
