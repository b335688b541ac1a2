"""Functions of the place: of x and y, or of x, y and z."""

from collections.abc import Callable
from dataclasses import dataclass
from inspect import Parameter, signature
from typing import Any


@dataclass(frozen=True, eq=False)
class Field:
    """A function of x, y and z, also where the one behind it knows no z.

    - `function`: of x and y, and of z if `takes_z`.
    - `varies_in_z`: whether its values may depend on z.
    """

    function: Callable[..., Any]
    takes_z: bool
    varies_in_z: bool

    def __call__(self, x: Any, y: Any, z: Any = 0.0) -> Any:
        return self.function(x, y, z) if self.takes_z else self.function(x, y)


def field_of(function: Callable[..., Any]) -> Field:
    """The field of a function, from a look at its signature.

    It takes z if it needs a third argument or calls its third one z. What has an attribute
    `varies_in_z`, as `Target` and `Expression`, says itself whether its values depend on z.

    >>> field_of(lambda x, y: x + y).varies_in_z, field_of(lambda x, y, z: z)(1, 2, 3)
    (False, 3)
    """
    takes_z = _takes_z(function)
    return Field(function, takes_z, bool(getattr(function, "varies_in_z", takes_z)))


def _takes_z(function: Callable[..., Any]) -> bool:
    try:
        parameters = signature(function).parameters.values()
    except (TypeError, ValueError):  # some built-in functions have no signature
        return False
    kinds = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    third = [parameter for parameter in parameters if parameter.kind in kinds][2:3]
    return any(p.default is Parameter.empty or p.name == "z" for p in third)
