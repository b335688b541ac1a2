"""Thinning: where lines of one family crowd, the one in the way ends early."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fdjax.plan.chords import Chords, stretch
from fdjax.plan.cut import Piece, closed_up
from fdjax.plan.stadium import stadium_chord

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

CROWDED = 0.98
"""Lines are thinned where they come nearer than this share of the least spacing."""

SHORTEST_LEFT = 5.0
"""What thinning leaves of a piece is at least so many road widths long."""

_PARTED = 0.6
"""Parts of one line keep so many road widths from each other."""

_NEVER = 62


def thin(
    pieces: Sequence[Piece],
    chords: Chords,
    lines: Sequence[Floats],
    level: Sequence[int] | Ints,
    *,
    least_spacing: float | None,
) -> tuple[list[Piece], list[Piece]]:
    """The pieces that keep the least spacing, and what was left out for it.

    Of two lines too near each other the one stays whose level can be halved more often: where
    lines crowd evenly, every second one ends, where they crowd twice as much, three of four.
    A line that ends for another that was itself ended there does not end.

    - `chords`: of the pieces; `level`: of each line; `lines`: those the pieces were cut from.
    - `least_spacing`: of centre lines, mm; None: the mean of the two roads' widths.
    """
    a, b, least = _crowded(pieces, chords, least_spacing)
    if not len(a):
        return list(pieces), []
    line = np.array([piece.line for piece in pieces])
    rank = np.array([_halvings(int(level[number])) for number in line])
    order = np.lexsort((np.arange(len(pieces)), -rank))
    place = np.argsort(order)
    swap = place[chords.owner[a]] < place[chords.owner[b]]
    loser, winner = np.where(swap, b, a), np.where(swap, a, b)
    owner = chords.owner[loser]
    kept: dict[int, Floats] = {}
    for p in order[np.isin(order, owner)].tolist():
        mine = owner == p
        gone = _removed(chords, loser[mine], winner[mine], least[mine], kept)
        total = float(chords.at[chords.owner == p][-1] + chords.length[chords.owner == p][-1])
        kept[p] = _left(gone, total, SHORTEST_LEFT * float(pieces[p].width.mean()))
    whole, left_out = [], []
    for p, piece in enumerate(pieces):
        if p not in kept:
            whole.append(piece)
            continue
        whole += _parts(piece, kept[p])
        left_out += _parts(piece, _between(kept[p], piece))
    return closed_up(whole, lines), left_out


def _halvings(level: int) -> int:
    """How often a level can be halved."""
    return (level & -level).bit_length() - 1 if level else _NEVER


def _crowded(
    pieces: Sequence[Piece], chords: Chords, least_spacing: float | None
) -> tuple[Ints, Ints, Floats]:
    """Pairs of chords of different pieces nearer than their least spacing, the third array.

    Only those of pieces of which a pair is crowded.
    """
    widest = float(chords.width.max()) if least_spacing is None else least_spacing
    i, j = chords.near_pairs(widest)
    line = np.array([piece.line for piece in pieces])
    mean = (chords.width[i] + chords.width[j]) / 2
    least = mean if least_spacing is None else np.full(len(i), least_spacing)
    # Where a wall barely parts a line, what lies beyond is no road beside it.
    least = np.where(line[chords.owner[i]] == line[chords.owner[j]], _PARTED * mean, least)
    distance = chords.distance(i, j)
    if not (distance < CROWDED * least).any():
        return i[:0], j[:0], least[:0]
    near = distance < least
    return i[near], j[near], least[near]


def _removed(
    chords: Chords, loser: Ints, winner: Ints, least: Floats, kept: dict[int, Floats]
) -> Floats:
    """Stretches of a line within the least spacing of what stays of others, where they crowd."""
    pairs, low, high = [], [], []
    for n, chord in enumerate(winner.tolist()):
        begin, length = chords.at[chord], chords.length[chord]
        for a, b in kept.get(int(chords.owner[chord]), np.array([[-np.inf, np.inf]])):
            from_, to = max(a - begin, 0.0), min(b - begin, length)
            if to > from_:
                pairs.append(n)
                low.append(from_)
                high.append(to)
    n = np.array(pairs, int)
    loser, winner, least = loser[n], winner[n], least[n]
    unit = chords.unit[winner]
    start = chords.start[winner] + np.array(low)[:, None] * unit
    end = chords.start[winner] + np.array(high)[:, None] * unit

    def within(reach: Floats) -> Floats:
        t0, t1 = stadium_chord(chords.start[loser], chords.unit[loser], start, end, reach)
        t0, t1 = np.maximum(t0, 0), np.minimum(t1, chords.length[loser])
        hit = t0 < t1
        at = chords.at[loser]
        return _united(np.stack([(at + t0)[hit], (at + t1)[hit]], 1))

    near, crowded = within(least), within(CROWDED * least)
    middle = crowded.mean(1)
    holds = [((a <= middle) & (middle <= b)).any() for a, b in near]
    near = near[np.array(holds, bool)]
    # The two ends that a gap leaves are not to lie on each other.
    short = np.maximum(least.max(initial=0.0) - (near[:, 1] - near[:, 0]), 0) / 2
    return _united(near + short[:, None] * [-1, 1])


def _united(spans: Floats) -> Floats:
    """Stretches that do not overlap, in order."""
    if not len(spans):
        return spans
    spans = spans[np.argsort(spans[:, 0])]
    reached = np.maximum.accumulate(spans[:, 1])
    first = np.concatenate([[True], spans[1:, 0] > reached[:-1] + 1e-9])
    last = np.append(np.flatnonzero(first)[1:] - 1, len(spans) - 1)
    return np.stack([spans[first, 0], reached[last]], 1)


def _left(gone: Floats, total: float, shortest: float) -> Floats:
    """What is left between 0 and `total` and is no shorter than this."""
    if not len(gone):
        return np.array([[0.0, total]])
    edges = np.concatenate([[0.0], np.clip(gone, 0, total).ravel(), [total]]).reshape(-1, 2)
    return edges[edges[:, 1] - edges[:, 0] >= shortest]


def _between(kept: Floats, piece: Piece) -> Floats:
    total = float(np.hypot(*np.diff(piece.xy, axis=0).T).sum())
    edges = np.concatenate([[0.0], kept.ravel(), [total]]).reshape(-1, 2)
    return edges[edges[:, 1] - edges[:, 0] > 1e-9]


def _parts(piece: Piece, spans: Floats) -> list[Piece]:
    total = float(np.hypot(*np.diff(piece.xy, axis=0).T).sum())
    return [
        Piece(
            piece.line,
            *stretch(piece.xy, piece.width, a, b),
            (piece.ends[0] if a <= 1e-9 else None, piece.ends[1] if b >= total - 1e-9 else None),
            piece.pressed,
        )
        for a, b in spans.tolist()
    ]
