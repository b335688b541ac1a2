"""Blocks that share sides: what they cover, how bands run through them, what is refused."""

import numpy as np
import pytest
import shapely
from outlines import OUTLINES
from shapely import Polygon, affinity, box

from fdjax.errors import InputError
from fdjax.part.blocking import blocks_of
from fdjax.part.blocks import Blocks, padded
from fdjax.part.contour import circle, valid_polygon
from fdjax.part.curve import arc, polyline

TEE = box(0, 0, 80, 30).union(box(25, 0, 55, 80))
CROSS = box(0, 25, 80, 55).union(box(25, 0, 55, 80))
FRAME = Polygon(box(0, 0, 60, 50).exterior, [box(20, 15, 40, 30).exterior])


def whole(polygon):
    return valid_polygon(polygon.exterior, polygon.interiors)


@pytest.mark.parametrize(
    ("polygon", "count", "closed", "broken"),
    [
        (OUTLINES["square"](), 1, 0, 0),
        (OUTLINES["L"](), 3, 0, 0),
        (affinity.rotate(OUTLINES["L"](), 31), 3, 0, 0),
        (TEE, 4, 0, 0),
        (CROSS, 5, 0, 0),
        (FRAME, 4, 1, 0),
        (OUTLINES["ring"](), 4, 1, 0),
        (OUTLINES["disc"](), 5, 1, 2),
        (OUTLINES["triangle"](), 3, 0, 1),
        (OUTLINES["three holes"](), 13, 2, 2),
    ],
)
def test_blocks_that_are_found_cover_the_region(polygon, count, closed, broken):
    blocks = blocks_of(whole(polygon), 0.4)
    assert len(blocks.blocks) == count
    assert sum(band.closed for band in blocks.bands) == closed
    assert len(blocks.broken) == broken
    areas = [Polygon(blocks.outline(k)).area for k in range(count)]
    assert sum(areas) == pytest.approx(polygon.area, rel=1e-4)


@pytest.mark.parametrize("name", ["L", "disc", "three holes"])
def test_each_block_lies_in_a_band_of_either_family(name):
    blocks = blocks_of(whole(OUTLINES[name]()), 0.4)
    seen = [(s.block, s.axis, band.family) for band in blocks.bands for s in band.stretches]
    assert sorted((block, axis) for block, axis, _ in seen) == [
        (block, axis) for block in range(len(blocks.blocks)) for axis in (0, 1)
    ]
    for block in range(len(blocks.blocks)):
        assert {family for own, _, family in seen if own == block} == {0, 1}


def test_a_band_leaves_a_block_by_the_side_at_which_it_enters_the_next():
    blocks = blocks_of(whole(OUTLINES["disc"]()), 0.4)
    for band in blocks.bands:
        for one, other in zip(band.stretches, band.stretches[1:], strict=False):
            leave = {(0, False): 2, (0, True): 0, (1, False): 1, (1, True): 3}
            enter = {(0, False): 0, (0, True): 2, (1, False): 3, (1, True): 1}
            sides = [
                blocks.side(one.block, leave[one.axis, one.back]),
                blocks.side(other.block, enter[other.axis, other.back]),
            ]
            places = [
                side(np.array(0.3 if not stretch.turned else 0.7))
                for side, stretch in zip(sides, (one, other), strict=True)
            ]
            np.testing.assert_allclose(*places, atol=1e-9)


def test_named_blocks_may_share_a_curve():
    bent = arc((30, 0), (33, 15), (30, 30))
    blocks = Blocks.of(
        box(0, 0, 60, 30),
        [[(0, 0), (30, 0), (30, 30), (0, 30)], [(30, 0), (60, 0), (60, 30), (30, 30)]],
        [bent],
    )
    left, right = (Polygon(blocks.outline(k)).area for k in (0, 1))
    assert left > 900 + 50
    assert left + right == pytest.approx(1800, rel=1e-9)


@pytest.mark.parametrize(
    ("blocks", "says"),
    [
        (
            [[(0, 0), (20, 0), (20, 30), (0, 30)], [(40, 0), (60, 0), (60, 30), (40, 30)]],
            "none covers the part at (30",
        ),
        (
            [[(0, 0), (40, 0), (40, 30), (0, 30)], [(30, 0), (60, 0), (60, 30), (30, 30)]],
            "two overlap at (35",
        ),
        ([[(0, 0), (70, 0), (70, 30), (0, 30)]], "reaches beyond the part"),
        ([[(0, 0), (60, 0), (60, 0), (0, 30)]], "two corners at one place"),
        (
            [
                [(0, 0), (60, 0), (60, 15), (0, 15)],
                [(0, 15), (30, 15), (30, 30), (0, 30)],
                [(30, 15), (60, 15), (60, 30), (30, 30)],
            ],
            "share whole sides",
        ),
    ],
)
def test_blocks_that_do_not_fit_are_refused_with_the_place(blocks, says):
    with pytest.raises(InputError) as fault:
        Blocks.of(box(0, 0, 60, 30), blocks)
    assert says in str(fault.value)


@pytest.mark.parametrize(
    ("polygon", "says"),
    [
        (
            Polygon(OUTLINES["L"]().exterior, [circle((30, 20), 10).exterior]),
            "hole at (30, 20) lies across a cut",
        ),
        (
            Polygon(OUTLINES["disc"]().exterior, [
                circle((25, 40), 6).exterior, circle((55, 40), 6).exterior,
            ]),
            "2 holes in an outline that has no right angles only",
        ),
        (box(0, 0, 60, 60).difference(box(0.5, 30, 60, 61)), "a block would be 0.5 mm wide"),
    ],
)  # fmt: skip
def test_outlines_without_blocks_of_their_own_are_refused(polygon, says):
    with pytest.raises(InputError) as fault:
        blocks_of(whole(polygon), 0.4)
    assert says in str(fault.value)


BANANA = shapely.LineString(
    [(40 * np.cos(t), 40 * np.sin(t)) for t in np.linspace(0, 2.6, 60)]
).buffer(9)
DUMBBELL = shapely.union_all([circle((0, 0), 20), circle((60, 0), 20), box(0, -4, 60, 4)])


@pytest.mark.parametrize("polygon", [OUTLINES["insole"](), BANANA, DUMBBELL, OUTLINES["kidney"]()])
def test_a_patch_in_the_middle_is_about_as_far_from_the_outline_all_around(polygon):
    region = whole(polygon)
    blocks = blocks_of(region, 0.4)
    assert len(blocks.blocks) == 5
    middle = Polygon(blocks.outline(0))
    walls = shapely.distance(shapely.points(middle.exterior.coords), region.exterior)
    assert walls.max() < 1.6 * walls.min()


def test_padding_keeps_polylines_as_they_are():
    short, long = polyline([(0, 0), (1, 0), (4, 0.5)]), polyline(np.random.default_rng(1)
                                                               .uniform(size=(9, 2)))  # fmt: skip
    for before, after in zip((short, long), padded([short, long]), strict=True):
        assert len(after.breaks) == 9
        one, other = (shapely.LineString(each.polyline()) for each in (before, after))
        assert one.hausdorff_distance(other) < 1e-12
