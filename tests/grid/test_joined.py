"""Blocks solved as one: lines run through their joins, walls stay, what folds is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from joins import kinks
from outlines import OUTLINES
from shapely import Polygon, box

from fdjax.errors import InputError
from fdjax.grid import joined
from fdjax.grid.algebraic import Transfinite
from fdjax.part.blocking import blocks_of
from fdjax.part.blocks import Blocks
from fdjax.part.contour import circle
from fdjax.part.curve import arc, spline

pytestmark = pytest.mark.usefixtures("compiled_once")


def swirl():
    """A ring in four blocks, whose shared sides are bent arcs of unlike lengths."""
    ring = Polygon(circle((0, 0), 30).exterior, [circle((0, 0), 12).exterior])

    def on(radius, degrees):
        return radius * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])

    outer, inner = (10, 90, 190, 280), (0, 110, 170, 290)
    ends = [(on(12, b), on(30, a)) for a, b in zip(outer, inner, strict=True)]
    bends = [arc(p, on(20, a + (-1) ** k * 8), q) for k, ((p, q), a) in enumerate(
        zip(ends, outer, strict=True))]  # fmt: skip
    after = [1, 2, 3, 0]
    quads = [[ends[k][0], ends[k][1], ends[after[k]][1], ends[after[k]][0]] for k in range(4)]
    return Blocks.of(ring, quads, bends)


def bent():
    """A plate in two blocks of unlike widths, whose shared side is an S."""
    quads = [[(0, 0), (20, 0), (20, 30), (0, 30)], [(20, 0), (60, 0), (60, 30), (20, 30)]]
    return Blocks.of(box(0, 0, 60, 30), quads, [spline([(20, 0), (24, 8), (17, 22), (20, 30)])])


def solved(blocks, n):
    found = joined.solve(blocks, n)
    return found, joined.mapped(blocks, found)


def test_the_kink_of_lines_at_joins_goes_to_zero_with_the_second_order():
    blocks = swirl()
    before = kinks(blocks, Transfinite(joined.stacked_sides(blocks))).max()
    after = [kinks(blocks, solved(blocks, n)[1]).max() for n in (9, 17, 33)]
    assert before > 10
    orders = np.log2(np.divide(after[:-1], after[1:]))
    assert orders[-1] > 1.8
    assert after[-1] < 0.3


def test_a_plate_comes_out_even_whatever_its_blocks_share():
    blocks = bent()
    found, grid = solved(blocks, 9)
    t = np.linspace(0, 1, 9)
    for lattice, low, high in zip(found.lattices, (0, 20), (20, 60), strict=True):
        np.testing.assert_allclose(lattice[:, :, 0], (low + (high - low) * t)[:, None] + 0 * t,
                                   atol=1e-9)  # fmt: skip
        np.testing.assert_allclose(lattice[:, :, 1], 30 * t + 0 * t[:, None], atol=1e-9)
    assert kinks(blocks, grid).max() < 1e-6
    moved = joined.moved(blocks, found)
    np.testing.assert_allclose(moved.side(0, 1).polyline()[:, 0], 20, atol=1e-9)


def test_walls_are_kept_and_blocks_still_share_their_sides():
    blocks = blocks_of(OUTLINES["L"](), 0.4)
    for own in (swirl(), blocks, blocks_of(OUTLINES["disc"](), 0.4)):
        found, grid = solved(own, 9)
        sides, t = joined.stacked_sides(own), jnp.linspace(0, 1, 57)
        moved = joined.moved(own, found)
        for users in own.users.values():
            lines = []
            for block, k in users:
                xi, eta = ((t, 0 * t), (0 * t + 1, t), (t, 0 * t + 1), (0 * t, t))[k]
                lines.append(np.asarray(
                    jax.tree.map(lambda part, block=block: part[block], grid)(xi, eta)
                ))  # fmt: skip
                if len(users) == 1:
                    side = jax.tree.map(lambda part, block=block: part[block], sides[k])
                    spacings = joined.wall_spacings(own)
                    spacing = (spacings.bottom, spacings.right, spacings.top, spacings.left)[k]
                    spacing = jax.tree.map(lambda part, block=block: part[block], spacing)
                    np.testing.assert_allclose(lines[-1], side(spacing(t)), atol=1e-6)
            if len(users) == 2:
                same = np.abs(lines[0] - lines[1]).max()
                other = np.abs(lines[0] - lines[1][::-1]).max()
                assert min(same, other) < 1e-9
        assert moved.users == own.users


@pytest.mark.parametrize("name", ["disc", "three holes"])
def test_corners_of_three_blocks_and_of_more_are_passed_without_a_kink_beside_them(name):
    blocks = blocks_of(OUTLINES[name](), 0.4)
    before = kinks(blocks, Transfinite(joined.stacked_sides(blocks)))
    after = kinks(blocks, solved(blocks, 17)[1])
    assert after.mean() < 0.2 * before.mean()


def test_the_corner_of_three_blocks_lies_where_symmetry_has_it():
    blocks = blocks_of(Polygon([(0, 0), (40, 0), (20, 20 * 3**0.5)]), 0.4)
    found, _ = solved(blocks, 9)
    (odd,) = found.net.odd
    assert len(odd.near) == 3
    np.testing.assert_allclose(found.nodes[odd.node], [20, 20 / 3**0.5], atol=1e-8)


def test_blocks_that_fold_when_smoothed_are_refused_with_the_place():
    outline = Polygon([(0, 0), (19, 0), (20, 29), (21, 0), (80, 0), (80, 30), (0, 30)])
    quads = [[(0, 0), (40, 0), (40, 30), (0, 30)], [(40, 0), (80, 0), (80, 30), (40, 30)]]
    with pytest.raises(InputError, match=r"would cross at \(.*pattern\.smooth"):
        joined.solve(Blocks.of(outline, quads), 9)
