"""The time of many moves at once: what `MotionTime` adds up, planned with arrays."""

import numpy as np

from fdjax.formats.gcode_bulk import Motions
from fdjax.formats.gcode_scan import Floats, Ints, Mask
from fdjax.gcode.motion import STRAIGHT, WINDOW, MotionTime
from fdjax.moves import Move

_MANY = 1 << 14
"""Moves that are planned together; those between two stops side by side with others."""


class ManyMotions(MotionTime):
    """A `MotionTime` that takes moves also as arrays; `seconds` and `marks` are known at `finish`.

    What came is kept in rows until there is much of it: run along x, y and z (mm), speed (mm/s),
    acceleration (mm/s^2), and seconds where it is a wait.
    """

    def __init__(self, acceleration: float, corner_speed: float) -> None:
        super().__init__(acceleration, corner_speed)
        self._chunks: list[Floats] = []
        self._single: list[tuple[float, ...]] = []
        self._count = 0  # of rows kept
        self._stops: list[int] = []  # rows before which the machine stands
        self._places: list[int] = []  # rows before each mark
        self._begun: float | None = None  # squared entry of the first row, where it is planned

    def add(self, move: Move) -> None:
        """Take one more move."""
        (a, b, c), (x, y, z), speed, volume, wait = move
        alone = self._alone(wait * speed, speed) if wait and speed else wait
        acceleration = self._road if volume else self._travel
        self._single.append((x - a, y - b, z - c, speed, acceleration, alone))
        self._count += 1

    def add_many(self, motions: Motions, pace: Floats, waits: Floats, own: slice) -> None:
        """Take some of these motions; `pace`: mm/s, `waits`: s, of those that stand still."""
        self._drain()
        volume, wait, speed = motions.volume[own], waits[own], pace[own]
        rows = np.empty((6, len(speed)))
        rows[:3] = motions.end[:, own] - motions.start[:, own]
        rows[3] = speed
        rows[4] = np.where(volume != 0, self._road, self._travel)
        rows[5] = 0.0
        still = np.flatnonzero(wait)
        end = np.minimum(self._corner, speed[still] ** 2)
        rows[5, still] = _seconds(
            wait[still] * speed[still], speed[still], end, end, self._filament
        )
        self._chunks.append(rows)
        self._count += rows.shape[1]
        if self._count >= _MANY:
            self._plan_all()

    def mark(self) -> None:
        """Have the time at the end of the moves so far put into `marks`."""
        self._places.append(self._count)

    def flush(self) -> None:
        """Come to a stop after the moves so far."""
        self._stops.append(self._count)

    def finish(self) -> None:
        """Come to a stop after the last move: `seconds` and `marks` are then known."""
        self.flush()
        self._plan_all()

    def _drain(self) -> None:
        if self._single:
            self._chunks.append(np.array(self._single).T)
            self._single.clear()

    def _plan_all(self) -> None:
        """Plan all that is kept but the last moves, if those to come can change their speeds."""
        self._drain()
        rows = np.concatenate([np.zeros((6, 0)), *self._chunks], 1)
        times = rows[5].copy()
        length = np.sqrt((rows[:3] ** 2).sum(0))
        stands = times != 0
        stands[[at for at in self._stops if at < len(times)]] = True
        group = np.cumsum(stands)
        live = np.flatnonzero((length > 0) & (times == 0))
        group = group[live]
        path = _Path(rows[:, live], length[live], group, self._corner)
        first = np.flatnonzero(np.diff(group, prepend=-1))
        ends = np.append(first, len(live))[1:]
        entry = path.limit[first]
        done = len(times)
        if len(first):
            if self._begun is not None:
                entry[0] = self._begun
            for number in np.flatnonzero(ends - first >= WINDOW).tolist():
                place = int(first[number]), int(ends[number])
                first[number], entry[number] = path.windows(*place, float(entry[number]))
            last = int(live[-1])
            if not (stands[last + 1 :].any() or any(stop > last for stop in self._stops)):
                done = int(live[first[-1]])
                self._begun = float(entry[-1])
                first, ends, entry = first[:-1], ends[:-1], entry[:-1]
            path.close(first, ends, entry)
        if done == len(times):
            self._begun = None
        times[live] = path.times
        reached = self.seconds + np.cumsum(np.append(0.0, times[:done]))
        self.marks += [float(reached[place]) for place in self._places if place <= done]
        self.seconds = float(reached[-1])
        self._places = [place - done for place in self._places if place > done]
        self._stops = [stop - done for stop in self._stops if stop > done]
        self._chunks = [rows[:, done:].copy()]
        self._count = len(times) - done


class _Path:
    """Moves that are planned: `limit`, of the squared speed with which each may begin; `times`."""

    def __init__(self, rows: Floats, length: Floats, group: Ints, corner: float) -> None:
        self._corner = corner
        self._length, self._speed, self._acceleration = length, rows[3], rows[4]
        self._climb = 2 * rows[4] * length
        # Speed and direction at the end of the move before; none after a stop.
        unit, speed = rows[:3] / length, rows[3]
        goes_on = np.diff(group, prepend=-1) == 0
        before, slower = np.zeros(unit.shape), speed.copy()
        before[:, 1:] = unit[:, :-1] * goes_on[1:]
        slower[1:] = np.where(goes_on[1:], np.minimum(speed[1:], speed[:-1]), speed[1:])
        bend = ((unit - before) ** 2).sum(0)
        self.limit = slower * slower
        bends = (bend * self.limit > corner) & (bend > STRAIGHT)
        self.limit[bends] = corner / bend[bends]
        self.times = np.zeros(len(length))

    def windows(self, at: int, end: int, entry: float) -> tuple[int, float]:
        """Plan windows of a long stretch; the first move that is left, and its squared entry."""
        while end - at >= WINDOW:
            own = np.arange(at, at + WINDOW)[None]
            inside = np.ones((1, WINDOW), bool)
            highest = min(self._corner, float(self._speed[at + WINDOW - 1]) ** 2)
            entries, speeds = self._speeds(own, inside, np.array([highest]), np.array([entry]))
            settled = np.flatnonzero(entries[0, 1:] + self._climb[own[0]] >= self.limit[own[0]])
            count = max(int(settled[-1]) if len(settled) else 0, WINDOW // 2)
            done = slice(at, at + count)
            self.times[done] = self._seconds(done, speeds[0, :count], speeds[0, 1 : count + 1])
            at, entry = at + count, float(speeds[0, count])
        return at, entry

    def close(self, first: Ints, ends: Ints, entry: Floats) -> None:
        """Plan stretches of less than a window from their squared entries to a stop."""
        count, width = ends - first, 16
        while width <= WINDOW:
            own = np.flatnonzero((count <= width) & ((count > width // 2) | (width == 16)))
            if len(own):
                number = np.arange(width)
                inside = number < count[own, None]
                moves = np.where(inside, first[own, None] + number, first[own, None])
                highest = np.minimum(self._corner, self._speed[ends[own] - 1] ** 2)
                _, speeds = self._speeds(moves, inside, highest, entry[own])
                a, b = speeds[:, :-1][inside], speeds[:, 1:][inside]
                moves = moves[inside]
                self.times[moves] = self._seconds(moves, a, b)
            width *= 2

    def _speeds(
        self, moves: Ints, inside: Mask, highest: Floats, entry: Floats
    ) -> tuple[Floats, Floats]:
        """Squared speeds at the ends of moves, a stretch a row, shape (rows, moves + 1).

        The first are those from which it can slow down in time, down to `highest` at the end; the
        second those that it reaches, too, from `entry`. Each is a smallest value over what comes
        later, or came before, plus what speeds up on the way.
        """
        shape = (len(moves), moves.shape[1] + 1)
        climb, limit = np.zeros(shape), np.full(shape, np.inf)
        climb[:, :-1] = np.where(inside, self._climb[moves], 0.0)
        limit[:, :-1][inside] = self.limit[moves[inside]]
        ahead = np.cumsum(climb[:, ::-1], 1)[:, ::-1]
        least = np.minimum.accumulate((limit - ahead)[:, ::-1], 1)[:, ::-1]
        entries = np.minimum(ahead + np.minimum(least, highest[:, None]), limit)
        speeds = entries.copy()
        speeds[:, 0] = entry
        behind = np.cumsum(climb, 1) - climb
        reached = behind + np.minimum.accumulate(speeds - behind, 1)
        return entries, np.minimum(reached, speeds)

    def _seconds(self, moves: Ints | slice, entry: Floats, leave: Floats) -> Floats:
        length, speed = self._length[moves], self._speed[moves]
        return _seconds(length, speed, entry, leave, self._acceleration[moves])


def _seconds(
    length: Floats, speed: Floats, entry: Floats, leave: Floats, acceleration: Floats | float
) -> Floats:
    """Times of moves between squared speeds of entry and leaving."""
    peak, top = (entry + leave) / 2 + acceleration * length, speed * speed
    ramps = 2 * np.sqrt(np.minimum(peak, top)) - np.sqrt(entry) - np.sqrt(leave)
    return ramps / acceleration + np.maximum(peak - top, 0.0) / (acceleration * speed)
