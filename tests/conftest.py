"""Every test runs in float64."""

import os
from pathlib import Path

# BLAS threads gain nothing on the solver's small blocks and spin on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import pytest
from jax.experimental.compilation_cache import compilation_cache

from fdjax import programs

jax.config.update("jax_enable_x64", True)

# Scripts that are run by hand: they take minutes, and one of them needs SciPy.
collect_ignore = [f"benchmarks/{name}.py" for name in ("accuracy", "designs", "grids", "streaming")]
# Those of other people's programs run in an environment of their own.
collect_ignore += ["machine/clients"]


MAPPINGS = 30_000
"""Of 65,530 pieces of memory that Linux lets a process map by default. Each program that XLA
compiles takes some, and with all tests in one process its compiler was seen to crash."""


@pytest.fixture(scope="module", autouse=True)
def room_for_programs():
    """Programs are not kept from module to module, and those that JAX compiled are forgotten where
    there are very many.
    """
    yield
    programs.keep(None)
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > MAPPINGS:
        jax.clear_caches()


@pytest.fixture(scope="module")
def compiled_once(tmp_path_factory):
    """Whole designs, which take long to compile, share their compiled code between modules.

    It is compiled with few optimisations: there is little to run.
    """
    options = {
        "jax_compilation_cache_dir": str(tmp_path_factory.getbasetemp() / "compiled"),
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
        "jax_disable_most_optimizations": True,
    }
    before = {name: jax.config.values[name] for name in options}
    for name, value in options.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()
    yield
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()
