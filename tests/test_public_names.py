"""The names of `import fdjax`: there, and loaded no earlier than needed."""

import subprocess
import sys

import pytest

import fdjax


def test_every_name_is_there():
    for name in fdjax.__all__:
        value = getattr(fdjax, name)
        assert callable(value)
        assert value.__module__.startswith("fdjax.")
    assert set(fdjax.__all__) <= set(dir(fdjax))


def test_other_names_are_not():
    with pytest.raises(AttributeError, match="'fdjax' has no attribute 'tidy'"):
        _ = fdjax.tidy


@pytest.mark.parametrize("first", ["expression", "design"])
def test_design_is_the_function_whatever_came_first(first):
    code = (
        f"import fdjax; fdjax.{first}; import fdjax.target.target; "
        "from fdjax.target import target; assert target.expression is fdjax.expression; "
        "assert fdjax.design.__name__ == 'design' and callable(fdjax.design)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_needs_no_jax_does_not_load_it():
    with_jax = {"design", "Isolines", "Textures", "Curves", "MapLines", "Mesh", "Multiblock"}
    names = [name for name in fdjax.__all__ if name not in with_jax]
    code = (
        "import sys, fdjax; assert not {'numpy', 'jax'} & set(sys.modules); "
        f"[getattr(fdjax, name) for name in {names}]; assert 'jax' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
