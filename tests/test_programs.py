"""Programs that are kept between runs."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fdjax import programs
from fdjax.programs import program
from fdjax.target.expression import Expression


@pytest.fixture(autouse=True)
def nothing_kept():
    yield
    programs.keep(None)


@pytest.fixture
def traced(tmp_path):
    """A function that notes in a list each time it is traced; what it makes is kept."""
    programs.keep(tmp_path)
    times = []

    @program
    def function(numbers, shape, *, scale=1.0):
        times.append(scale)
        return {"sum": numbers.sum() * scale, "shape": shape, "none": None}

    function.times = times
    return function


def as_a_new_run(tmp_path):
    programs.keep(tmp_path)
    jax.clear_caches()


def test_a_later_run_traces_nothing(traced, tmp_path):
    first = traced(jnp.arange(3.0), ("a", 2), scale=2.0)
    as_a_new_run(tmp_path)
    again = traced(jnp.arange(3.0) + 1, ("a", 2), scale=2.0)
    assert traced.times == [2.0]
    assert (float(first["sum"]), float(again["sum"])) == (6.0, 12.0)
    assert again["shape"] == ("a", 2)
    assert again["none"] is None


@pytest.mark.parametrize(
    ("numbers", "shape", "scale"),
    [
        (jnp.arange(4.0), "a", 2.0),
        (jnp.arange(3), "a", 2.0),
        (jnp.arange(3.0), "b", 2.0),
        (jnp.arange(3.0), "a", 3.0),
        (jnp.arange(3.0), "a", 2),
    ],
)
def test_what_differs_is_another_program(traced, tmp_path, numbers, shape, scale):
    traced(jnp.arange(3.0), "a", scale=2.0)
    as_a_new_run(tmp_path)
    got = traced(numbers, shape, scale=scale)
    assert len(traced.times) == 2
    assert got["shape"] == shape
    np.testing.assert_allclose(got["sum"], numbers.sum() * scale)


def test_arguments_that_are_not_used_make_other_programs(tmp_path):
    programs.keep(tmp_path)
    picked = program(lambda which, a, b: (a, b)[which] * 2)
    one, two = jnp.arange(3.0), jnp.arange(3.0) + 5
    for first, second in ((one, two), (one, jnp.arange(4.0)), (two, one)):
        for which in (0, 1):
            as_a_new_run(tmp_path)
            expected = (first, second)[which] * 2
            np.testing.assert_array_equal(picked(which, first, second), expected)


def test_lapack_is_found_again(tmp_path):
    programs.keep(tmp_path)
    root = program(jnp.linalg.cholesky)
    matrix = jnp.array([[4.0, 2.0], [2.0, 5.0]])
    first = root(matrix)
    as_a_new_run(tmp_path)
    np.testing.assert_allclose(root(matrix), first)
    np.testing.assert_allclose(first, [[2.0, 0.0], [1.0, 2.0]])


@pytest.mark.parametrize("damage", [lambda whole: whole[:-50], lambda whole: whole[:-1] + b"?"])
def test_a_damaged_file_is_made_anew(traced, tmp_path, damage):
    traced(jnp.arange(3.0), "a")
    for path in tmp_path.iterdir():
        path.write_bytes(damage(path.read_bytes()))
    as_a_new_run(tmp_path)
    assert float(traced(jnp.arange(3.0), "a")["sum"]) == 3.0
    as_a_new_run(tmp_path)
    traced(jnp.arange(3.0), "a")
    assert len(traced.times) == 2


def test_what_jax_itself_kept_is_written_whole(traced, tmp_path):
    """JAX 0.10.2 loses functions of programs from its own folder as they are written again."""
    options = {
        "jax_compilation_cache_dir": str(tmp_path / "jax"),
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }
    before = {name: jax.config.values[name] for name in options}
    for name, value in options.items():
        jax.config.update(name, value)
    numbers = jnp.linspace(0.0, 1.0, 1000)
    for folder in ("a", "b", "b"):
        as_a_new_run(tmp_path / folder)
        np.testing.assert_allclose(traced(numbers, "a")["sum"], 500.0)
    for name, value in before.items():
        jax.config.update(name, value)


def test_code_from_elsewhere_is_not_kept(tmp_path):
    programs.keep(tmp_path)

    @program
    def called(term, x):
        return term(x)

    assert float(called(own_term, jnp.array(2.0))) == 4.0
    assert float(called(lambda x: 3 * x, jnp.array(2.0))) == 6.0
    assert float(called(partial(own_term), jnp.array(2.0))) == 4.0
    assert not list(tmp_path.iterdir())


def own_term(x):
    return x * x


def test_an_expression_is_known_by_its_text(tmp_path):
    programs.keep(tmp_path)
    times = []

    @program
    def called(formula, x):
        times.append(formula.text)
        return formula(x, 0.0)

    for text in ("x + 1", "x + 1", "x + 2"):
        as_a_new_run(tmp_path)
        called(Expression(text), jnp.array(2.0))
    assert times == ["x + 1", "x + 2"]


def test_what_calls_back_is_not_kept(tmp_path):
    programs.keep(tmp_path)

    @program
    def called(x):
        return jax.pure_callback(
            lambda value: np.asarray(value) + 1, jax.ShapeDtypeStruct((), float), x
        )

    assert float(called(jnp.array(2.0))) == 3.0
    assert not list(tmp_path.iterdir())


def test_within_another_program_it_is_traced(traced):
    gradient = jax.grad(lambda x: traced(x, "a", scale=2.0)["sum"])(jnp.arange(3.0))
    np.testing.assert_allclose(gradient, 2.0)


def test_modules_come_back_as_they_were(tmp_path):
    programs.keep(tmp_path)
    for _ in range(2):
        as_a_new_run(tmp_path)
        linear = program(_identity)(eqx.nn.Identity(), {"a": (jnp.ones(2), "text")})
        assert isinstance(linear[0], eqx.nn.Identity)
        assert linear[1]["a"][1] == "text"


def _identity(*given):
    return given


def test_the_folder_stays_small(traced, tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "_MOST", 60_000)
    for size in range(1, 9):
        traced(jnp.arange(float(size)), "a")
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 60_000


def test_a_folder_that_cannot_be_written_does_no_harm(traced, tmp_path):
    (tmp_path / "file").write_text("")
    programs.keep(tmp_path / "file" / "programs")
    assert float(traced(jnp.arange(3.0), "a")["sum"]) == 3.0
