"""The section of a road: closed forms, its inverse, the join of its two branches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.road.bead import road_width, section_area

lengths = st.floats(0.05, 2.0)


@pytest.mark.parametrize(("width", "height"), [(0.4, 0.2), (0.5, 0.1), (1.2, 0.6)])
def test_a_wide_road_is_a_stadium(width, height):
    core = shapely.LineString([(0, 0), (width - height, 0)])
    drawn = core.buffer(height / 2, quad_segs=200)
    assert section_area(width, height) == pytest.approx(drawn.area, rel=1e-4)
    assert section_area(width, height) == height * (width - height) + np.pi * height**2 / 4


@pytest.mark.parametrize(("width", "height"), [(0.2, 0.4), (0.1, 0.3)])
def test_a_narrow_road_is_a_strand_whatever_the_height(width, height):
    assert section_area(width, height) == pytest.approx(np.pi * width**2 / 4)
    assert section_area(width, 2 * height) == section_area(width, height)


@given(height=lengths)
def test_the_branches_meet_where_the_road_is_as_wide_as_high(height):
    circle = np.pi * height**2 / 4
    for width in height * np.array([1 - 1e-9, 1, 1 + 1e-9]):
        assert section_area(width, height) == pytest.approx(circle, rel=1e-8)
        assert road_width(section_area(width, height), height) == pytest.approx(width, rel=1e-8)


@given(width=lengths, height=lengths)
def test_the_width_is_found_again_from_the_area(width, height):
    assert road_width(section_area(width, height), height) == pytest.approx(width, rel=1e-9)


@given(width=lengths, wider=st.floats(1.01, 3), height=lengths)
def test_a_wider_road_has_more_area_and_never_more_than_its_box(width, wider, height):
    assert section_area(wider * width, height) > section_area(width, height)
    assert section_area(width, height) <= width * min(width, height)


@settings(max_examples=20, deadline=None)
@given(width=lengths, height=lengths)
def test_jax_and_numpy_agree(width, height):
    both = section_area(jnp.asarray(width), height), road_width(jnp.asarray(width), height)
    assert all(isinstance(value, jax.Array) for value in both)
    expected = section_area(width, height), road_width(width, height)
    np.testing.assert_allclose(both, expected, rtol=1e-14)


def test_derivatives_on_both_branches_are_finite():
    slope = jax.vmap(jax.grad(section_area), (0, None))(jnp.array([0.1, 0.5]), 0.2)
    np.testing.assert_allclose(slope, [np.pi * 0.1 / 2, 0.2])
    width = jax.vmap(jax.grad(road_width), (0, None))
    areas = section_area(np.array([0.1, 0.5]), 0.2)
    np.testing.assert_allclose(width(jnp.asarray(areas), 0.2), 1 / slope)
