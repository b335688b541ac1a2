"""Jacobi's first theta function on a strip, from its product; its logarithm, of one branch."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

FACTORS = 6
"""Of the product: with the smaller of two nomes, what follows is below rounding."""


def log_theta(s: Array, span: Array, *, outer: Array) -> Array:
    """log theta_1(s / 2i), of nome exp(-span), up to a constant and of one branch on the strip.

    - `s`: s - s_k, s in the strip between -span and 0; `outer`: whether s_k lies on its right side.
    """
    turns = jnp.round(s.imag / (2 * np.pi))
    s = s - 2j * np.pi * turns
    # theta_1 is odd.
    s, turn = jnp.where(outer, -s, s), jnp.where(outer, -np.pi, np.pi) * turns

    def wide(s: Array) -> Array:
        factor = _product(jnp.exp(s) + jnp.exp(-s), span)
        return s / 2 + jnp.log(_one_less(-s) * factor)

    def thin(s: Array) -> Array:
        # Jacobi's imaginary transformation, for positive imaginary parts; others are conjugates.
        below = s.imag < 0
        place = np.pi / span * jnp.where(below, s.conj(), s)
        factor = _product(jnp.exp(1j * place) + jnp.exp(-1j * place), np.pi**2 / span)
        logs = -0.5j * place + jnp.log(_one_less(1j * place) * factor) + 0.5j * np.pi
        return s**2 / (4 * span) + jnp.where(below, logs.conj(), logs)

    return jax.lax.cond(span > np.pi, wide, thin, s) + 1j * turn


def log_size(gap: Array, span: Array, *, same: np.ndarray) -> Array:
    """Real part of `log_theta` from wall to wall, `gap` apart around; `same`: of the same wall."""
    # Beyond a half turn the other way round is shorter.
    gap = jnp.abs(gap)
    gap = jnp.minimum(gap, jnp.abs(2 * np.pi - gap))

    def wide(gap: Array) -> Array:
        factor = jnp.where(same, 2 * jnp.sin(gap / 2), 1.0)
        factor = factor * _product(2 * jnp.cos(gap), span, jnp.where(same, 0.0, span))
        return jnp.where(same, 0.0, span / 2) + jnp.log(factor)

    def thin(gap: Array) -> Array:
        y = np.pi * gap / span
        factor = jnp.where(same, -jnp.expm1(-y), 1 + jnp.exp(-y))
        twice = jnp.where(same, 1.0, -1.0) * (jnp.exp(y) + jnp.exp(-y))
        factor = factor * _product(twice, np.pi**2 / span)
        return jnp.where(same, 0.0, span / 4) - gap**2 / (4 * span) + y / 2 + jnp.log(factor)

    return jax.lax.cond(span > np.pi, wide, thin, gap)


def _product(twice: Array, rate: Array, less: Array | float = 0.0) -> Array:
    """`prod_j 1 - q_j twice + q_j^2`, with `q_j = exp(less - 2 j rate)`."""
    factor = jnp.ones_like(twice)
    for j in range(1, FACTORS + 1):
        share = jnp.exp(less - 2 * j * rate)
        factor = factor * (1 - share * twice + share**2)
    return factor


def _one_less(z: Array) -> Array:
    """1 - exp(z), exactly for small z too."""
    x, y = z.real, z.imag
    half = jnp.sin(y / 2)
    return 2 * half**2 - jnp.expm1(x) * jnp.cos(y) - 1j * jnp.exp(x) * jnp.sin(y)
