"""Distances from walls on a lattice, and what of straight pieces lies inside."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely

from fdjax.road.wall_distance import WallDistance, inside

RING = shapely.Point(10, 10).buffer(9, quad_segs=32).difference(shapely.Point(10, 10).buffer(3))
BOX = shapely.box(2, 3, 18, 17)
WALLS = WallDistance.of([RING, BOX], 0.3)


@pytest.mark.parametrize("room", [0, 1])
def test_distances_are_those_of_the_walls(room):
    xy = np.random.default_rng(0).uniform(1, 19, (300, 2))
    geometry = (RING, BOX)[room]
    away = shapely.distance(geometry.boundary, shapely.points(xy))
    away = np.where(shapely.contains_xy(geometry, *xy.T), away, -away)
    got = WALLS.at(jnp.asarray(xy), np.full(300, room))
    assert np.abs(got - away).max() < 0.3 / 2
    # Bilinear: exact where the nearest wall is straight, second order where it bends.
    near = np.abs(away) < 0.5
    assert np.abs(got - away)[near].max() < 0.03


def test_a_piece_is_cut_where_it_crosses_a_wall():
    rng = np.random.default_rng(1)
    start, end = rng.uniform(4, 20, (2, 200, 2))
    start[:, 0] = rng.uniform(14, 17, 200)
    end = start + rng.uniform(-1, 1, (200, 2))
    half = shapely.box(-50, -50, 16, 50)
    before, after = 16 - start[:, 0], 16 - end[:, 0]
    share, middle = inside(*map(jnp.asarray, (start, end, before, after)))
    lines = shapely.linestrings(np.stack([start, end], 1))
    within = shapely.intersection(lines, half)
    length = np.hypot(*(end - start).T)
    assert np.asarray(share) * length == pytest.approx(shapely.length(within), abs=1e-9)
    some = shapely.length(within) > 0
    centre = shapely.get_coordinates(shapely.centroid(within[some]))
    assert np.asarray(middle)[some] == pytest.approx(centre, abs=1e-9)


def test_distances_can_be_differentiated():
    xy = jnp.asarray(np.random.default_rng(2).uniform(3, 17, (40, 2)))
    room = np.zeros(40, int)
    way = jnp.asarray(np.random.default_rng(3).normal(size=xy.shape))

    def value(xy):
        return (WALLS.at(xy, room) ** 2).sum()

    h = 1e-6
    slope = (value(xy + h * way) - value(xy - h * way)) / (2 * h)
    assert float((jax.grad(value)(xy) * way).sum()) == pytest.approx(float(slope), rel=1e-6)


def test_far_beyond_a_corner_all_is_outside_and_ever_more_so():
    room = shapely.box(0, 0, 40, 30)
    walls = WallDistance.of([room], 0.3)
    xy = np.stack(np.meshgrid(np.linspace(-8, 48, 57), np.linspace(-8, 38, 47)), -1).reshape(-1, 2)
    got = np.asarray(walls.at(xy, 0))
    away = shapely.distance(room, shapely.points(xy))
    outside = away > 1
    assert (got[outside] < -0.5).all()
    # The way to the lattice's rim and on to the walls bends.
    assert got[outside] == pytest.approx(-away[outside], rel=0.3)
    slope = jax.grad(lambda xy: walls.at(xy, 0).sum())(jnp.asarray(xy))
    assert np.isfinite(slope).all()
