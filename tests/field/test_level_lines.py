"""Level sets on a raster: which way round they run, and that none is missed."""

import numpy as np

from fdjax.field.isolines import isolines

X, Y = np.linspace(0, 4, 41), np.linspace(-1, 2, 31)


def test_the_higher_side_lies_on_the_left_of_every_line():
    values = np.add.outer(np.sin(X), 0.5 * Y**2)
    level, lines = isolines(X, Y, 3 * values, 0.25)
    assert len(level) == len(lines) > 3
    for line in lines:
        start, step = line[:-1], np.diff(line, axis=0)
        left = start + step / 2 + 1e-4 * np.stack([-step[:, 1], step[:, 0]], 1) / 0.1
        middle = start + step / 2
        rise = np.sin(left[:, 0]) - np.sin(middle[:, 0]) + (left[:, 1] ** 2 - middle[:, 1] ** 2) / 2
        assert (rise > 0).mean() > 0.95


def test_levels_on_nodes_give_no_empty_lines():
    level, lines = isolines(X, Y, np.add.outer(X, 0 * Y), 0.0)
    assert sorted(level.tolist()) == [1, 2, 3, 4] or sorted(level.tolist()) == [0, 1, 2, 3]
    assert all(np.ptp(line[:, 1]) > 2.99 for line in lines)
