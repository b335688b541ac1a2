"""Many lines of plain motion at once: what `GcodeState.plain` does with each of them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fdjax.formats.gcode_scan import Block, Floats, Ints, Mask
from fdjax.gcode.state import GcodeState


@dataclass(frozen=True, eq=False)
class Motions:
    """Straight motions, one after the other; of a line `G92 E` one that stands still.

    - `start`, `end`: shape (3, n), mm on the bed; `pushed`: in units of E, shape (n,), `gain` mm^3
      each.
    - `feed`: what F says, mm/min, nan where there is none; `before`: speed before the first, mm/s.
    - `has_e`: the lines that move and name E.
    """

    start: Floats
    end: Floats
    pushed: Floats
    gain: float
    feed: Floats
    before: float
    has_e: Mask

    @cached_property
    def moved(self) -> Mask:
        """Those that move in X or Y, shape (n,)."""
        (a, b, _), (x, y, _) = self.start, self.end
        return (a != x) | (b != y)

    @cached_property
    def volume(self) -> Floats:
        """What is pushed out, mm^3, shape (n,)."""
        return self.pushed * self.gain

    @property
    def speed(self) -> Floats:
        """As the last F says it, mm/s, shape (n,)."""
        speed = np.empty(len(self.feed) + 1)
        _carry(speed, self.before, self.feed / 60)
        return speed[1:]


def takes_many(state: GcodeState) -> bool:
    """Whether plain lines may be taken at once: coordinates are absolute and in mm, no power is on
    that lays something by itself, and there is an extruder."""
    return state.direct and state.firmware.extrudes and not state.power


def advance(state: GcodeState, block: Block, chosen: Ints) -> Motions:
    """Take a state past plain lines and resets of a block that `takes_many`; at least one.

    `chosen` are their indices, rising. The state is afterwards as if they had come one by one.
    """
    first, count = int(chosen[0]), len(chosen)
    if int(chosen[-1]) - first + 1 == count:
        words, plain = block.words[:, first : first + count], block.plain[first : first + count]
    else:
        words, plain = block.words.take(chosen, axis=1), block.plain[chosen]
    x, y, z, e, feed = words
    place = np.empty((3, count + 1))
    told = set()
    for axis, (name, given) in enumerate(zip("XYZ", (x, y, z), strict=True)):
        shift = state.shift[axis]
        if _carry(place[axis], state.on_bed[axis], given + shift if shift else given):
            told.add(name)
    start, end = place[:, :-1], place[:, 1:]
    has_e = np.isfinite(e)
    if (has_e if not state.relative_e else has_e & ~plain).any():
        told.add("E")
    has_e &= plain
    pushed = _pushed(state, e, plain, has_e)
    motions = Motions(start, end, pushed, state.gain, feed, state.speed, has_e)
    highest = float(end[2].max())
    if highest > state.top:
        lifts = (motions.volume > 0) & (motions.moved | (start[2] != end[2]))
        state.top = float(end[2].max(initial=state.top, where=lifts))
    fed = np.flatnonzero(np.isfinite(feed))
    if len(fed):
        state.run_at(float(feed[fed[-1]]) / 60)
    state.on_bed = (float(end[0, -1]), float(end[1, -1]), float(end[2, -1]))
    moves = np.flatnonzero(plain)
    if len(moves):
        state.motion = block.text(int(chosen[moves[-1]]))[:2]
    state.know(told)
    return motions


def _pushed(state: GcodeState, e: Floats, plain: Mask, has_e: Mask) -> Floats:
    """What each line pushes out, in units of E; the state's E is moved on."""
    if state.relative_e:
        pushed = np.where(has_e, e, 0.0)
        resets = np.flatnonzero(~plain)
        last = int(resets[-1]) if len(resets) else -1
        begun = float(e[last]) if len(resets) else state.e
        state.e = float(np.add.accumulate(np.append(begun, pushed[last + 1 :]))[-1])
        return pushed
    reached = np.empty(len(e) + 1)
    _carry(reached, state.e, e)
    state.e = float(reached[-1])
    return np.where(has_e, reached[1:] - reached[:-1], 0.0)


def _carry(values: Floats, before: float, told: Floats) -> bool:
    """Fill values, one more than are told, with what was before and each nan's last number.

    Whether any is told.
    """
    values[0] = before
    known = np.isfinite(told)
    count = np.count_nonzero(known)
    if not count:
        values[1:] = before
        return False
    if 4 * count < len(told):
        at = np.append(0, np.flatnonzero(known) + 1)
        source = np.append(before, told[at[1:] - 1])
        values[:] = np.repeat(source, np.diff(at, append=len(values)))
        return True
    values[1:] = told
    if count < len(told):
        gaps = np.flatnonzero(~known) + 1
        first = np.diff(gaps, prepend=-1) != 1
        values[gaps] = values[gaps[first] - 1][np.cumsum(first) - 1]
    return True


def paid(volume: Floats, owed: float) -> tuple[Floats, float]:
    """What of each volume is laid once what was pulled back is returned, and what is owed then."""
    laid = np.maximum(volume, 0.0)
    pulls = np.flatnonzero(volume < 0)
    if not len(pulls) and not owed:
        return laid, owed
    pushes = np.flatnonzero(volume)
    values = volume[pushes]
    at, count = 0, len(pushes)
    begins = np.searchsorted(pushes, pulls).tolist()
    for begin in [0, *begins] if owed else begins:
        if begin < at:
            continue
        at = begin
        while at < count:
            value = values.item(at)
            if value < 0:
                owed -= value
            elif owed:
                paid = min(owed, value)
                owed -= paid
                laid[pushes[at]] = value - paid
            at += 1
            if not owed:
                break
    return laid, owed
