"""Roads as SML can hold them: whole microsteps, flow codes, and the motion language's limits."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats.profile import Sml
from fdjax.plan.toolpath import Road
from fdjax.road.bead import road_width, section_area
from fdjax.units import MICROSTEP

MOST_ACTIONS = 200
"""Moves in one continuous path."""
MOST_OUTPUTS = 32
"""Output changes (MM) in one path."""
MOST_STEPS = 524_272
"""Length of one continuous path, microsteps."""
FARTHEST = 32_767
"""Largest coordinate, and largest count of an output change, microsteps."""
LARGEST_GAIN = 254
"""Largest even flow code."""

_MOST_RUNS = MOST_OUTPUTS - 2  # flow on and rollback are outputs too
_STEP = 2  # from one even code to the next
_SPIKE = 32
"""Microsteps, 0.8 mm: so far a join may run beside its own line where a wall is met obliquely."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass
class Carry:
    """Volume owed by the codes laid so far, in code x microsteps.

    Every run of segments gets the even code below or above the one it asks for, whichever leaves
    less owed; so the mean section keeps exact however coarse the codes are.
    """

    owed: float = 0.0

    def quantise(self, code: float, length: float) -> int:
        """The even code for a run that asks for `code` over `length` microsteps."""
        nearest = _STEP * round(code / _STEP)
        if abs(code - nearest) < 1e-6:
            return nearest
        low = _STEP * math.floor(code / _STEP)
        best = min((low, low + _STEP), key=lambda c: abs(self.owed + (code - c) * length))
        self.owed += (code - best) * length
        return best


def fit_road(road: Road, height: float, origin: Floats, sml: Sml, carry: Carry) -> tuple[Road, ...]:
    """The road as pieces that SML can hold; they touch end to start, and may be none.

    Raises `InputError` for points out of range and for sections that no flow code gives.
    """
    steps = steps_of(road, origin)
    if np.abs(steps).max() > FARTHEST:
        x, y = steps[np.abs(steps).max(axis=1).argmax()]
        raise InputError(
            f"({x}, {y}) microsteps on the bed is out of range; SML holds +-{FARTHEST}"
        )
    width = road.width if road.section is None else road_width(road.section, height)
    steps, width = _lasting(steps, width)
    if len(width) == 0:
        return ()
    asked = section_area(width, height) / sml.area_per_code
    if asked.min() < _STEP - 1e-6 or asked.max() > LARGEST_GAIN + 1e-6:
        wrong = width[asked.argmin() if asked.min() < _STEP - 1e-6 else asked.argmax()]
        raise InputError(
            f"a road {wrong:.4g} mm wide in a layer {height:.4g} mm high has a section of "
            f"{section_area(wrong, height):.4g} mm^2; flow codes {_STEP} to {LARGEST_GAIN} give "
            f"{_STEP * sml.area_per_code:.4g} to {LARGEST_GAIN * sml.area_per_code:.4g}"
        )
    pieces = _pieces(steps, asked, sml)
    fitted = []
    for first, last, starts in pieces:
        lengths = lengths_of(steps[first : last + 1])
        codes = np.empty(last - first)
        for begin, end in zip(starts, [*starts[1:], last - first], strict=True):
            run, share = lengths[begin:end], asked[first + begin : first + end]
            total = float(run.sum())
            codes[begin:end] = carry.quantise(float(run @ share) / total, total)
        closed = road.closed and len(pieces) == 1
        xy = steps[first : last + (not closed)] * MICROSTEP - origin
        widths = road_width(sml.area_per_code * codes, height)
        fitted.append(Road(xy, widths, road.material, closed, road.family))
    return tuple(fitted)


def steps_of(road: Road, origin: Floats) -> Ints:
    """The road's path in whole microsteps on the bed, shape (segments + 1, 2)."""
    return np.rint((road.path + origin) / MICROSTEP).astype(np.int64)


def _lasting(steps: Ints, width: Floats) -> tuple[Ints, Floats]:
    """The path without points that repeat, and without tips of sharp turns whose sides rounding has
    put upon or across each other.
    """
    while True:
        moved = (np.diff(steps, axis=0) != 0).any(axis=1)
        steps, width = np.vstack([steps[:1], steps[1:][moved]]), width[moved]
        way = np.diff(steps, axis=0)
        before, after = way[:-1], way[1:]
        back = (before * after).sum(1) < 0
        straight = before[:, 0] * after[:, 1] == before[:, 1] * after[:, 0]
        short = np.minimum(np.abs(before).max(1), np.abs(after).max(1)) <= _SPIKE
        spikes = np.flatnonzero(back & (straight | _hooked(steps)) & short)
        if not len(spikes):
            return steps, width
        # One at a time: the next may be none without it.
        k = spikes[0]
        shorter = k + int(np.abs(before[k]).max() >= np.abs(after[k]).max())
        steps, width = np.delete(steps, k + 1, axis=0), np.delete(width, shorter)


def _hooked(steps: Ints) -> NDArray[np.bool_]:
    """Of each inner point of a path: whether the segment before the two at it, or the one after
    them, meets the further one of the two.
    """
    a, b, c, d = steps[:-3], steps[1:-2], steps[2:-1], steps[3:]
    meets = (_side(a, b, c) * _side(a, b, d) <= 0) & (_side(c, d, a) * _side(c, d, b) <= 0)
    hooked = np.zeros(max(len(steps) - 2, 0), bool)
    hooked[: len(meets)] |= meets
    hooked[1 : len(meets) + 1] |= meets
    return hooked


def _side(a: Ints, b: Ints, c: Ints) -> Ints:
    """1, 0 or -1: to the left of the way from a to b, on its line, or to the right, lies c."""
    along, to = b - a, c - a
    return np.sign(along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0])


def codes_of(road: Road, height: float, sml: Sml) -> Ints:
    """The even flow code of each segment of a fitted road, shape (segments,)."""
    codes = section_area(road.width, height) / sml.area_per_code
    return (_STEP * np.rint(codes / _STEP)).astype(np.int64)


def lengths_of(steps: Ints | Floats) -> Floats:
    """Length of each segment of a path in microsteps, shape (segments,)."""
    return np.hypot(*np.diff(steps, axis=0).T)


def counts_of(steps: Ints | Floats) -> Ints:
    """Whole microsteps from the path's start to each of its points, shape (points,).

    Rounded so that points which are a microstep or more apart keep different counts.
    """
    return np.floor(np.concatenate([[0.0], np.cumsum(lengths_of(steps))]) + 0.5).astype(np.int64)


def ends(length: int, sml: Sml) -> tuple[int, int]:
    """Counts at which the first gain code sets in and before the end rollback does.

    Those of the profile, but at most half the road each.
    """
    return min(sml.start_steps, length // 2), min(sml.rollback_steps, length // 2)


def _pieces(steps: Ints, asked: Floats, sml: Sml) -> list[tuple[int, int, list[int]]]:
    """First point, last point and starts of runs of each piece that the road must be cut into.

    The pieces have equal numbers of segments, or lengths as equal as may be where the shortest is
    twice as long then; one more piece is tried until all keep within the limits.
    """
    segments = len(asked)
    count = max(
        math.ceil(segments / MOST_ACTIONS),
        math.ceil(len(_runs(steps, asked, sml)) / _MOST_RUNS),
    )
    reach = np.concatenate([[0.0], np.cumsum(lengths_of(steps))])
    while True:
        shares = np.arange(count + 1) / count
        made: list[tuple[float, list[tuple[int, int, list[int]]]]] = []
        for cuts in (
            np.arange(count + 1) * segments // count,
            np.abs(reach[:, None] - shares * reach[-1]).argmin(axis=0),
        ):
            if (np.diff(cuts) < 1).any():
                continue
            pieces = [
                (a, b, _runs(steps[a : b + 1], asked[a:b], sml)) for a, b in pairwise(cuts.tolist())
            ]
            if all(_within_limits(steps[a : b + 1], starts) for a, b, starts in pieces):
                made.append((float(np.diff(reach[cuts]).min()), pieces))
        if made:
            return made[-1 if made[-1][0] > 2 * made[0][0] else 0][1]
        count += 1


def _within_limits(steps: Ints, starts: list[int]) -> bool:
    counts = counts_of(steps)
    return (
        len(steps) - 1 <= MOST_ACTIONS
        and len(starts) <= _MOST_RUNS
        and int(counts[-1]) <= MOST_STEPS
        and int(counts[starts[-1]]) <= FARTHEST
    )


def _runs(steps: Ints, asked: Floats, sml: Sml) -> list[int]:
    """Segments at which a new run of one code begins, 0 first.

    A run ends where the codes asked for in it would spread over more than one step of the codes,
    but none begins while the flow starts, during rollback, or too soon after the last.
    """
    whole = bool((np.abs(asked / _STEP - np.rint(asked / _STEP)) < 1e-6).all())
    spread = 1e-3 if whole else _STEP + 1e-9
    if np.ptp(asked) <= spread:
        return [0]
    counts = counts_of(steps).tolist()
    lead, tail = ends(counts[-1], sml)
    starts, earliest, latest = [0], lead + 1, counts[-1] - tail
    low = high = float(asked[0])
    for k, code in enumerate(asked.tolist()[1:], 1):
        low, high = min(low, code), max(high, code)
        if high - low > spread and earliest <= counts[k] < latest:
            starts.append(k)
            low = high = code
            earliest = counts[k] + sml.start_steps
    return starts
