"""Unit cells: what they hold, and drawings that do not repeat."""

import itertools

import numpy as np
import pytest
import shapely

from fdjax.errors import InputError
from fdjax.pattern.drawings import NAMES, drawing
from fdjax.pattern.unit_cell import UnitCell

ROOT3 = 3**0.5


@pytest.mark.parametrize(
    ("name", "density", "degree"),
    [
        ("square", 2, 4),
        ("triangular", 2 * ROOT3, 6),
        ("hexagonal", 2 / ROOT3, 3),
        ("kagome", ROOT3, 4),
        ("brick", 1.5, 3),
    ],
)
def test_densities_and_degrees_are_those_of_the_tilings(name, density, degree):
    cell = drawing(name)
    assert cell.density == pytest.approx(density)
    assert set(np.bincount(cell.edges.ravel())) == {degree}


@pytest.mark.parametrize("name", NAMES)
def test_copies_side_by_side_are_one_drawing(name):
    cell = drawing(name)
    assert set(np.bincount(cell.edges.ravel())) <= {2, 3, 4, 6}
    lines = shapely.MultiLineString(list(cell.tiled(range(-2, 3))))
    x, y = 0.1 * cell.size[0], 0.1 * cell.size[1]
    inner = shapely.box(x - cell.size[0], y - cell.size[1], x + cell.size[0], y + cell.size[1])
    assert lines.intersection(inner).length == pytest.approx(4 * cell.area * cell.density)
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(lines)]))
    assert len(faces) or name in ("wave", "truchet")


def test_a_drawing_may_begin_anywhere():
    lines = np.array([[(0, 0), (1, 0)], [(0, 0), (0, 1)]])
    moved = UnitCell.of((lines + np.array([3.3, -1.7])).tolist(), (1, 1))
    assert moved.xy == pytest.approx(np.array([[0.3, 0.3]]))
    assert moved.density == drawing("square").density


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([[(0, 0.3), (1, 0.4)]], r"ends at \(0, 0.3\).*none goes on at \(1, 0.3\)"),
        ([[(0, 0), (1, 1)], [(0, 1), (1, 0)]], r"cross at \(0.5, 0.5\)"),
        ([[(0, 0.5), (1, 0.5)], [(0.4, 0.5), (0.4, 0.9)]], r"cross at \(0.4, 0.5\)"),
        ([[(0, 0), (1, 0)], [(0, 1), (1, 1)]], "drawn twice.*one of them is enough"),
        ([[(0, 0), (1, float("inf"))]], "finite"),
        ([], "needs lines"),
        ([[(0, 0)]], "needs lines"),
    ],
)
def test_drawings_that_do_not_repeat_are_refused_with_the_place(lines, words):
    with pytest.raises(InputError, match=words) as caught:
        UnitCell.of(lines, (1, 1))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "pore"),
    [
        # Along the sides; along a side of a triangle the chord falls evenly to 0, of a hexagon it
        # rises from 1 to 2: the mean of l^2 by that of l.
        ("square", 1),
        ("brick", 2),
        ("triangular", 2 / 3),
        ("hexagonal", 14 / 9),
        ("kagome", 14 / 9),
    ],
)
def test_openings_are_as_wide_as_the_mean_chord_along_the_lines(name, pore):
    assert drawing(name).pore == pytest.approx(pore, rel=1e-3)


@pytest.mark.parametrize("by", [(0.3, 0.4), (1.0, 0.7), (1.7, 1.6)])
def test_gap_and_pore_do_not_depend_on_where_a_curved_drawing_begins(by):
    # Four arcs from (1, 0) and (0, 1), in pieces: a gap of pieces that meet would be near 0.
    turn = np.linspace(0, np.pi / 2, 9)
    arc = np.stack([1 - np.cos(turn), np.sin(turn)], 1)
    lines = [arc * side + (1, 0) for side in ((1, 1), (-1, 1), (1, -1), (-1, -1))]
    own, moved = (
        UnitCell.of([(line + at).tolist() for line in lines], (2, 2)) for at in ((0, 0), by)
    )
    assert own.gap > 0.5
    assert moved.gap == pytest.approx(own.gap)
    assert moved.pore == pytest.approx(own.pore)


def test_lines_without_length_are_refused():
    with pytest.raises(InputError, match="have no length"):
        UnitCell.of([[(0.2, 0.3), (0.2, 0.3)]], (1, 1))


def test_a_size_must_be_positive():
    with pytest.raises(InputError, match="must be positive"):
        UnitCell.of([[(0, 0), (1, 0)]], (1, 0))
    with pytest.raises(InputError, match="1e-09 x 1; one side may be 1000 times"):
        UnitCell.of([[(0, 0), (0, 1)]], (1e-9, 1))


def test_waves_keep_their_distance():
    lines = [drawing("wave").ends[:, 0] + (0, k) for k in (0, 1)]
    pairs = itertools.product(*lines)
    nearest = min(float(np.hypot(*(b - a))) for a, b in pairs)
    assert drawing("wave").gap == pytest.approx(nearest, rel=0.01)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("axes", [(True, False), (False, True), (True, True)])
def test_a_mirrored_cell_is_the_drawing_seen_from_behind(name, axes):
    cell = drawing(name)
    made = cell.mirrored(axes)
    flip = np.where(axes, -1, 1)

    def lines(ends):
        """Middles of the edges in the cell, and their halves, whichever end comes first."""
        middle = ends.mean(1) / cell.size
        half = (ends[:, 1] - ends[:, 0]) / 2
        back = (half[:, 0] < -1e-9) | ((abs(half[:, 0]) < 1e-9) & (half[:, 1] < 0))
        half[back] *= -1
        table = np.concatenate([np.round(middle - np.floor(middle + 1e-6), 6), half], 1).round(6)
        return table[np.lexsort(table.T)] + 0.0

    assert lines(made.ends) == pytest.approx(lines(cell.ends * flip), abs=1e-5)
    assert (made.xy >= -1e-5).all()
    assert (made.xy < np.array(cell.size) * (1 - 1e-7)).all()
    again = made.mirrored(axes)
    assert again.xy == pytest.approx(cell.xy, abs=1e-5)
    assert (again.shift == cell.shift).all()
