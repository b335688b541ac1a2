"""Arithmetic in x, y and z, read from text without ever running it as Python."""

import ast
import difflib
import math
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

from fdjax.arrays import namespace
from fdjax.errors import InputError

Place = tuple[Any, Any, Any]
"""x, y and z."""
Evaluator = Callable[[Place, Any], Any]
"""(place, array namespace) -> value."""

LONGEST = 2000
"""Characters that an expression may have."""
DEEPEST = 200
"""Levels to which it may be nested; a sum of n terms counts as n."""

_OPERATORS: dict[type, str] = {
    ast.Add: "add",
    ast.Sub: "subtract",
    ast.Mult: "multiply",
    ast.Div: "divide",
    ast.Pow: "power",
}
_COMPARISONS: dict[type, str] = {
    ast.Lt: "less",
    ast.LtE: "less_equal",
    ast.Gt: "greater",
    ast.GtE: "greater_equal",
    ast.Eq: "equal",
    ast.NotEq: "not_equal",
}
_BOOLEANS: dict[type, str] = {ast.And: "logical_and", ast.Or: "logical_or"}
_NAMES: dict[str, Evaluator] = {
    "x": lambda at, xp: at[0],
    "y": lambda at, xp: at[1],
    "z": lambda at, xp: at[2],
    "pi": lambda at, xp: math.pi,
}


def _root(value: Any, xp: Any) -> Any:
    """Square root whose derivative at 0 is 0: one point on a cone's tip spoils no gradient."""
    zero = xp.equal(value, 0.0)
    return xp.where(zero, 0.0, xp.sqrt(xp.where(zero, 1.0, value)))


def _plain(name: str) -> Callable[..., Any]:
    return lambda values, xp: getattr(xp, name)(*values)


def _folded(name: str) -> Callable[..., Any]:
    return lambda values, xp: reduce(getattr(xp, name), values)


_FUNCTIONS: dict[str, tuple[str, Callable[..., Any]]] = {
    "sin": ("a", _plain("sin")),
    "cos": ("a", _plain("cos")),
    "tan": ("a", _plain("tan")),
    "exp": ("a", _plain("exp")),
    "log": ("a", _plain("log")),
    "tanh": ("a", _plain("tanh")),
    "abs": ("a", _plain("abs")),
    "sqrt": ("a", lambda values, xp: _root(values[0], xp)),
    "hypot": ("a, b", lambda values, xp: _root(values[0] * values[0] + values[1] * values[1], xp)),
    "atan2": ("y, x", _plain("arctan2")),
    "clip": ("value, low, high", _plain("clip")),
    "min": ("a, b, ...", _folded("minimum")),
    "max": ("a, b, ...", _folded("maximum")),
    "where": ("condition, then, else", _plain("where")),
}


@dataclass(frozen=True)
class Expression:
    """A formula in x, y and z, callable on NumPy and JAX arrays alike.

    Allowed are numbers, `x`, `y`, `z`, `pi`, `+ - * / **`, brackets, and the functions sin, cos,
    tan, exp, log (natural), sqrt, abs, tanh, hypot(a, b), atan2(y, x), clip(value, low, high),
    min, max (two or more) and where(condition, then, else); a condition is built of
    comparisons with `and`, `or`, `not`. Anything else raises `InputError`. The text is parsed,
    never executed. `sqrt` and `hypot` have derivative 0 at 0; `where` computes both branches.

    >>> float(Expression("max(x, 0) / 80")(40.0, 0.0))
    0.5
    """

    text: str
    _value: Evaluator = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.text, str):
            raise InputError(f"expression: {self.text!r} is no text; write it like '0.1 + 0.4*x'")
        text = " ".join(self.text.split())
        object.__setattr__(self, "text", text)
        object.__setattr__(self, "_value", _Reader(text).read())

    def __reduce__(self) -> Any:
        # All else follows from the text, and is of functions that cannot be pickled.
        return Expression, (self.text,)

    def __call__(self, x: Any, y: Any, z: Any = 0.0) -> Any:
        """The value at x, y and z, which broadcast against each other."""
        return self._value((x, y, z), namespace(x, y, z))

    @property
    def varies_in_z(self) -> bool:
        """Whether the formula has a z in it."""
        return re.search(r"\bz\b", self.text) is not None


@dataclass(frozen=True)
class _Reader:
    """Turns the text into nested functions; what it has no method for is not allowed."""

    text: str

    def read(self) -> Evaluator:
        if not self.text:
            raise self.error("is empty")
        if len(self.text) > LONGEST:
            raise self.error(f"is longer than {LONGEST} characters")
        if "#" in self.text:
            raise self.error(f"syntax error at column {self.text.index('#') + 1}")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                tree = ast.parse(self.text, mode="eval")
        except SyntaxError as fault:
            raise self.error(f"syntax error at column {fault.offset or 1}") from None
        except (ValueError, RecursionError, MemoryError):
            raise self.error("cannot be read: odd characters or nested too deeply") from None
        return self.value(tree.body, DEEPEST)

    def error(self, what: str, node: ast.expr | None = None) -> InputError:
        place = "" if node is None else f" at column {node.col_offset + 1}"
        shown = self.text if len(self.text) <= 80 else self.text[:77] + "..."
        return InputError(f'expression "{shown}": {what}{place}')

    def unknown(self, kind: str, name: str, known: list[str], node: ast.expr) -> InputError:
        near = difflib.get_close_matches(name, known, 1, 0.0)[0]
        error = self.error(f'unknown {kind} "{name}"', node)
        return InputError(f"{error} (did you mean {near}? known: {', '.join(known)})")

    def value(self, node: ast.expr, depth: int) -> Evaluator:
        if depth == 0:
            raise self.error(f"is nested deeper than {DEEPEST} levels")
        match node:
            case ast.Constant():
                return self.number(node)
            case ast.Name():
                if node.id in _FUNCTIONS:
                    raise self.error(f'"{node.id}" is a function and wants arguments', node)
                if node.id not in _NAMES:
                    raise self.unknown("name", node.id, list(_NAMES), node)
                return _NAMES[node.id]
            case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=inner):
                operand = self.value(inner, depth - 1)
                if isinstance(node.op, ast.UAdd):
                    return operand
                return lambda at, xp: xp.negative(operand(at, xp))
            case ast.BinOp(op=op) if type(op) in _OPERATORS:
                return self.binary(node, _OPERATORS[type(op)], depth)
            case ast.BinOp(op=ast.BitXor()):
                raise self.error('"^" is not allowed (a power is written **)', node)
            case ast.Call():
                return self.call(node, depth)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                raise self.error("a condition stands only first in where(...)", node)
            case _:
                raise self.error(f"{_described(node)} is not allowed", node)

    def number(self, node: ast.Constant) -> Evaluator:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise self.error(f"{_described(node)} is not allowed", node)
        try:
            number = float(node.value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.error("number too large", node)
        return lambda at, xp: number

    def binary(self, node: ast.BinOp, name: str, depth: int) -> Evaluator:
        left = self.value(node.left, depth - 1)
        right = self.value(node.right, depth - 1)
        return lambda at, xp: getattr(xp, name)(left(at, xp), right(at, xp))

    def call(self, node: ast.Call, depth: int) -> Evaluator:
        if not isinstance(node.func, ast.Name):
            raise self.error(f"calling {_described(node.func)} is not allowed", node)
        name = node.func.id
        if name not in _FUNCTIONS:
            kind = "function" if name not in _NAMES else "function (write * to multiply)"
            raise self.unknown(kind, name, list(_FUNCTIONS), node)
        signature, function = _FUNCTIONS[name]
        wanted, got = signature.split(", "), len(node.args)
        many = wanted[-1] == "..."
        if node.keywords or (got < len(wanted) - 1 if many else got != len(wanted)):
            raise self.error(f"{name}({signature}) is given wrong arguments", node)
        readers = [self.value] * got
        if name == "where":
            readers[0] = self.condition
        parts = [read(part, depth - 1) for read, part in zip(readers, node.args, strict=True)]
        return lambda at, xp: function([part(at, xp) for part in parts], xp)

    def condition(self, node: ast.expr, depth: int) -> Evaluator:
        if depth == 0:
            raise self.error(f"is nested deeper than {DEEPEST} levels")
        match node:
            case ast.Compare():
                return self.comparison(node, depth)
            case ast.BoolOp():
                parts = [self.condition(part, depth - 1) for part in node.values]
                name = _BOOLEANS[type(node.op)]
                return lambda at, xp: reduce(getattr(xp, name), [p(at, xp) for p in parts])
            case ast.UnaryOp(op=ast.Not(), operand=inner):
                operand = self.condition(inner, depth - 1)
                return lambda at, xp: xp.logical_not(operand(at, xp))
            case _:
                raise self.error("where(...) wants a comparison first, as in x < 40", node)

    def comparison(self, node: ast.Compare, depth: int) -> Evaluator:
        for op in node.ops:
            if type(op) not in _COMPARISONS:
                raise self.error("comparisons are < <= > >= == != only", node)
        names = [_COMPARISONS[type(op)] for op in node.ops]
        parts = [self.value(part, depth - 1) for part in (node.left, *node.comparators)]

        def compare(at: Place, xp: Any) -> Any:
            v = [part(at, xp) for part in parts]
            pairs = zip(names, v[:-1], v[1:], strict=True)
            return reduce(xp.logical_and, [getattr(xp, name)(a, b) for name, a, b in pairs])

        return compare


def _described(node: ast.expr) -> str:
    words = {
        "Attribute": "an attribute (a.b)",
        "Subscript": "an index (a[b])",
        "Lambda": "a lambda",
        "JoinedStr": "a string",
        "IfExp": "if ... else (write where(condition, then, else))",
        "Starred": "a starred argument",
        "NamedExpr": "an assignment",
        "Tuple": "a comma outside a function",
        "BinOp": "this operator",
        "UnaryOp": "this operator",
        "Call": "a call",
    }
    if isinstance(node, ast.Constant):
        kinds = {str: "a string", bytes: "a string", complex: "a complex number"}
        return kinds.get(type(node.value), f'"{node.value}"')
    return words.get(type(node).__name__, "this")
