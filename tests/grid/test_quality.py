"""Quality measures of lattices whose quality is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grid_samples import chevron, transfinite

from fdjax.grid.quality import quality


def lattice(x, y):
    return np.stack(np.meshgrid(x, y, indexing="ij"), -1).astype(float)


def test_a_slanted_lattice_has_its_angle_everywhere():
    slanted = lattice(range(5), range(4)) @ np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
    found = quality(slanted)
    assert found.scaled_jacobian == pytest.approx(np.sin(np.pi / 3))
    assert found.inverted == 0
    assert found.angle_mean == pytest.approx(30)
    assert found.angle_worst == pytest.approx(30)
    assert found.skew == pytest.approx(1 / 3)
    assert found.aspect == pytest.approx(1)
    assert found.growth == pytest.approx(1)


def test_sides_and_steps_are_compared():
    found = quality(lattice([0, 1, 3, 7], [0, 0.5, 1]))
    assert found.aspect == pytest.approx(8)
    assert found.growth == pytest.approx(2)
    assert found.scaled_jacobian == pytest.approx(1)


def test_a_corner_turned_inside_out_is_counted():
    r = lattice(range(4), range(4))
    r[1, 1] = 2.5, 2.5
    found = quality(r)
    assert found.scaled_jacobian < 0
    assert 1 <= found.inverted <= 4
    assert found.angle_worst > 90
    assert found.skew == 1
    assert quality(r[::-1]).inverted == 9


def test_numpy_and_jax_agree_and_gradients_are_central_differences():
    random = np.random.default_rng(1)
    # Moved a little, so that no two places are worst alike.
    r = transfinite(chevron(), (7, 6))
    r = r + random.normal(size=r.shape, scale=0.1)
    way = random.normal(size=r.shape)
    for name in ("scaled_jacobian", "angle_mean", "angle_worst", "skew", "aspect", "growth"):

        def value(nodes, name=name):
            return getattr(quality(nodes), name)

        assert float(jax.jit(value)(jnp.asarray(r))) == pytest.approx(float(value(r)))
        slope = (value(r + 1e-6 * way) - value(r - 1e-6 * way)) / 2e-6
        gradient = np.asarray(jax.jit(jax.grad(value))(jnp.asarray(r)))
        assert (gradient * way).sum() == pytest.approx(slope, rel=1e-5, abs=1e-9), name
