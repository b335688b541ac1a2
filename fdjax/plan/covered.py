"""Where roads cover a layer, seen from above, found by scan lines."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdjax.plan.segments import Segments

Floats = NDArray[np.float64]

_ANGLE = 0.4
"""Direction of the scan lines, radians: roads seldom run along it."""
_FLAT = 1e-300
"""mm; a road that rises less along the scan lines' normal is taken to rise so much."""


class Covered(NamedTuple):
    """Stretches of scan lines that lie under beads, none over another.

    - `start`, `end`: shape (n, 2), mm; `area`: that each stands for, shape (n,), mm^2.
    """

    start: Floats
    end: Floats
    area: Floats

    @classmethod
    def by(cls, segments: Segments, step: float | None = None) -> "Covered":
        """What these segments' beads cover: as wide as they are, with round ends.

        - `step`: distance of the scan lines, mm, by default a fifth of the narrowest bead. Along
          itself each is exact.
        """
        if not len(segments.length):
            return cls(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
        step = step or fine_step(segments)
        turn = np.array([[np.cos(_ANGLE), -np.sin(_ANGLE)], [np.sin(_ANGLE), np.cos(_ANGLE)]])
        scan, low, high = _united(*_chords(segments, turn, step))
        y = (scan + 0.5) * step
        ends = np.asarray(np.stack([low, y, high, y], 1).reshape(-1, 2) @ turn.T, np.float64)
        return cls(ends[::2], ends[1::2], step * (high - low))


def fine_step(segments: Segments) -> float:
    """A fifth of the narrowest bead, mm; of beads that differ much a twentieth of the median."""
    width = float(segments.width.min())
    if width < segments.width.max() / 4:
        width = max(width, float(np.median(segments.width)) / 4)
    return width / 5


def _chords(
    segments: Segments, turn: Floats, step: float
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """The number of a scan line and the ends on it, mm, of each bead that it meets."""
    (ax, ay), (bx, by) = (turn.T @ points.T for points in (segments.start, segments.end))
    radius = segments.width / 2
    # Scan lines lie at (k + 1/2) step; a stadium is met by those from `first` to `last`.
    first = np.ceil((np.minimum(ay, by) - radius) / step - 0.5).astype(int)
    last = np.floor((np.maximum(ay, by) + radius) / step - 0.5).astype(int)
    count = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(count)), count)
    scan = np.arange(len(owner)) + (first - np.cumsum(count) + count)[owner]
    ahead = (scan + 0.5) * step - ay[owner]
    # The chord ends on the side of the stadium that faces it, or on the disc at that side's end.
    rise = by - ay
    rise[np.abs(rise) < _FLAT] = _FLAT
    side = np.copysign(radius, rise) * (bx - ax) / segments.length
    radius, side, rise = radius[owner], side[owner], rise[owner]
    origin, run = ax[owner], (bx - ax)[owner]
    ends = []
    for sign in (-1, 1):
        share = np.clip((ahead + sign * side) / rise, 0, 1)
        aside = ahead - share * rise
        half = np.sqrt(np.maximum(radius * radius - aside * aside, 0))
        ends.append(share * run + sign * half + origin)
    return scan, ends[0], ends[1]


def _united(
    scan: NDArray[np.intp], low: Floats, high: Floats
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """The union of intervals, scan line by scan line."""
    if not len(scan):
        return scan, low, high
    base = int(scan.min())
    scan = scan - base
    # Line by line roads come nearly in order, which a stable sort makes use of.
    lines = scan.astype(np.uint16) if scan.max() < 1 << 16 else scan
    order = np.argsort(lines, kind="stable")
    # Scan lines laid end to end, far enough apart not to touch.
    apart, origin = high.max() - low.min() + 1.0, low.min()
    shift = scan * apart - origin
    low, high = ((each + shift)[order] for each in (low, high))
    low.sort(kind="stable")
    high.sort(kind="stable")
    # There is a gap where as many intervals have ended as have begun.
    gap = low[1:] > high[:-1]
    low, high = low[np.concatenate([[True], gap])], high[np.concatenate([gap, [True]])]
    scan = np.floor(low / apart).astype(int)
    shift = scan * apart - origin
    return scan + base, low - shift, high - shift
