"""An output folder that is never left half-written."""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fdjax.errors import DesignError, InputError


@contextmanager
def output_folder(path: str | Path, *, owned: Iterable[str] = ()) -> Iterator[Path]:
    """A temporary folder whose files move into `path` at the end.

    They move when the block ends well, and when it raises `DesignError`: then they are the report
    of what failed. On any other exception nothing is left behind and `path` is as before. `owned`
    names the files that the block may write: those that it did not write this time are removed
    from `path`, so that no machine file of an earlier run lies beside a newer report. Other files
    in `path` stay.

    Raises `InputError` on entering if `path` is a file or cannot be made or written, and at the
    end if a file cannot be moved. The temporary folder is made in `path` if that exists, else in
    its nearest parent that does, so that moving is a rename.
    """
    path = Path(path)
    home = next(p for p in (path.absolute(), *path.absolute().parents) if os.path.lexists(p))
    try:
        if not os.access(home, os.W_OK):
            raise PermissionError(0, f"no permission to write in {home}")
        temporary = Path(tempfile.mkdtemp(prefix=".fdjax-", dir=home))
    except NotADirectoryError:
        raise InputError(f"output folder {path}: {home} is no folder") from None
    except OSError as fault:
        raise InputError(f"output folder {path}: cannot be written: {fault.strerror}") from None
    try:
        try:
            yield temporary
        except DesignError:
            _move(temporary, path, owned)
            raise
        _move(temporary, path, owned)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _move(temporary: Path, path: Path, owned: Iterable[str]) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
        files = sorted(temporary.iterdir())
        for name in set(owned) - {file.name for file in files}:
            (path / name).unlink(missing_ok=True)
        for file in files:
            os.replace(file, path / file.name)
    except OSError as fault:
        raise InputError(f"output folder {path}: cannot be written: {fault.strerror}") from None
