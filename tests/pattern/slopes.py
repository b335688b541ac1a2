"""Gradients of an objective beside central differences of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree


def assert_slopes(objective, *, scaled=True):
    """In three directions, forward and reverse, to 1e-6 of the gradient's norm.

    `scaled`: random steps as the optimiser makes them; else each control by itself.
    """
    pattern = objective.pattern
    free, unravel = ravel_pytree(pattern.controls())

    @jax.jit
    def value(free):
        residuals, _ = objective(unravel(free))
        return 1e3 * sum((part**2).sum() for part in jax.tree.leaves(residuals))

    gradient = jax.jit(jax.grad(value))(free)
    norm = float(jnp.linalg.norm(gradient))
    rng = np.random.default_rng(3)
    for _ in range(3):
        way = jnp.asarray(rng.normal(size=free.size))
        if scaled:
            way = ravel_pytree(pattern.scale(unravel(way)))[0]
        way = way / jnp.linalg.norm(way)
        h = 1e-5
        wide = (value(free + 2 * h * way) - value(free - 2 * h * way)) / (4 * h)
        close = (value(free + h * way) - value(free - h * way)) / (2 * h)
        slope = float(4 * close - wide) / 3
        forward = jax.jvp(value, (free,), (way,))[1]
        assert float(gradient @ way) == pytest.approx(slope, abs=1e-6 * norm)
        assert float(forward) == pytest.approx(slope, abs=1e-6 * norm)
