"""A second process that works while this one goes on, on machines with more than one core."""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import IO, Any

from fdjax.errors import InputError


class Beside:
    """Calls functions in a process of its own, one after the other, within a `with` block.

    The end of the block waits for what was asked, and raises the first `InputError` that nobody
    was told of yet. What is still to be done when the block fails is left undone.
    """

    def __init__(self, *modules: str) -> None:
        """`modules` are loaded there before anything is asked for."""
        self._modules = modules
        self._process: subprocess.Popen[bytes] | None = None
        self._open: list[_Answer] = []

    def __enter__(self) -> "Beside":
        # A program that lasts has loaded all already: a second process would gain it nothing.
        if "matplotlib.figure" not in sys.modules:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, *self._modules],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                # An interrupt is the command's to deal with.
                start_new_session=True,
            )
        return self

    @property
    def shares(self) -> bool:
        """Whether there is a second process; else what is asked for is done at once, here."""
        return self._process is not None

    def ask(self, function: str, *arguments: Any, **options: Any) -> Callable[[], Any]:
        """Have `function`, as "module:name", called; returns what waits for its value.

        What waits raises the function's `InputError`, if it does. Values of more than a pipe holds
        must be waited for before the next is asked for.
        """
        if self._process is None:
            value = _called(function, arguments, options)
            return lambda: value
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # told of by who waits
            call = function, arguments, options
            pickle.dump(call, self._process.stdin, pickle.HIGHEST_PROTOCOL)
            self._process.stdin.flush()
        answer = _Answer(self)
        self._open.append(answer)
        return answer

    def receive(self, until: "_Answer | None" = None) -> None:
        """Take in answers in the order in which they were asked for, up to this one or all."""
        assert self._process is not None
        assert self._process.stdout is not None
        while self._open and (until is None or until in self._open):
            try:
                self._open[0].come = pickle.load(self._process.stdout)
            except EOFError:
                self._process.kill()
                ended = self._process.wait()
                raise RuntimeError(f"the process beside ended with {ended}") from None
            self._open.pop(0)

    def __exit__(self, fault: type[BaseException] | None, *_: object) -> None:
        if self._process is None:
            return
        with self._process as process:
            if fault is not None:
                process.kill()
                return
            untold = list(self._open)
            self.receive()
        for answer in untold:
            answer()


class _Answer:
    """What a function that was asked for gives, once it has come."""

    def __init__(self, beside: Beside) -> None:
        self._beside = beside
        self.come: tuple[InputError | None, Any] | None = None

    def __call__(self) -> Any:
        if self.come is None:
            self._beside.receive(self)
        assert self.come is not None
        fault, value = self.come
        if fault is not None:
            raise fault
        return value


def _called(function: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> Any:
    module, _, name = function.partition(":")
    return getattr(import_module(module), name)(*arguments, **options)


def _serve(modules: list[str], asked: IO[bytes], answers: IO[bytes]) -> None:
    """Call what is asked for until the other end closes."""
    for module in modules:
        import_module(module)
    with suppress(EOFError):
        while True:
            call = pickle.load(asked)
            try:
                answer = None, _called(*call)
            except InputError as fault:
                answer = fault, None
            pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
            answers.flush()


if __name__ == "__main__":
    _serve(sys.argv[1:], sys.stdin.buffer, sys.stdout.buffer)
    # Somebody waits for the end: what was loaded need not be taken apart first.
    os._exit(0)
