"""Faults of a line, by chance but with a seed: what goes wrong with frames and with answers."""

import random
import re
from collections import Counter
from collections.abc import Iterable

TOWARD = ("lose byte", "double byte", "damage byte", "delay")
"""What may happen to a frame on its way to the machine: one of these, to one byte."""
BACK = (
    "lose answer",
    "double answer",
    "lose byte",
    "double byte",
    "damage byte",
    "delay",
    "invent ok",
    "storm",
    "wrong number",
)
"""What may happen to an answer; the last two to a Resend only."""

Pieces = list[tuple[float, bytes]]
_NUMBER = re.compile(rb"\d+")


class Faults:
    """Faults with a rate: so many of the frames, and so many of the answers, suffer one.

    - `toward`, `back`: kinds, of `TOWARD` and `BACK`. `longest`: delay, seconds.
    - `acknowledgement`: what an invented one looks like.
    - `counts`: how often each kind happened.
    """

    def __init__(
        self,
        seed: int,
        rate: float,
        *,
        toward: Iterable[str] = TOWARD,
        back: Iterable[str] = BACK,
        longest: float = 0.5,
        acknowledgement: bytes = b"ok\n",
    ) -> None:
        self._random = random.Random(seed)
        self.rate = rate
        self._toward = tuple(toward)
        self._back = tuple(back)
        self._longest = longest
        self._acknowledgement = acknowledgement
        self.counts: Counter[str] = Counter()

    def toward(self, data: bytes) -> Pieces:
        """What arrives of a write, as pieces with delays."""
        return self._each(data, self._toward, "to the machine: ")

    def back(self, data: bytes) -> Pieces:
        """What arrives of an answer."""
        return self._each(data, self._back, "back: ")

    def _each(self, data: bytes, kinds: tuple[str, ...], where: str) -> Pieces:
        pieces: Pieces = []
        for frame in data.splitlines(keepends=True):
            kind = self._random.choice(kinds) if kinds and self._random.random() < self.rate else ""
            pieces += self._suffer(frame, kind, where)
        return pieces

    def _suffer(self, frame: bytes, kind: str, where: str) -> Pieces:
        chance = self._random
        if kind in ("storm", "wrong number") and not frame.startswith(b"Resend"):
            kind = "damage byte"
        if kind:
            self.counts[where + kind] += 1
        at = chance.randrange(len(frame))
        match kind:
            case "lose byte":
                return [(0.0, frame[:at] + frame[at + 1 :])]
            case "double byte":
                return [(0.0, frame[: at + 1] + frame[at:])]
            case "damage byte":
                other = (frame[at] + chance.randrange(1, 256)) % 256
                return [(0.0, frame[:at] + bytes([other]) + frame[at + 1 :])]
            case "delay":
                return [(chance.uniform(0.0, self._longest), frame)]
            case "lose answer":
                return []
            case "double answer":
                return [(0.0, frame), (0.0, frame)]
            case "invent ok":
                return [(0.0, frame), (0.0, self._acknowledgement)]
            case "storm":
                return [(0.01 * k, frame) for k in range(6)]
            case "wrong number":
                return [(0.0, _NUMBER.sub(b"%d" % chance.randrange(100_000), frame, count=1))]
        return [(0.0, frame)]
