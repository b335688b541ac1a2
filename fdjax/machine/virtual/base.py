"""What all virtual machines share: time, answers, and what they laid down."""

from abc import ABC, abstractmethod
from collections import deque

from fdjax.formats.profile import Machine
from fdjax.machine.virtual.printed import Print
from fdjax.moves import Move

BOOT = 1.0
"""Seconds that a reboot takes."""
PLANNED = 16
"""Moves that a machine takes before the first of them has ended."""


class AbstractVirtualMachine(ABC):
    """A machine that takes bytes and gives bytes, at times that it is told.

    - `machine`: the profile of the one that it plays; `pace`: seconds that a second of it takes; 0:
      everything happens at once.
    - `executed`: the lines that it ran, without frames, if `keep`; `print`: what it laid down, if
      `record`.
    """

    def __init__(
        self, machine: Machine, *, pace: float = 0.0, keep: bool = False, record: bool = False
    ) -> None:
        self.machine = machine
        self.pace = pace
        self.now = 0.0
        self.executed: list[str] = []
        self.print = Print() if record else None
        self.resets = 0
        self._keep = keep
        self._answers: deque[tuple[float, bytes]] = deque()
        self._planned: deque[float] = deque()  # when each planned move ends
        self._stalled = 0.0
        self._deaf_until = 0.0

    @abstractmethod
    def _take(self, data: bytes) -> None:
        """Take bytes from the line."""

    @abstractmethod
    def _work(self) -> None:
        """Do what is due at `now`."""

    @abstractmethod
    def _forget(self) -> None:
        """Lose everything but what has been laid down."""

    banner = ""
    """Said after booting."""

    def reset(self, now: float) -> None:
        """Reboot: what arrives meanwhile is lost too."""
        self.now = now
        self.resets += 1
        self._planned.clear()
        self._forget()
        self._deaf_until = now + BOOT
        if self.banner:
            self._answers.append((self._deaf_until, self.banner.encode() + b"\n"))

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes from the line, and do what they bring about."""
        self.now = now
        if now >= self._deaf_until:
            self._take(data)
            self.advance(now)

    @abstractmethod
    def _due(self) -> float:
        """When there is something to do; infinity where only bytes can bring it."""

    def next_event(self) -> float:
        """When something will happen by itself; infinity where only bytes can bring it."""
        return self._stalled if self._stalled > self.now else self._due()

    def advance(self, now: float) -> None:
        """Let time pass."""
        self.now = now
        if now >= self._stalled:
            self._work()

    def stall(self, seconds: float) -> None:
        """Do nothing for so long."""
        self._stalled = self.now + seconds

    def answers(self) -> list[tuple[float, bytes]]:
        """What it said since it was asked last, each with its time."""
        said = list(self._answers)
        self._answers.clear()
        return said

    def say(self, text: str) -> None:
        """Answer a line."""
        self._answers.append((self.now, text.encode("ascii", "replace") + b"\n"))

    def _make(self, moves: tuple[Move, ...]) -> float:
        """Make moves; when the last of them could be planned."""
        planned_at = self.now
        for move in moves:
            if self.print is not None:
                self.print.add(move)
            if self.pace:
                seconds = move.seconds or move.length / max(move.speed, 1e-3)
                while self._planned and self._planned[0] <= self.now:
                    self._planned.popleft()
                start = max(self.now, self._planned[-1] if self._planned else self.now)
                self._planned.append(start + seconds * self.pace)
                if len(self._planned) > PLANNED:
                    planned_at = max(planned_at, self._planned.popleft())
        return planned_at

    @property
    def rest_at(self) -> float:
        """When the last move ends."""
        return max(self.now, self._planned[-1]) if self._planned else self.now

    def ran(self, text: str) -> None:
        """Note a line that was run."""
        if self._keep:
            self.executed.append(text)
