"""The time that moves take, planned as a printer's firmware plans them."""

from collections.abc import Mapping
from math import sqrt

from fdjax.moves import Move

WINDOW = 512
"""Moves looked at together; half as many are looked ahead at least. Firmware has 16 or more."""
STRAIGHT = 1e-12
"""Square of the bend, in radians, that is the rounding of a straight line."""

_REST = (0.0, 0.0, 0.0)


class MotionTime:
    """Adds up the time of moves: constant acceleration, look-ahead, and a speed limit at corners.

    Between two moves with unit directions u and w the speed is at most the slower of the two, and
    at most `corner_speed` / |w - u|: the change of velocity that is made at once. A stop has u or
    w = 0. This is the classic jerk of Marlin (planner.cpp, `max_jerk`), taken of the vector as its
    first versions did in XY, not axis by axis. Where the next moves are too short to slow down in,
    a backward pass lowers the speeds and a forward pass bounds what can be reached (as grbl's
    planner.c has it); each move then has a trapezoid of speed, or a triangle.

    `acceleration` is in mm/s^2, until `accelerate` sets others, and `corner_speed` in mm/s. Moves
    of filament alone go from stop to stop.

    >>> time = MotionTime(acceleration=1000.0, corner_speed=0.0)
    >>> time.add(Move((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), 50.0))
    >>> time.flush()
    >>> time.seconds
    2.05
    """

    def __init__(self, acceleration: float, corner_speed: float) -> None:
        self.seconds = 0.0
        self.marks: list[float] = []
        self._road = self._travel = self._filament = acceleration
        self._corner = corner_speed**2
        # Squared entry at most, mm, mm/s, and mm/s^2.
        self._pending: list[tuple[float, float, float, float]] = []
        self._open: list[int] = []  # moves pending before each mark
        self._direction = _REST
        self._speed = 0.0  # of the last move added
        self._entry = 0.0  # squared, of the first move pending

    def accelerate(self, accelerations: Mapping[str, float]) -> None:
        """From now on with these, mm/s^2: P of roads, T of travel, R of filament alone (M204)."""
        self._road = accelerations.get("P", self._road)
        self._travel = accelerations.get("T", self._travel)
        self._filament = accelerations.get("R", self._filament)

    def add(self, move: Move) -> None:
        """Take one more move; its time is part of `seconds` at the latest after `flush`."""
        (a, b, c), (x, y, z), speed, volume, wait = move
        if wait:
            self.flush()
            self.seconds += self._alone(wait * speed, speed) if speed else wait
            return
        x -= a
        y -= b
        z -= c
        length = sqrt(x * x + y * y + z * z)
        if not length:
            return
        x /= length
        y /= length
        z /= length
        a, b, c = self._direction
        bend = (x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2
        slower = self._speed if 0.0 < self._speed < speed else speed
        entry = slower * slower
        if bend * entry > self._corner and bend > STRAIGHT:
            entry = self._corner / bend
        self._direction = (x, y, z)
        self._speed = speed
        pending = self._pending
        if not pending:
            self._entry = entry
        pending.append((entry, length, speed, self._road if volume else self._travel))
        if len(pending) >= WINDOW:
            self._plan()

    def mark(self) -> None:
        """Have the time at the end of the moves so far put into `marks`, once it is known."""
        if self._pending:
            self._open.append(len(self._pending))
        else:
            self.marks.append(self.seconds)

    def flush(self) -> None:
        """Come to a stop after the moves so far."""
        if self._pending:
            self._plan(stop=True)
        self._direction, self._speed = _REST, 0.0

    def _alone(self, length: float, speed: float) -> float:
        end = min(self._corner, speed * speed)
        return _seconds(length, speed, end, end, self._filament)

    def _plan(self, *, stop: bool = False) -> None:
        """Finish the moves whose speeds nothing that is still to come can change."""
        pending = self._pending
        count = len(pending)
        entries = [0.0] * (count + 1)
        entries[count] = squared = min(self._corner, self._speed**2)  # as if to stop at the end
        settled = 0
        for k in range(count - 1, -1, -1):
            limit, length, _, acceleration = pending[k]
            squared += 2 * acceleration * length
            if squared >= limit:
                squared = limit
                settled = settled or k
            entries[k] = squared
        last = count if stop else max(settled, count // 2)
        done = 0
        while self._open and self._open[0] <= last:
            at = self._open.pop(0)
            self._finish(done, at, entries)
            self.marks.append(self.seconds)
            done = at
        self._finish(done, last, entries)
        self._open = [at - last for at in self._open]
        del pending[:last]

    def _finish(self, first: int, last: int, entries: list[float]) -> None:
        """Add the time of pending moves; `entries` are squared speeds between them, at most."""
        entry, total = self._entry, 0.0
        for k in range(first, last):
            _, length, speed, acceleration = self._pending[k]
            leave = min(entries[k + 1], entry + 2 * acceleration * length)
            total += _seconds(length, speed, entry, leave, acceleration)
            entry = leave
        self._entry = entry
        self.seconds += total


def _seconds(length: float, speed: float, entry: float, leave: float, acceleration: float) -> float:
    """Time of one move between squared speeds of entry and leaving."""
    peak = (entry + leave) / 2 + acceleration * length
    if peak <= speed * speed:
        return (2 * sqrt(peak) - sqrt(entry) - sqrt(leave)) / acceleration
    ramps = (2 * speed - sqrt(entry) - sqrt(leave)) / acceleration
    return ramps + (peak - speed * speed) / (acceleration * speed)
