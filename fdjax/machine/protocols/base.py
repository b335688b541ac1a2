"""What all protocols share: lines on their way, answers, patience. No input, output or clock here.

A protocol is driven from outside: `push` takes a line, `out` holds bytes to be written, `feed`
takes bytes that arrived, `tick` says what time it is. All times are seconds of one clock.
"""

import re
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass, field
from typing import ClassVar

from fdjax.errors import StreamError
from fdjax.machine.entry import Entry
from fdjax.moves import Position

LONGEST_ANSWER = 4096
"""Bytes without a line's end that are no answer of any machine."""


LISTEN = 2.5
"""Seconds for a board to boot that reset when the port was opened."""


@dataclass(slots=True)
class Note:
    """Something the machine said: `kind` is temperature, busy, message, fault or position."""

    kind: str
    text: str
    values: dict[str, tuple[float, float]] = field(default_factory=dict)


_TEMPERATURE = re.compile(r"\b([TBC]\d*):\s*(-?\d+\.?\d*)\s*/\s*(-?\d+\.?\d*)")


def temperatures(text: str) -> dict[str, tuple[float, float]]:
    """Actual and set temperature of each heater that a report names, degrees Celsius.

    >>> temperatures("ok T:209.8 /210.0 B:59.9 /60.0 @:12")
    {'T': (209.8, 210.0), 'B': (59.9, 60.0)}
    """
    found = _TEMPERATURE.findall(text)
    return {name: (float(actual), float(wanted)) for name, actual, wanted in found}


_AXIS = re.compile(r"\b([XYZE]):\s*(-?\d+\.?\d*)")


def position(text: str) -> Position | None:
    """x, y, z, e of a report (M114), mm; None where it is none or damaged.

    >>> position("X:10.00 Y:20.00 Z:0.30 E:1.50 Count X:800 Y:1600 Z:120")
    (10.0, 20.0, 0.3, 1.5)
    """
    found = dict(_AXIS.findall(text.partition("Count")[0]))
    if found.keys() != {"X", "Y", "Z", "E"}:
        return None
    return float(found["X"]), float(found["Y"]), float(found["Z"]), float(found["E"])


_SINGLE = 4e-6
"""Share by which sums of filament in single precision may drift in some 60 lines."""


def same(a: Position, b: Position, resolution: float) -> bool:
    """Whether two positions are one, as far as they are known, within what reports resolve, mm."""
    *_, e = b
    slack = (resolution, resolution, resolution, 3 * resolution + _SINGLE * abs(e or 0.0))
    return all(
        p is None or q is None or abs(p - q) <= most for p, q, most in zip(a, b, slack, strict=True)
    )


def reports_heat(text: str) -> bool:
    """Whether an answer begins with temperatures, behind its `ok` or without one.

    >>> reports_heat("ok B:60.0 /60.0 T0:205.0 /210.0"), reports_heat("echo:T:1 /2")
    (True, False)
    """
    return _TEMPERATURE.match(text.removeprefix("ok").lstrip()) is not None


class AbstractProtocol(ABC):
    """How lines reach one kind of firmware, each once and in order.

    - `guarantee`: what it promises, and under which faults.
    - `pending`: lines sent and not acknowledged, `pushed`: how many there were in all;
      `acknowledged`: how many were, and `line` the last of them that is the file's.
    - `proven`, `proven_line`: the same of those that certainly ran, whatever became of answers.
    - `ready`: whether the hand-shake is over; `finished`: whether all that was pushed has run.
    - `facts`: what the machine says of itself.
    """

    guarantee: ClassVar[str]
    firmware: ClassVar[str]
    patience: ClassVar[float] = 10.0
    """Seconds without a sign of life, beyond what the lines on their way may take."""
    tries: ClassVar[int] = 8
    """How often in a row help is asked for before giving up."""

    out: bytearray

    def __init__(self) -> None:
        self.out = bytearray()
        self.notes: deque[Note] = deque()
        self.facts: dict[str, str] = {}
        self.pending: deque[Entry] = deque()
        self.acknowledged = self.line = 0
        self.proven = self.proven_line = 0
        self.pushed = 0
        self.ready = False
        self._rest = b""
        self._deadline = 0.0
        self._tried = 0
        self._recent: deque[float] = deque(maxlen=24)  # what the machine may still be moving

    # What a stream calls.

    @abstractmethod
    def open(self, now: float) -> None:
        """Begin the hand-shake."""

    @abstractmethod
    def room(self, text: str) -> bool:
        """Whether a further line may be sent now."""

    def push(self, entry: Entry, now: float) -> None:
        """Send a line, for which there is room."""
        self.pushed += 1
        self.pending.append(entry)
        self._recent.append(entry.seconds)
        self._send(entry)
        if len(self.pending) == 1:
            self._wait(now)

    @abstractmethod
    def finish(self, now: float) -> None:
        """Make sure that all that was pushed has run: then `finished` is true."""

    @property
    def finished(self) -> bool:
        return not self.pending

    @property
    def deadline(self) -> float:
        """When `tick` has something to do."""
        return self._deadline if self.pending or not self.ready else float("inf")

    def feed(self, data: bytes, now: float) -> None:
        """Take bytes that arrived. Raises `StreamError` where the stream cannot go on."""
        lines = (self._rest + data).split(b"\n")
        self._rest = lines.pop()[-LONGEST_ANSWER:]
        for raw in lines:
            text = raw.decode("ascii", "replace").strip("\r \t\0")
            if text:
                self.answer(text, now)

    def tick(self, now: float) -> None:
        """Do what is due."""
        if now >= self.deadline:
            self._tried += 1
            if self._tried > self.tries:
                raise self.stopped("no answer from the machine")
            self.overdue(now)
            if self.ready:  # a greeting has a patience of its own
                self._wait(now)

    def doubt(self, now: float) -> None:
        """The line was broken: find out soon what became of the lines on their way."""
        self._wait(now, LISTEN)

    def farewell(self) -> bytes:
        """What is said when all has run, so that the machine is as it was."""
        return b""

    def bare(self, text: str) -> bytes:
        """A line that is sent beside all others, whatever became of them."""
        return f"{text}\n".encode()

    # What a protocol does.

    @abstractmethod
    def _send(self, entry: Entry) -> None:
        """Put a line's bytes into `out`."""

    @abstractmethod
    def answer(self, text: str, now: float) -> None:
        """Take a line that the machine said."""

    @abstractmethod
    def overdue(self, now: float) -> None:
        """Nothing came for too long: find out what became of the lines on their way."""

    # What protocols use.

    def _wait(self, now: float, seconds: float | None = None) -> None:
        """Be patient from now on: for as long as the lines may take, once that is over for less."""
        if seconds is None:
            slow = 2 * (sum(entry.seconds for entry in self.pending) + sum(self._recent))
            slow += max((entry.waits for entry in self.pending), default=0.0)
            seconds = self.patience + (0 if self._tried else slow)
        self._deadline = now + seconds

    def _done(self, count: int, now: float) -> None:
        """So many of the oldest lines are acknowledged."""
        for _ in range(count):
            self.line = self.pending.popleft().line or self.line
        self.acknowledged += count
        self._tried = 0
        self._wait(now)

    def _prove(self) -> None:
        """All that is acknowledged has certainly run."""
        self.proven, self.proven_line = self.acknowledged, self.line

    def _lives(self, now: float) -> None:
        """The machine speaks of what it is doing: more patience, if it has reason to take long.

        Reports that come by themselves are no reason, or a lost `ok` would never be missed.
        """
        if self.pending and self.pending[0].waits:
            self._tried = 0
            self._wait(now)

    def _note(self, kind: str, text: str) -> None:
        self.notes.append(Note(kind, text, temperatures(text)))

    def stopped(self, why: str, *, line: int = 0) -> StreamError:
        """The error that ends the stream; the stream itself adds the lines' numbers.

        `line` is the one that is to blame, where that is known.
        """
        return StreamError(why, line=line)


def is_ok(text: str) -> bool:
    """Whether an answer is an acknowledgement: `ok` at its start, as a word of its own.

    >>> is_ok("ok T:20.0 /0.0"), is_ok("T:20.0 /0.0 ok"), is_ok("okay")
    (True, False, False)
    """
    return text[:2] == "ok" and not text[2:3].isalnum()


def checksum(text: str) -> int:
    """XOR of all bytes.

    >>> checksum("N13 G1 X1 Y20 Z0.35 F5000.0")
    55
    """
    result = 0
    for byte in text.encode("ascii", "replace"):
        result ^= byte
    return result
