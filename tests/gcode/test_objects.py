"""Objects that are left out: what the head does meanwhile, and on the first moves behind them."""

import pytest

from fdjax.errors import InputError
from fdjax.gcode.firmware import KLIPPER, MARLIN, REPRAP
from fdjax.gcode.state import GcodeState

PUSHES = [f"G1 X{x} E.1" for x in (1, 2, 3, 4, 5)]
"""Klipper leaves nothing out before so many."""
NUMBERED = ["M486 P1", "G1 X5 Y0 Z1 E.5", "M486 S1", "G1 X30 Y30", "G1 X40 E1", "M486 S-1"]
NAMED = [
    *("EXCLUDE_OBJECT NAME=b", *PUSHES),
    *("EXCLUDE_OBJECT_START NAME=B", "G1 X30 Y30", "G1 X40 E1", "EXCLUDE_OBJECT_END NAME=b"),
]


def made(firmware, lines):
    """Moves of the head, from place to place, with mm of filament; and the state at last."""
    state = GcodeState(firmware)
    state.run("M83")
    moves = [move for line in ["G1 X0 Y0 Z1", *lines] for move in state.run(line)]
    return [(m.start, m.end, round(m.volume / state.gain, 9)) for m in moves], state


@pytest.mark.parametrize(
    ("firmware", "lines", "behind"),
    [
        # Behind it the head goes from where it waited; where a road comes first, to its beginning.
        (MARLIN, [*NUMBERED, "G1 X50 Y50"], [((5, 0, 1), (50, 50, 1), 0)]),
        (MARLIN, [*NUMBERED, "G1 X50 E1"], [((5, 0, 1), (50, 0, 1), 1)]),
        (REPRAP, [*NUMBERED, "G1 X50 Y50"], [((5, 0, 1), (50, 50, 1), 0)]),
        (
            REPRAP,
            [*NUMBERED, "G1 X50 E1"],
            [((5, 0, 1), (40, 30, 1), 0), ((40, 30, 1), (50, 30, 1), 1)],
        ),
        (REPRAP, [*NUMBERED, "G1 E-1"], [((5, 0, 1), (5, 0, 1), -1)]),
        (KLIPPER, [*NAMED, "G1 X50 Y50"], [((5, 0, 1), (50, 50, 1), 0)]),
        (KLIPPER, [*NAMED, "G1 X50 E1"], [((5, 0, 1), (50, 30, 1), 1)]),
        (KLIPPER, [*NAMED, "G1 Z3"], [((5, 0, 1), (5, 0, 3), 0)]),
        (KLIPPER, [*NAMED, "G1 E-1"], [((5, 0, 1), (5, 0, 1), -1)]),
        # What is told again, is told of none, or comes too early.
        (MARLIN, [*NUMBERED, "M486 S1", "M486 U1", "G1 X50"], [((5, 0, 1), (50, 0, 1), 0)]),
        (MARLIN, [*NUMBERED, "M486 T3", "M486 S1", "G1 X50"], [((5, 0, 1), (50, 0, 1), 0)]),
        (KLIPPER, [*NAMED, "EXCLUDE_OBJECT_START NAME=b", "G1 X9 E1"], []),
        (MARLIN, [*NUMBERED, "M486 S2", "M486 C", "G1 X50 Y50 E1"], []),
    ],
)
def test_what_the_head_does_behind_an_object(firmware, lines, behind):
    moves, state = made(firmware, lines)
    before, _ = made(firmware, lines[: lines.index("G1 X40 E1")])
    assert moves[len(before) :] == behind
    assert state.top == max(z for _, (_, _, z), e in moves if e > 0)


@pytest.mark.parametrize(
    "line", ["M486 ACup_P1_copy_0", 'M486 S1 A"Part C"', "M486 S1 ABases P1", "M486 T2 ACup"]
)
@pytest.mark.parametrize("firmware", [MARLIN, REPRAP])
def test_names_are_no_words(firmware, line):
    moves, state = made(firmware, ["M486 S1", line, "G1 X9 E1"])
    assert (moves[-1][1][0], state.objects.left_out) == (9, frozenset())


def test_an_object_has_a_number():
    with pytest.raises(InputError, match="by their numbers"):
        made(MARLIN, ["M486 P1:2"])


def test_klipper_still_makes_five_pushes():
    lines = ["EXCLUDE_OBJECT NAME=b", "EXCLUDE_OBJECT_START NAME=b", *PUSHES, "G1 X9 E.1"]
    moves, _ = made(KLIPPER, lines)
    assert [end[0] for _, end, _ in moves] == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("inside", "share"),
    [(["G1 E1", "G1 E-.8"], 0.2), (["G1 E1"], 1.0)],
)
def test_klipper_pulls_back_what_the_object_had(inside, share):
    """An object that ends pulled back leaves the filament so, whether it was made or not."""
    moves, _ = made(KLIPPER, [*NAMED[:-3], *inside, "EXCLUDE_OBJECT_END", "G1 E1"])
    assert moves[-1][2] == pytest.approx(share)


@pytest.mark.parametrize(("firmware", "x"), [(MARLIN, 5), (REPRAP, 40), (KLIPPER, 40)])
def test_where_the_machine_says_that_it_is(firmware, x):
    _, state = made(firmware, NAMED[:-1] if firmware is KLIPPER else NUMBERED[:-1])
    assert state.x == x
    assert state.objects.skips
    assert not GcodeState(firmware).objects.followed
