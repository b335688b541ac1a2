"""Programs that are traced and compiled once: later runs of the command line load them as they are.

JAX keeps what it compiled between runs, but each run has to trace its functions anew to find it
again, which takes longer than the steps of a short design. Here a program is found by what its
function was given.
"""

import hashlib
import io
import os
import pickle
import platform
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, partial, wraps
from importlib.metadata import version
from pathlib import Path
from tempfile import NamedTemporaryFile
from types import FunctionType
from typing import Any, ClassVar, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jax.experimental.compilation_cache.compilation_cache import reset_cache
from jax.experimental.serialize_executable import deserialize_and_load, serialize
from jaxlib.lapack import prepare_lapack_call

_LIBRARIES = "jax", "jaxlib", "equinox", "lineax", "optimistix", "jaxtyping", "numpy"
"""Their functions and classes are known by their names and the library's version."""

_MOST = 200_000_000
"""Bytes in the folder; of more, what was used least lately goes."""

_OPTIONS = "jax_enable_x64", "jax_default_matmul_precision", "jax_disable_most_optimizations"
"""Of JAX, that are set within programs."""

_LAPACK = "lapack_"
"""How functions that compiled code may call are named: the rest may be anywhere in a process."""

_DIGEST = hashlib.sha256().digest_size

_READY = 64
"""Programs that are held ready."""

_UNKNOWN = pickle.PicklingError, TypeError, AttributeError
"""What is raised where something cannot be pickled."""

P = ParamSpec("P")
R = TypeVar("R")
Numbers = list[jax.Array]


class _Kept:
    folder: Path | None = None
    ready: ClassVar[dict[Any, Callable[[Numbers], Any]]] = {}


def keep(folder: Path | None) -> None:
    """Keep programs in this folder from now on, and take from there what it has; None ends that."""
    _Kept.folder = folder
    _Kept.ready.clear()


def program(function: Callable[P, R]) -> Callable[P, R]:
    """`function` compiled, as by `equinox.filter_jit`.

    JAX arrays among its arguments, trees of any kind, are traced; all else is part of the program.
    It is kept if `keep` was called, but not where functions or classes of other packages are part
    of it, as a term of one's own is, since their code may change.
    """
    by_jax = eqx.filter_jit(function)

    @wraps(function)
    def call(*given: P.args, **named: P.kwargs) -> R:
        if _Kept.folder is None:
            return by_jax(*given, **named)
        form, arrays = _apart((given, named))
        if any(isinstance(each, Tracer) for each in arrays):
            return by_jax(*given, **named)
        key = function, form, tuple(map(_kind, arrays))
        try:
            known = _Kept.ready.get(key)
        except TypeError:  # what cannot be hashed
            return by_jax(*given, **named)
        if known is None:
            if len(_Kept.ready) == _READY:
                del _Kept.ready[next(iter(_Kept.ready))]
            known = _found(function, form, arrays, _Kept.folder)
            _Kept.ready[key] = known = known or partial(_called, by_jax, form)
        return known(arrays)

    return call


class _Array:
    """In the place of an array in a tree."""


class _Form(NamedTuple):
    """A tree without its arrays: leaves, `_Array` for each array, their types, structure."""

    leaves: tuple[Any, ...]
    types: tuple[type, ...]
    structure: Any

    def whole(self, arrays: Sequence[Any]) -> Any:
        """The tree with these arrays."""
        rest = iter(arrays)
        leaves = [next(rest) if leaf is _Array else leaf for leaf in self.leaves]
        return jax.tree.unflatten(self.structure, leaves)

    @property
    def hollow(self) -> Any:
        """The tree with `_Array` in the place of each array."""
        return jax.tree.unflatten(self.structure, self.leaves)


def _apart(tree: Any) -> tuple[_Form, Numbers]:
    leaves, structure = jax.tree.flatten(tree)
    arrays = [leaf for leaf in leaves if eqx.is_array(leaf)]
    fixed = tuple(_Array if eqx.is_array(leaf) else leaf for leaf in leaves)
    return _Form(fixed, tuple(map(type, fixed)), structure), arrays


def _called(function: Callable[..., Any], form: _Form, arrays: Sequence[Any]) -> Any:
    given, named = form.whole(arrays)
    return function(*given, **named)


def _kind(array: jax.Array) -> tuple[Any, ...]:
    return array.shape, str(array.dtype), getattr(array, "weak_type", False)


def _found(
    function: Callable[..., Any], form: _Form, arrays: Numbers, folder: Path
) -> Callable[[Numbers], Any] | None:
    """The program of these arguments, as the folder has it, or else made and put there; None where
    it cannot be kept.
    """
    name = _name(function, form, arrays)
    if name is None:
        return None
    try:
        result, code = pickle.loads(_taken(folder / name))
        compiled = _loaded(folder / code)
    # A file may be of any state; whatever is wrong with it, it is made anew.
    except Exception:
        made = _made(function, form, arrays, folder)
        if made is None:
            return None
        result, code, compiled = made
        _put(folder / name, (result, code))
    result, _ = _apart(result)
    return lambda numbers: result.whole(compiled(numbers))


def _name(function: Callable[..., Any], form: _Form, arrays: Numbers) -> str | None:
    """The same for arguments that make the same program; None where that cannot be told."""
    if jax.default_backend() != "cpu" or jax.device_count() != 1:
        return None
    told = io.BytesIO()
    what = function.__module__, function.__qualname__, form.hollow, list(map(_kind, arrays))
    try:
        _Telling(told, pickle.HIGHEST_PROTOCOL).dump(what)
    except _UNKNOWN:
        return None
    beside = (_surroundings() + _code()).encode()
    return hashlib.sha256(beside + told.getvalue()).hexdigest()


class _Telling(pickle.Pickler):
    """Refuses functions and classes whose code may change unseen."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, (type, FunctionType)):
            package = obj.__module__.partition(".")[0]
            if package not in ("fdjax", *_LIBRARIES, *sys.stdlib_module_names):
                raise pickle.PicklingError(f"{obj.__qualname__} is not known")
        return NotImplemented


@cache
def _versions() -> list[str]:
    return [version(name) for name in _LIBRARIES]


def _surroundings() -> str:
    """What compiled code depends on beside what was traced: versions, options, the processor."""
    given = sorted(each for each in os.environ.items() if each[0].startswith(("JAX_", "XLA_")))
    options = [jax.config.values[name] for name in _OPTIONS]
    return repr((sys.version, _versions(), given, options, _processor()))


@cache
def _code() -> str:
    """What tracing depends on beside arguments: when which file was changed."""
    files = ((path, path.stat()) for path in sorted(Path(__file__).parent.rglob("*.py")))
    return repr([(str(path), state.st_mtime_ns, state.st_size) for path, state in files])


@cache
def _processor() -> str:
    """What instructions it has."""
    with suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as told:
        for line in told:
            if line.startswith(("flags", "Features")):
                return line
    return platform.processor()


def _made(
    function: Callable[..., Any], form: _Form, arrays: Numbers, folder: Path
) -> tuple[Any, str, Any] | None:
    """What the function gives without its arrays, the name of its code in the folder, and that as
    a function of the arrays; None where it calls functions of this process.
    """
    result: list[_Form] = []

    def flat(numbers: Numbers) -> Numbers:
        given, traced = _apart(_called(function, form, numbers))
        result.append(given)
        return traced

    flat.__name__ = function.__name__
    # All arguments are in the text, used or not, or it would not tell which of them are.
    lowered = jax.jit(flat, keep_unused=True).lower(arrays)
    text = f"{function.__qualname__} {list(map(_kind, arrays))} {lowered.as_text()}"
    called = set(re.findall(r"custom_call @(\w+)", text))
    if not all(name.startswith(_LAPACK) for name in called):
        return None
    code = hashlib.sha256((_surroundings() + text).encode()).hexdigest()
    try:
        # Other arguments, or other versions of this code, may come to the same.
        compiled = _loaded(folder / code)
    except Exception:
        compiled = _compiled(lowered)
        # What JAX raises for programs that it cannot write, as those that hold arrays of their own.
        with suppress(ValueError, NotImplementedError):
            _put(folder / code, (bool(called), serialize(compiled)))
    return result[-1].hollow, code, compiled


def _loaded(path: Path) -> Any:
    solves, compiled = pickle.loads(_taken(path))
    if solves:
        prepare_lapack_call("potrf_ffi", np.dtype(float))  # else its functions are at no address
    return deserialize_and_load(*compiled)


def _compiled(lowered: Any) -> Any:
    # What JAX's own folder has (0.10.2) lacks parts when it is written once more.
    before = jax.config.values["jax_enable_compilation_cache"]
    jax.config.update("jax_enable_compilation_cache", False)
    reset_cache()
    try:
        return lowered.compile()
    finally:
        jax.config.update("jax_enable_compilation_cache", before)
        reset_cache()


def _taken(path: Path) -> bytes:
    """What `_put` wrote, byte by byte: of other bytes a program may be anything."""
    whole = path.read_bytes()
    told, value = whole[:_DIGEST], whole[_DIGEST:]
    if hashlib.sha256(value).digest() != told:
        raise ValueError(f"{path} is damaged")
    with suppress(OSError):
        os.utime(path)
    return value


def _put(path: Path, value: Any) -> None:
    # Where the folder or the value cannot be written the next run makes it again.
    with suppress(OSError, *_UNKNOWN):
        whole = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
        path.parent.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(hashlib.sha256(whole).digest() + whole)
        os.replace(file.name, path)
        kept = [(each, each.stat()) for each in path.parent.iterdir()]
        size = 0
        for each, state in sorted(kept, key=lambda pair: -pair[1].st_mtime_ns):
            size += state.st_size
            if size > _MOST:
                each.unlink()
