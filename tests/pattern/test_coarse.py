"""Lattices by which points step together."""

import jax.numpy as jnp
import numpy as np
import pytest

from fdjax.pattern.coarse import Lattice


def test_points_that_all_step_alike_are_moved_alike():
    xy = np.random.default_rng(0).uniform(0, (30, 20), (200, 2))
    lattice = Lattice.over(xy, 4)
    step = jnp.broadcast_to(jnp.array([1.0, -2.0]), (200, 2))
    assert np.asarray(lattice.moved(step)) == pytest.approx(np.asarray(step) * np.ptp(xy[:, 0]) / 4)


def test_what_is_far_from_a_step_stays():
    xy = np.random.default_rng(1).uniform(0, 30, (300, 2))
    step = np.zeros((300, 2))
    step[0] = 1.0
    moved = np.asarray(Lattice.over(xy, 6).moved(jnp.asarray(step)))
    far = np.abs(xy - xy[0]).max(1) > 2 * np.ptp(xy, 0).max() / 6
    assert (moved[far] == 0).all()
    assert (moved[0] > 0).all()
