"""The formula reader: what it computes, and everything that it must refuse."""

import math
import operator
import string
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.errors import InputError
from fdjax.target.expression import DEEPEST, LONGEST, Expression

X, Y = np.array([0.3, 2.0, 7.5]), np.array([1.1, 0.4, 3.0])


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("1", 1.0),
        ("x", X),
        ("-x + +y", Y - X),
        ("0.1 + 0.4*x/80", 0.1 + 0.4 * X / 80),
        ("2**-x**2", 2.0 ** -(X**2)),
        ("(x - 1)**2 * y", (X - 1) ** 2 * Y),
        ("1 - 2 - 3", -4.0),
        ("sin(x) + cos(y)*tan(1)", np.sin(X) + np.cos(Y) * math.tan(1)),
        ("exp(-x) + log(y)", np.exp(-X) + np.log(Y)),
        ("sqrt(x) + abs(1 - y) + tanh(x)", np.sqrt(X) + abs(1 - Y) + np.tanh(X)),
        ("hypot(x, y)", np.hypot(X, Y)),
        ("atan2(y, x)", np.arctan2(Y, X)),
        ("clip(x, 1, 2*y)", np.clip(X, 1, 2 * Y)),
        ("min(x, y, 1) + max(x, 2)", np.minimum(np.minimum(X, Y), 1) + np.maximum(X, 2)),
        ("where(x < y, pi, 0)", np.where(X < Y, np.pi, 0)),
        (
            "where(0 < x <= 2 and not y == 0.4, 1, 2)",
            np.where((X > 0) & (X <= 2) & (Y != 0.4), 1, 2),
        ),
        ("where(x < 1 or y >= 3, 1, 2)", np.where((X < 1) | (Y >= 3), 1, 2)),
        (
            "  0.65 + 0.1*sin(x/500)\n\t* cos(y/600) ",
            0.65 + 0.1 * np.sin(X / 500) * np.cos(Y / 600),
        ),
    ],
)
def test_computes_what_it_says(text, wanted):
    np.testing.assert_allclose(Expression(text)(X, Y) + 0 * X, wanted + 0 * X, rtol=1e-14)
    with jax.numpy_rank_promotion("raise"):
        got = jax.jit(Expression(text))(jnp.asarray(X), jnp.asarray(Y))
    np.testing.assert_allclose(got + 0 * X, wanted + 0 * X, rtol=1e-14)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "().__class__.__bases__[0].__subclasses__()",
        "x.__class__",
        "x.real",
        "x[0]",
        "[x for x in (1, 2)]",
        "{1: x}",
        "{x}",
        "[x]",
        "(x, y)",
        "x, y",
        "lambda: 1",
        "(lambda x: x)(1)",
        "sin(x)(y)",
        "'text'",
        "f'{x}'",
        "b'x'",
        "...",
        "None",
        "True",
        "where(True, 1, 2)",
        "1j",
        "x if y else 1",
        "(z := 1)",
        "eval(x)",
        "open(x)",
        "getattr(x, y)",
        "sin(*x)",
        "sin(**x)",
        "sin(x=1)",
        "x % 2",
        "x // 2",
        "x @ y",
        "x ^ 2",
        "x << 99",
        "x | y",
        "x & y",
        "~x",
        "not x",
        "x < y",
        "x and y",
        "where(x, 1, 2)",
        "where(x in y, 1, 2)",
        "where(x is y, 1, 2)",
        "where(1 + (x < y), 1, 2)",
        "min(x)",
        "sin()",
        "sin(x, y)",
        "clip(x, 0)",
        "sin",
        "w",
        "xx",
        "pi(2)",
        "x(2)",
        "2(x)",
        "2x",
        "1 +",
        "(1",
        "1)",
        ") + (",
        "1) + (2",
        "x = 1",
        "x; y",
        "import os",
        "yield x",
        "await x",
        "x # comment",
        "x \\",
        "x\0",
        "",
        "   ",
        "1e999",
        "9" * 400,
        "-" * 1900 + "x",
        "(" * 900 + "x" + ")" * 900,
        "x" + "+x" * (DEEPEST + 1),
        "0" + "+x" * LONGEST,
        "sin(" * (DEEPEST + 1) + "x" + ")" * (DEEPEST + 1),
    ],
)
def test_refuses_everything_else_in_one_line(text):
    with pytest.raises(InputError) as caught:
        Expression(text)
    message = str(caught.value)
    assert message.startswith("expression ")
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0.1 + sine(x)", ['unknown function "sine" at column 7', "did you mean sin?"]),
        ("0.1 + 2*X1", ['unknown name "X1" at column 9', "known: x, y, z, pi"]),
        ("0.1 + * x", ["syntax error at column 7"]),
        ("x.shape", ["an attribute (a.b) is not allowed at column 1"]),
        ("x^2", ["a power is written **"]),
        ("1 if x < 2 else 3", ["write where(condition, then, else)"]),
        ("clip(x)", ["clip(value, low, high) is given wrong arguments"]),
        ("x(y + 1)", ["write * to multiply"]),
    ],
)
def test_says_what_is_wrong_and_where(text, words):
    with pytest.raises(InputError) as caught:
        Expression(text)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "text", ["10**10**10**10", "9**9**9**9**9", "1/0", "log(0)", "0/0", "x**1e300"]
)
def test_huge_and_undefined_values_are_quick_and_not_finite(text):
    started = time.perf_counter()
    with np.errstate(all="ignore"):
        assert not np.isfinite(Expression(text)(X + 1, Y)).any()
    assert time.perf_counter() - started < 0.5


def test_is_not_text():
    with pytest.raises(InputError, match="is no text"):
        Expression(0.5)  # type: ignore[arg-type]


def test_cones_keep_finite_gradients_at_their_tip():
    for text in ("sqrt(x**2 + y**2)", "hypot(x, y)"):
        gradient = jax.grad(Expression(text), argnums=(0, 1))(0.0, 0.0)
        np.testing.assert_array_equal(gradient, (0.0, 0.0))
        gradient = jax.grad(Expression(text), argnums=(0, 1))(3.0, 4.0)
        np.testing.assert_allclose(gradient, (0.6, 0.8))


@settings(max_examples=100, deadline=None)
@given(st.text(string.printable + "é∂\u2028\ud800", max_size=40))
def test_no_text_does_anything_but_compute_or_raise_input_error(text):
    try:
        value = Expression(text)
    except InputError:
        return
    with np.errstate(all="ignore"):
        assert np.shape(value(1.0, 2.0)) == ()


def joined(one, sign, other):
    operation = {"+": operator.add, "-": operator.sub, "*": operator.mul}[sign]
    return f"({one[0]} {sign} {other[0]})", operation(one[1], other[1])


def lesser(one, other):
    return f"min({one[0]}, {other[0]})", min(one[1], other[1])


# Each formula with what Python makes of its parts at (0.7, -1.3).
leaves = st.sampled_from(
    [("x", 0.7), ("y", -1.3), ("pi", math.pi), ("1.5", 1.5), ("0.25", 0.25)],
)
formulas = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.builds(joined, inner, st.sampled_from("+-*"), inner),
        inner.map(lambda a: (f"sin({a[0]})", math.sin(a[1]))),
        st.builds(lesser, inner, inner),
    ),
    max_leaves=12,
)


@settings(max_examples=40, deadline=None)
@given(formulas)
def test_agrees_with_python(formula):
    text, wanted = formula
    assert Expression(text)(0.7, -1.3) == pytest.approx(wanted, rel=1e-12, abs=1e-12)
