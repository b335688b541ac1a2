"""Design needs float64, and JAX's default is float32: say so instead of going wrong."""

import jax.numpy as jnp

from fdjax.errors import InputError


def require_float64() -> None:
    """Raise `InputError` unless JAX computes in float64; the package never switches it itself.

    At coordinates near 100 mm the spacing of float32 is as large as the second differences of a
    fine grid, so no elliptic solve and no gradient of one can be trusted there.
    """
    if jnp.result_type(float) != jnp.float64:
        raise InputError(
            "fdjax designs in float64: call jax.config.update('jax_enable_x64', True) first"
        )
