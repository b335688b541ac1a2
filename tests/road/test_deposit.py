"""Deposits: volumes of a raster are told as points in the order of its places."""

import jax.numpy as jnp
import numpy as np
import pytest

from fdjax.road.deposit import Raster

X, Y, Z = np.array([1.0, 2.0]), np.array([10.0, 20.0, 30.0]), np.array([0.1, 0.3])


@pytest.mark.parametrize("xp", [np, jnp])
def test_every_volume_keeps_its_place(xp):
    volume = xp.asarray(X[:, None, None] + 100 * Y[:, None] + 1e4 * Z)
    points = Raster(X, Y, Z, volume).points
    assert points.xyz.shape == (12, 3)
    np.testing.assert_allclose(points.xyz @ np.array([1, 100, 1e4]), points.volume)
    assert len(np.unique(points.xyz, axis=0)) == 12
