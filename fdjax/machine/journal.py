"""What survives a crash: how far a stream has come, and every byte that went either way."""

import contextlib
import json
import os
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from fdjax.errors import InputError

_SLOT = 64
"""Bytes of each of the two places that hold how far the stream has come, in turn."""
_SYNC = 1.0
"""Seconds after which the disk is made to hold it, at the latest."""


@dataclass(frozen=True)
class Job:
    """What was being sent: the file and its SHA-256, the machine's profile and the port."""

    file: str
    digest: str
    machine: str
    port: str


class Journal:
    """How far a stream has come, kept beside the file that is sent.

    The head names the job; then come two slots, written in turn, each with a checksum: whatever
    write a crash breaks off, the other slot is whole. The system holds each line at once, the disk
    each layer and every second.
    """

    def __init__(self, path: Path, job: Job, line: int = 0, layer: int = 0) -> None:
        head = json.dumps(asdict(job)).encode() + b"\n"
        self._at = len(head)
        self._count = 1
        self._synced = 0.0
        self._layer = layer
        new = path.with_name(f"{path.name}.new")
        try:
            # The journal of before is good until this one is whole.
            new.write_bytes(head + b" " * _SLOT + _slot_of(1, line, layer))
            os.replace(new, path)
            self._file = path.open("r+b", buffering=0)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror})") from None

    def reached(self, line: int, layer: int, now: float) -> None:
        """The machine has acknowledged the file up to a line, which lies in a layer."""
        self._count += 1
        self._file.seek(self._at + _SLOT * (self._count % 2))
        self._file.write(_slot_of(self._count, line, layer))
        if layer != self._layer or now - self._synced >= _SYNC:
            os.fsync(self._file.fileno())
            self._synced, self._layer = now, layer

    def close(self) -> None:
        """The end, reached or not; the file stays."""
        with contextlib.suppress(OSError):
            os.fsync(self._file.fileno())
        self._file.close()


def beside(path: Path, suffix: str) -> Path:
    """Where the "journal" or the "log" of a file lies.

    >>> beside(Path("out/plate.gcode"), "journal").name
    'plate.gcode.journal'
    """
    return path.with_name(f"{path.name}.{suffix}")


def read(path: Path) -> tuple[Job, int, int]:
    """The job, the line and the layer that were reached.

    Raises `InputError` where there is nothing to go on from.
    """
    try:
        head, _, rest = path.read_bytes().partition(b"\n")
        job = Job(**json.loads(head))
    except FileNotFoundError:
        raise InputError(f"{path}: there is none, so no print to go on with") from None
    except (OSError, ValueError, TypeError):
        raise InputError(f"{path}: is damaged; name the layer to begin with, --layer") from None
    slots = [_slot(rest[k : k + _SLOT]) for k in range(0, 2 * _SLOT, _SLOT)]
    reached = max(slots)
    if reached[0] == 0:
        raise InputError(f"{path}: is damaged; name the layer to begin with, --layer")
    return job, reached[1], reached[2]


def _slot_of(count: int, line: int, layer: int) -> bytes:
    body = f"{count} {line} {layer}"
    return (f"{body} {zlib.crc32(body.encode()):08x}".ljust(_SLOT - 1) + "\n").encode()


def _slot(data: bytes) -> tuple[int, int, int]:
    body, _, said = data.decode("ascii", "replace").strip().rpartition(" ")
    if said != f"{zlib.crc32(body.encode()):08x}":
        return 0, 0, 0
    count, line, layer = map(int, body.split())
    return count, line, layer


class Log:
    """Every byte sent (>) and received (<), with its time in seconds, a line each.

    Bytes are written as text with Python's escapes, so that they can be read back exactly. A disk
    that is full ends the log, not the print: `on_failure` is told, once. `more` adds to a log.
    """

    def __init__(
        self,
        path: Path,
        *,
        more: bool = False,
        on_failure: Callable[[str], object] = lambda text: None,
    ) -> None:
        self._on_failure = on_failure
        self._failed = False
        try:
            self._file = path.open("a" if more else "w", encoding="ascii", buffering=1 << 16)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror})") from None
        self._flushed = 0.0

    def __call__(self, now: float, way: str, data: bytes) -> None:
        if self._failed:
            return
        text = data.decode("latin-1").encode("unicode_escape").decode("ascii")
        try:
            self._file.write(f"{now:.6f} {way} {text}\n")
            if now - self._flushed >= _SYNC:
                self._file.flush()
                self._flushed = now
        except OSError as error:
            self._failed = True
            self._on_failure(f"the log cannot be written ({error.strerror}); going on without")

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._file.close()


def read_log(path: Path) -> list[tuple[float, str, bytes]]:
    """Time, way and bytes of each entry. Raises `InputError` for what is no log."""
    entries = []
    try:
        for line in path.read_text(encoding="ascii").splitlines():
            time, way, text = line.split(" ", 2)
            data = text.encode("ascii").decode("unicode_escape").encode("latin-1")
            if way not in "<>":
                raise ValueError(way)
            entries.append((float(time), way, data))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise InputError(
            f"{path}, line {len(entries) + 1}: is no entry of a stream's log"
        ) from None
    return entries
