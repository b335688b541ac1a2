"""Joins made otherwise: less travel, every end once, never a ring."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fdjax.plan.join import Joins, Way, choose
from fdjax.plan.relink import _Search, relinked


def gaps(order: list[int], points: np.ndarray) -> list[Way]:
    """Ways between all neighbours on one wall on which the ends follow in this order."""
    return [
        Way((a, b), points[[a, b]], float(np.hypot(*(points[a] - points[b]))))
        for a, b in zip(order, [*order[1:], order[0]], strict=True)
        if a // 2 != b // 2
    ]


def kept(ways: list[Way], chosen: list[int]) -> set[tuple[int, int]]:
    """Pairs that exclude each other so that nothing but what was chosen can be made."""
    return {(n, m) for n in range(len(ways)) for m in chosen if n not in chosen}


@st.composite
def chords(draw):
    """Pieces that do not cross, as ends on a circle in order, with levels."""
    count = draw(st.integers(2, 14))
    order: list[int] = []
    for piece in range(count):
        at = draw(st.integers(0, len(order)))
        # Two ends side by side cut off nothing, so no piece laid before is crossed.
        order[at:at] = [2 * piece, 2 * piece + 1]
    turn = np.arange(2 * count) * np.pi / count
    points = np.zeros((2 * count, 2))
    points[order] = 40 * np.stack([np.cos(turn), np.sin(turn)], 1)
    return order, points, draw(st.lists(st.integers(0, 9), min_size=count, max_size=count))


@given(chords(), st.integers(0, 1), st.floats(0, 10))
@settings(max_examples=80, deadline=None)
def test_every_piece_stays_in_one_run_and_travel_never_grows(layer, parity, lift) -> None:
    order, points, level = layer
    ways = gaps(order, points)
    chosen = choose(ways, level, parity, set())
    before = Joins.of(ways[number] for number in chosen)
    after = relinked(ways, chosen, set(), points, lift)
    runs = after.joins.runs(len(level))
    # A piece of a ring would be in no run.
    assert sorted(entry // 2 for run in runs for entry in run) == list(range(len(level)))
    assert len(runs) <= len(before.runs(len(level))) or lift < 1
    assert after.travel <= _Search(ways, chosen, set(), points, lift).cost


def test_a_free_end_moves_along_the_wall_to_where_the_next_road_begins() -> None:
    # Two combs side by side; the first was left at its far end.
    x = np.array([0.0, 2, 4, 6, 30, 32])
    points = np.stack([np.repeat(x, 2), np.tile([0.0, 20.0], len(x))], 1)
    ways = [
        Way((2 * k + side, 2 * k + 2 + side), points[[2 * k + side, 2 * k + 2 + side]], 2.0)
        for k in (0, 1, 2, 4)
        for side in (0, 1)
    ]
    chosen = [n for n, way in enumerate(ways) if way.ends in {(1, 3), (2, 4), (5, 7), (9, 11)}]
    (run, other) = relinked(ways, chosen, set(), points, 0).joins.runs(6)
    ends = {run[0], run[-1] ^ 1, other[0], other[-1] ^ 1}
    assert ends >= {0, 6}
    same = relinked(ways, chosen, kept(ways, chosen), points, 0).joins
    assert same.runs(6) == Joins.of(ways[n] for n in chosen).runs(6)


@pytest.mark.parametrize("lift", [0.0, 4.0])
def test_two_free_ends_that_meet_are_joined(lift) -> None:
    points = np.array([(0.0, 0), (0, 9), (1, 0), (1, 9), (2, 0), (2, 9)])
    ways = [Way((a, b), points[[a, b]], 1.0) for a, b in ((0, 2), (1, 3), (2, 4), (3, 5))]
    found = relinked(ways, [0], set(), points, lift)
    assert len(found.joins.runs(3)) == 1
    assert found.travel == pytest.approx(lift)


def test_a_far_way_is_made_only_for_less_travel() -> None:
    points = np.array([(0.0, 0), (0, 9), (1, 0), (1, 9)])
    ways = [Way((0, 2), points[[0, 2]], 1.0), Way((1, 3), points[[1, 3]], 1.0, far=True)]
    assert choose(ways, [0, 1], 0, set()) == [0]
    assert len(relinked(ways, [], set(), points, 4.0).joins.runs(2)) == 1
    assert choose(ways[1:], [0, 1], 0, set()) == []
    assert len(relinked(ways[1:], [], set(), points, 4.0).joins.runs(2)) == 1
