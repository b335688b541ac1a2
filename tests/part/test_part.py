"""Parts: layers from the bed upwards."""

import jax.numpy as jnp
import numpy as np
import pytest
from shapely import MultiPolygon, box

from fdjax.errors import InputError
from fdjax.part.part import Part
from fdjax.part.patch import rectangle

PAIR = MultiPolygon([box(0, 0, 4, 4), box(6, 0, 9, 3)])


def test_a_plate_has_layers_alike():
    part = Part.plate(PAIR, layers=4, height=0.3)
    assert len(part.regions) == 1
    assert part.bounds == (0, 0, 9, 4)
    assert part.volume == pytest.approx(25 * 1.2)
    np.testing.assert_allclose(part.middles, [0.15, 0.45, 0.75, 1.05])
    patch = rectangle(8, 3)
    assert Part.plate(patch).patch is patch


def test_a_stack_keeps_what_is_given_twice_as_one():
    square = box(0, 0, 4, 4)
    part = Part.stack([square, PAIR, square], [0.3, 0.2, 0.1])
    assert [slab.z for slab in part.slabs] == [0.3, 0.5, 0.6]
    assert len(part.regions) == 2
    assert part.slabs[0].region is part.slabs[2].region


def test_bad_parts_are_named():
    with pytest.raises(InputError, match="no layers"):
        Part(())
    with pytest.raises(InputError, match="heights: 1 given for 2 layers"):
        Part.stack([PAIR, PAIR], [0.2])
    with pytest.raises(InputError, match="layer 2: height -1 mm"):
        Part.stack([PAIR, PAIR], [0.2, -1])
    with pytest.raises(InputError, match="heights: 4 given for 2 layers"):
        Part.stack([PAIR, PAIR], [[0.2, 0.2]] * 4)
    with pytest.raises(InputError, match="is no number of mm"):
        Part.stack([PAIR, PAIR], "0.2mm")
    with pytest.raises(InputError, match="is no list of regions"):
        Part.stack(PAIR, 0.2)
    with pytest.raises(InputError, match=r"layers: 2\.5 is no whole number"):
        Part.plate(PAIR, layers=2.5)


def test_heights_and_layers_are_numbers_of_any_library():
    for height in (np.float32(0.25), jnp.asarray(0.25), np.array(0.25)):
        assert Part.stack([PAIR, PAIR], height).height == 0.5
    assert Part.plate(PAIR, layers=np.int64(3), height=np.float32(0.25)).height == 0.75
