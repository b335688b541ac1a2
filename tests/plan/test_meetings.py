"""What beads that meet hold twice, against their union as geometry."""

import numpy as np
import pytest
import shapely

from fdjax.plan.meetings import Meetings
from fdjax.plan.segments import Segments
from fdjax.plan.toolpath import Road


def strip(a, b, width):
    return shapely.buffer(shapely.LineString([a, b]), width / 2, cap_style="flat")


def star(angles, widths, length=5.0, at=(1.0, 2.0)):
    ends = [(at[0] + length * np.cos(t), at[1] + length * np.sin(t)) for t in angles]
    roads = [Road([at, end], w, family="mesh") for end, w in zip(ends, widths, strict=True)]
    strips = [strip(at, end, w) for end, w in zip(ends, widths, strict=True)]
    return roads, sum(s.area for s in strips) - shapely.union_all(strips).area


@pytest.mark.parametrize("count", [3, 4, 6])
def test_beads_at_equal_angles_hold_what_their_union_does_not(count):
    roads, excess = star(2 * np.pi * np.arange(count) / count + 0.3, [0.4] * count)
    met = Meetings.of(Segments.of(roads))
    assert met.xy == pytest.approx(np.array([(1.0, 2.0)]))
    assert met.area == pytest.approx([excess])
    assert excess == pytest.approx(count * 0.04 / np.tan(np.pi / count))


def test_uneven_angles_and_widths():
    roads, excess = star(np.deg2rad([10, 80, 150, 260]), [0.3, 0.4, 0.5, 0.35])
    assert Meetings.of(Segments.of(roads)).area == pytest.approx([excess], rel=1e-9)


@pytest.mark.parametrize("angle", [90, 60, 35])
def test_two_roads_that_cross_share_the_parallelogram(angle):
    t = np.deg2rad(angle)
    along = 3 * np.array([np.cos(t), np.sin(t)])
    roads = [
        Road([(-3, 0), (0, 0), (3, 0)], 0.4, family="mesh"),
        Road([-along, (0, 0), along], 0.4, family="mesh"),
    ]
    assert Meetings.of(Segments.of(roads)).area == pytest.approx([0.16 / np.sin(t)])


def test_points_that_a_road_only_passes_and_lines_of_a_family_are_no_nodes():
    bent = Road([(0, 0), (1, 0), (1, 1)], 0.4, family="mesh")
    lines = [Road([(0, 0), (9, 0)], 0.4, family="xi"), Road([(0, 0), (0, 9)], 0.4, family="xi"),
             Road([(0, 0), (-9, 0)], 0.4, family="xi")]  # fmt: skip
    assert len(Meetings.of(Segments.of([bent, *lines])).area) == 0
    assert len(Meetings.of(Segments.of([])).area) == 0
