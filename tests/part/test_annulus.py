"""Rings between a hole and an outline."""

import shapely

from fdjax.part.annulus import Annulus


def test_a_ring_may_begin_just_below_the_ray_along_x():
    # The last point of such a circle lies at an angle of -1e-16.
    ring = (
        shapely.Point(20, 20).buffer(20, quad_segs=32).difference(shapely.Point(20, 20).buffer(8))
    )
    annulus = Annulus.of(ring, "ring")
    for curve in (annulus.outline, annulus.hole):
        length = shapely.LineString(curve.polyline()).length
        assert abs(curve.length - length) < 1e-6 * length
