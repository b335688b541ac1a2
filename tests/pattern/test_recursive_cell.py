"""Cells of higher order: what rules build, and what they cannot."""

import numpy as np
import pytest

from fdjax.app import config
from fdjax.errors import InputError
from fdjax.pattern.drawings import drawing
from fdjax.pattern.recursive_cell import RULES, Rule, clipped, recursive

FRAME = [[(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]]
ZIGZAG = [[(0, 0.5), (0.5, 0.5), (0.5, 0)]]


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_carpet_has_the_length_of_its_frames(order):
    # Sierpinski's carpet of closed squares: 8^k squares, whose sides are shared but at holes.
    cell = recursive(FRAME, (1, 1), Rule(("000", "0.0", "000")), order)
    side = 3**order
    assert cell.size == (side, side)
    # A hole of side s is a line all round, and so is the rest: only what lies inside holes misses.
    inside = sum(8**k * 2 * h * (h - 1) for k, h in enumerate(3**n for n in range(order)[::-1]))
    assert cell.density * cell.area == pytest.approx(2 * side**2 - inside)


@pytest.mark.parametrize("rule", ["mirror", "wind"])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_arcs_go_on_from_cell_to_cell_at_any_order(rule, order):
    base = drawing("truchet")
    cell = recursive(clipped(base), base.size, Rule(RULES[rule]), order)
    assert set(np.bincount(cell.edges.ravel())) == {2}
    assert cell.density == pytest.approx(base.density, rel=1e-6)
    assert len(cell.directions) <= 3 * len(base.directions)


def test_a_base_that_does_not_repeat_may_by_its_rule():
    with pytest.raises(InputError, match="none goes on"):
        recursive(ZIGZAG, (1, 1), Rule(("00", "00")), 1)
    cell = recursive(ZIGZAG, (1, 1), Rule(RULES["mirror"]), 1)
    # Four corners of a square around the common corner, four halves of its neighbours.
    assert cell.density * cell.area == pytest.approx(4)
    assert set(np.bincount(cell.edges.ravel())) == {2}


def test_lines_that_cross_or_lie_on_one_another_meet_in_nodes_and_are_laid_once():
    twice = [*FRAME, [(0, 0), (1, 1)], [(1, 0), (0, 1)], [(0, 0), (1, 0)]]
    cell = recursive(twice, (1, 1), Rule(RULES["mirror"]), 1)
    assert cell.density * cell.area == pytest.approx(8 + 8 * 2**0.5)


@pytest.mark.parametrize("order", [2, 3])
def test_an_opening_that_winds_is_no_wider_than_its_arcs_leave_it(order):
    # Faces of eight squares' area, whose lines are nowhere a circle's diameter of 2 apart.
    base = drawing("truchet")
    cell = recursive(clipped(base), base.size, Rule(RULES["wind"]), order)
    assert 0.8 < cell.pore < 2


def test_coarse_cells_beside_fine_ones():
    cell = recursive(FRAME, (1, 1), Rule(RULES["nest"]), 3)
    # Of 8 x 8: half of it squares of side 4, a quarter of side 2, the rest of side 1.
    assert cell.pore == pytest.approx(4)
    assert cell.gap == pytest.approx(1)


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        (("01", "0"), "rows of one length"),
        ((), "rows of one length"),
        (("0x", "00"), '"x" is no letter'),
        (("b.", ".b"), "no place holds"),
    ],
)
def test_a_rule_that_is_none_is_refused(rule, words):
    with pytest.raises(InputError, match=words):
        Rule(rule)


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ({"base": "hexagonal", "rule": "turn"}, "cannot turn by a quarter"),
        ({"base": "wave", "rule": "turn"}, r"order 1 a line ends at \(0.5, 1\)"),
        ({"base": "truchet", "rule": "mirror", "order": 7}, "take a lower order"),
        ({"base": "truchet", "rule": "wimd"}, 'did you mean "wind"'),
        ({"base": "truchet", "rule": [1]}, "rows are text"),
        ({"base": "truchet"}, "needs a rule"),
        ({"size": [1, 1], "lines": [[[0, 0], [1, 0]]], "order": 2}, "an order needs a rule"),
        ({"size": [1, 1], "lines": [[[0, 0], [2, 0]]], "rule": "turn"}, r"\(2, 0\) lies beyond"),
        ({"base": "truchet", "rule": "wind", "order": 0}, "out of range"),
    ],
)
def test_a_job_says_what_is_wrong_with_its_rule(cell, words):
    table = {
        "part": {"shape": "cosine_top"},
        "target": {"porosity": 0.7},
        "pattern": {"kind": "texture", "cell": cell},
    }
    with pytest.raises(InputError, match=words) as caught:
        config.parse(table)
    assert "\n" not in str(caught.value)
    assert str(caught.value).count("job: [pattern] cell") == 1
