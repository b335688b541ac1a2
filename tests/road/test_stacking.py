"""Which lines lie on which layer: the four modes, combs that interleave, turn-arounds spread."""

import itertools

import numpy as np
import pytest

from fdjax.errors import InputError
from fdjax.road.stacking import FAMILIES, MODES, Scan, Stacking

PHASES = range(2, 9)


def families(stacking):
    return [[scan.family for scan in layer] for layer in stacking.scans]


def places(stacking, layer, comb=12):
    return [tuple(scan.places(comb)) for scan in stacking.scans[layer]]


def test_alternate_lays_the_same_two_layers_over_and_over():
    stacking = Stacking("alternate", layers=5)
    assert families(stacking) == [["xi"], ["eta"], ["xi"], ["eta"], ["xi"]]
    assert places(stacking, 0) == places(stacking, 2) == places(stacking, 4)
    assert stacking.layer_share("xi") == 3 / 5
    assert not stacking.both_families


def test_both_lays_both_families_on_every_layer():
    stacking = Stacking("both", layers=3)
    assert families(stacking) == [["xi", "eta"]] * 3
    assert places(stacking, 0) == places(stacking, 1)
    assert stacking.layer_share("xi") == stacking.layer_share("eta") == 1
    assert stacking.both_families


def test_alternate_staggered_by_halves_puts_lines_between_those_two_layers_below():
    stacking = Stacking("alternate-staggered", 2, layers=6)
    assert families(stacking) == [["xi"], ["eta"]] * 3
    (low,), (high,) = places(stacking, 0), places(stacking, 2)
    between = (np.array(low)[1:] + np.array(low)[:-1]) / 2
    np.testing.assert_allclose(high[:-1], between)
    assert places(stacking, 4) == places(stacking, 0)


def test_both_staggered_by_halves_shifts_every_second_layer():
    stacking = Stacking("both-staggered", 2, layers=4)
    assert families(stacking) == [["xi", "eta"]] * 4
    assert places(stacking, 0) != places(stacking, 1)
    assert places(stacking, 0) == places(stacking, 2)


@pytest.mark.parametrize("mode", ["alternate-staggered", "both-staggered"])
@pytest.mark.parametrize("phases", PHASES)
def test_all_phases_together_are_one_equally_spaced_comb(mode, phases):
    stacking = Stacking(mode, phases, layers=2 * phases if mode.startswith("alt") else phases)
    comb = 7 * phases + 3
    for family in FAMILIES:
        scans = [scan for layer in stacking.scans for scan in layer if scan.family == family]
        together = np.sort(np.concatenate([scan.places(comb) for scan in scans]))
        np.testing.assert_allclose(together, (np.arange(comb) + 0.5) / comb)


@pytest.mark.parametrize("phases", PHASES)
def test_layers_of_a_family_far_apart_in_phase_follow_each_other(phases):
    # Beyond two phases no line lies beside that of the layer below by a single place of the comb,
    # where the number of phases has a step between that goes round.
    scans = [layer[0] for layer in Stacking("both-staggered", phases, layers=phases + 1).scans]
    step = {(b.phase - a.phase) % phases for a, b in itertools.pairwise(scans)}
    assert len(step) == 1
    assert step == {1} if phases in (2, 3, 4, 6) else min(step) >= 2


def covered(phases, comb, parity):
    """On how many of the phases' layers the far wall is covered between places of the comb.

    By the rule of the plan: lines k and k + 1 of a layer are joined at the far end where
    k + parity is even.
    """
    count = np.zeros(comb - 1, int)
    for phase in range(phases):
        lines = np.arange(phase, comb, phases)
        for k, (a, b) in enumerate(itertools.pairwise(lines)):
            if (k + parity(phase)) % 2 == 0:
                count[a:b] += 1
    return count[phases:-phases]


@pytest.mark.parametrize("phases", PHASES)
def test_parity_spreads_the_turn_arounds_over_the_wall(phases):
    scans = [layer[0] for layer in Stacking("both-staggered", phases, layers=phases).scans]
    parity = {scan.phase: scan.parity for scan in scans}
    count = covered(phases, 40 * phases, parity.get)
    # Half of the layers everywhere, give or take the one that no whole number can avoid.
    assert np.abs(2 * count - phases).max() <= (1 if phases % 2 else 2)
    # Without it some places are covered on every layer, others on none.
    alike = covered(phases, 40 * phases, lambda _: 0)
    assert (alike.min(), alike.max()) == (0, phases)


def test_a_layer_takes_its_share_of_a_comb_that_does_not_divide_evenly():
    counts = [len(Scan("xi", phase, 3).places(11)) for phase in range(3)]
    assert counts == [4, 4, 3]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("alternating", 1, 2), "alternate, both"),
        (("alternate", 1, 0), "layers: 0"),
        (("alternate-staggered", 1, 2), "at least 2"),
        (("both-staggered", 0, 2), "at least 2"),
        (("alternate", 2, 2), "use a staggered one"),
    ],
)
def test_bad_values_say_what_would_do(arguments, words):
    with pytest.raises(InputError, match=words):
        Stacking(*arguments)


def test_every_mode_has_its_four_properties():
    found = {
        (Stacking(mode, 2 if mode.endswith("staggered") else 1).staggered, mode.startswith("both"))
        for mode in MODES
    }
    assert len(found) == 4
