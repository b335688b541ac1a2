"""Writing one formula for NumPy and JAX arrays alike, without loading JAX."""

import sys
from typing import Any

import numpy as np


def namespace(*values: Any) -> Any:
    """`jax.numpy` if any value is a JAX array or tracer, else `numpy`.

    >>> namespace(1.0, np.ones(3)).__name__
    'numpy'
    """
    jax = sys.modules.get("jax")
    if jax is not None and any(isinstance(value, jax.Array) for value in values):
        return sys.modules["jax.numpy"]
    return np
