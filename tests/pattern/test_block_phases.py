"""Bands side by side: across the side between them lines are as far apart as within."""

import numpy as np
import pytest
from outlines import OUTLINES
from shapely import Polygon

from fdjax.part.blocking import blocks_of
from fdjax.part.contour import circle, valid_polygon
from fdjax.pattern.block_phases import Beside, Turn, besides, turns

PHASES = 5


def gaps(pair, order, counts):
    """Steps between lines of one phase across a side, of each phase."""
    places = []
    for band, last in zip(pair.bands, pair.last, strict=True):
        phase = order[band].phases(counts[band], PHASES)
        phase = phase[::-1] if last else phase
        places.append([int(np.flatnonzero(phase == k)[0]) for k in range(PHASES)])
    return np.array(places[0]) + np.array(places[1]) + 1


@pytest.mark.parametrize("last", [(True, False), (False, True), (True, True), (False, False)])
@pytest.mark.parametrize("counts", [(23, 31), (40, 17)])
def test_two_bands_go_on_in_each_other(last, counts):
    pair = Beside((0, 1), last, 10.0)
    assert gaps(pair, turns(counts, [pair], PHASES), counts).tolist() == [PHASES] * PHASES


def test_each_phase_of_a_band_has_every_fifth_line():
    for step in (1, -1):
        phase = Turn(3, step).phases(20, PHASES)
        assert phase[0] == 3
        assert np.bincount(phase).tolist() == [4] * PHASES


HOLED = Polygon(
    OUTLINES["L"]().exterior, [circle((17, 17), 7).exterior, circle((17, 58), 6).exterior]
)


@pytest.mark.parametrize(
    ("polygon", "least"),
    [(HOLED, 3), (OUTLINES["ring"](), 3), (OUTLINES["three holes"](), 2), (OUTLINES["L"](), 5)],
)
def test_around_holes_no_two_lines_of_a_layer_come_together_at_a_join(polygon, least):
    blocks = blocks_of(valid_polygon(polygon.exterior, polygon.interiors), 0.4)
    beside = besides(blocks)
    alike, found = [], []
    for seed in range(10):
        counts = np.random.default_rng(seed).integers(20, 90, len(blocks.bands)).tolist()
        for ways, seen in (
            ([Turn(0, 1)] * len(counts), alike),
            (turns(counts, beside, PHASES), found),
        ):
            seen.append(min(gaps(pair, ways, counts).min() for pair in beside))
    # The counts around a hole are no whole number of turns.
    assert min(alike) == 1
    assert min(found) >= least


def test_bands_of_the_two_families_are_not_beside_each_other():
    blocks = blocks_of(valid_polygon(OUTLINES["disc"]().exterior, ()), 0.4)
    for pair in besides(blocks):
        one, other = (blocks.bands[k].family for k in pair.bands)
        assert one == other
