"""Pictures drawn by a process of their own, while the command that wants them goes on.

Matplotlib takes as long to load as a file of twenty megabytes to be read.
"""

import os
import pickle
import subprocess
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

from fdjax.errors import InputError


class Painter:
    """Draws pictures beside; they are written when its `with` block is left.

    The block's end raises `InputError` for the first picture whose place or kind is at fault. What
    is still to be drawn when the block fails is left out.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "Painter":
        # Where Matplotlib is loaded already, a second process would gain nothing.
        if "matplotlib.figure" not in sys.modules:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                # An interrupt is the command's to deal with.
                start_new_session=True,
            )
        return self

    def draw(self, path: Path, kind: str, *arguments: Any, **options: Any) -> None:
        """Save the figure that the function `kind` of `fdjax.view.figures` makes of the rest."""
        if self._process is None:
            _draw(path, kind, arguments, options)
            return
        assert self._process.stdin is not None
        # That the process has ended is told of when the block is left.
        with suppress(BrokenPipeError):
            picture = path, kind, arguments, options
            pickle.dump(picture, self._process.stdin, pickle.HIGHEST_PROTOCOL)
            self._process.stdin.flush()

    def __exit__(self, fault: type[BaseException] | None, *_: object) -> None:
        if self._process is None:
            return
        with self._process as process:
            if fault is not None:
                process.kill()
                return
            answer: bytes = process.communicate()[0]
        if process.returncode:
            raise RuntimeError(f"pictures: their process ended with {process.returncode}")
        if answer:
            raise InputError(answer.decode())


def _draw(path: Path, kind: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> None:
    from fdjax.view import figures

    figures.save(getattr(figures, kind)(*arguments, **options), path)


def _serve(wanted: BinaryIO, answer: BinaryIO) -> None:
    """Draw what comes until the other end closes; answer with the first fault, if there is any."""
    import_module("fdjax.view.figures")  # while nothing is asked for yet
    faults: list[InputError] = []
    with suppress(EOFError):
        while True:
            picture = pickle.load(wanted)
            try:
                _draw(*picture)
            except InputError as fault:
                faults.append(fault)
    if faults:
        answer.write(str(faults[0]).encode())


if __name__ == "__main__":
    _serve(sys.stdin.buffer, sys.stdout.buffer)
