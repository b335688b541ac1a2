"""The room of centre lines in a part: its areas, its planes and its walls."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from outlines import OUTLINES

from fdjax.errors import InputError
from fdjax.part.part import Part
from fdjax.road.room import Room

RING = OUTLINES["ring"]()
PLATE = shapely.box(0, 0, 30, 20)
MARGINS = np.array([0.15, 0.275, 0.4])


def room_of(part, margins=MARGINS, *, side=1.7, thickness=1.0, flat=False):
    return Room.of(part, margins, side=side, thickness=thickness, flat=flat)


@pytest.mark.parametrize("name", ["ring", "L", "star"])
def test_areas_at_each_margin_are_those_of_the_inset_region(name):
    part = Part.plate(OUTLINES[name](), layers=4)
    room = room_of(part, flat=True)
    assert room.area.shape == (3, len(room.x), len(room.y), 1)
    for margin, area in zip(MARGINS, room.area, strict=True):
        assert area.sum() == pytest.approx(part.regions[0].inset(margin).area, rel=1e-9)


def test_between_margins_the_area_of_a_rectangle_is_exact():
    """It is a parabola of the margin in corner cells, and a line or constant in all others."""
    part = Part.plate(PLATE, layers=4)
    room = room_of(part, flat=True)
    for margin in (0.2, 0.33):
        exact = room_of(part, np.array([margin]), flat=True).area_at(margin)
        np.testing.assert_allclose(room.area_at(margin), exact, atol=1e-12)
    slope = jax.grad(lambda margin: room.area_at(margin).sum())(jnp.asarray(0.3))
    assert float(slope) == pytest.approx(-2 * (30 + 20 - 4 * 0.3), rel=1e-9)
    # A margin for each cell says the same.
    each = np.full(room.area.shape[1:], 0.33)
    np.testing.assert_allclose(room.area_at(each), room.area_at(0.33))


def test_walls_go_once_round_every_ring_and_lie_in_their_cells():
    room = room_of(Part.plate(RING, layers=4), flat=True)
    inside = RING.buffer(-0.275, join_style="mitre")
    assert np.hypot(*room.along.T).sum() == pytest.approx(inside.length, rel=1e-6)
    np.testing.assert_allclose(room.along.sum(0), 0, atol=1e-9)
    i, j, k = room.cell.T
    assert not k.any()
    # The middle of a cell is no further from the wall in it than half a diagonal.
    middles = shapely.points(room.x[i], room.y[j])
    cell = room.x[1] - room.x[0], room.y[1] - room.y[0]
    assert shapely.distance(inside.boundary, middles).max() <= np.hypot(*cell) / 2 + 1e-9
    assert np.hypot(*room.along.T).max() <= min(cell) + 1e-9


def test_planes_stand_for_all_layers_and_hold_their_mean():
    low, high = PLATE, shapely.box(0, 0, 15, 20)
    part = Part.stack([low] * 4 + [high] * 6, [0.3] * 4 + [0.2] * 6)
    room = room_of(part, np.array([0.2]), thickness=0.8)
    assert room.layers.sum() == len(part.slabs)
    np.testing.assert_array_equal(room.layers, [4, 3, 3])
    assert (room.layers * room.height).sum() == pytest.approx(part.height)
    np.testing.assert_allclose(room.z, [0.6, 1.5, 2.1])
    areas = room.area[0].sum((0, 1))
    np.testing.assert_allclose(areas, [29.6 * 19.6, 14.6 * 19.6, 14.6 * 19.6])
    # Walls of each plane are those of its own region.
    walls = [np.hypot(*room.along[room.cell[:, 2] == k].T).sum() for k in range(3)]
    np.testing.assert_allclose(walls, [2 * (29.6 + 19.6)] + [2 * (14.6 + 19.6)] * 2)
    # One plane over a change of regions holds the mean of its layers.
    (mixed,) = room_of(part, np.array([0.2]), thickness=9.0).area[0].sum((0, 1))
    assert mixed == pytest.approx(0.4 * areas[0] + 0.6 * areas[1])


def test_a_region_without_room_is_refused():
    with pytest.raises(InputError, match="nowhere wide enough"):
        room_of(Part.plate(shapely.box(0, 0, 30, 0.5), layers=2), flat=True)
