"""The port of a virtual machine, with a clock of its own and the faults of a line."""

import time
from collections import deque

from fdjax.machine.port import AbstractPort, PortLost
from fdjax.machine.virtual.base import AbstractVirtualMachine
from fdjax.machine.virtual.faults import Faults


class VirtualPort(AbstractPort):
    """A line to a virtual machine.

    - `realtime`: waits take the time they say; else the clock jumps to whatever happens next.
    - `accident`: (frame, kind), what happens when so many frames have been written: `reset`,
      `stall` (`seconds` long) or `unplug`; `returns`: whether an unplugged line comes back.
    """

    def __init__(
        self,
        machine: AbstractVirtualMachine,
        *,
        faults: Faults | None = None,
        realtime: bool = False,
        accident: tuple[int, str] | None = None,
        seconds: float = 30.0,
        returns: bool = True,
    ) -> None:
        self.machine = machine
        self.faults = faults
        self._realtime = realtime
        self._began = time.monotonic()
        self._now = 0.0
        self._accident = accident
        self._seconds = seconds
        self._returns = returns
        self._frames = 0
        self._lost = False
        self._toward: deque[tuple[float, bytes]] = deque()
        self._back: deque[tuple[float, bytes]] = deque()

    def now(self) -> float:
        return time.monotonic() - self._began if self._realtime else self._now

    def write(self, data: bytes) -> None:
        self._check()
        now = self.now()
        if self.faults is None and self._accident is None and not self._toward:
            self.machine.receive(data, now)
            return
        for delay, piece in [(0.0, data)] if self.faults is None else self.faults.toward(data):
            # A line keeps the order of its bytes: what follows a late one is late too.
            due = max(now + delay, self._toward[-1][0] if self._toward else now)
            self._toward.append((due, piece))
        self._deliver(now)

    def _check(self) -> None:
        if self._lost:
            raise PortLost("the virtual line is gone")

    def _deliver(self, now: float) -> None:
        while self._toward and self._toward[0][0] <= now:
            _, piece = self._toward.popleft()
            self._frames += piece.count(b"\n")
            self.machine.receive(piece, now)
            if self._accident is not None and self._frames >= self._accident[0]:
                kind, self._accident = self._accident[1], None
                self._happen(kind, now)

    def _happen(self, kind: str, now: float) -> None:
        if kind == "reset":
            self.machine.reset(now)
        elif kind == "stall":
            self.machine.stall(self._seconds)
        else:
            self._lost = True
            self._toward.clear()
            self._back.clear()
            raise PortLost("the virtual line is gone")

    def _collect(self, now: float) -> None:
        self.machine.advance(now)
        for said_at, data in self.machine.answers():
            for delay, piece in [(0.0, data)] if self.faults is None else self.faults.back(data):
                due = max(said_at + delay, self._back[-1][0] if self._back else said_at)
                self._back.append((due, piece))

    def read(self, seconds: float) -> bytes:
        self._check()
        until = self.now() + seconds
        while True:
            now = self.now()
            self._deliver(now)
            self._collect(now)
            arrived = b""
            while self._back and self._back[0][0] <= now:
                arrived += self._back.popleft()[1]
            if arrived or now >= until:
                return arrived
            queues = [queue[0][0] for queue in (self._toward, self._back) if queue]
            self._pass(min(until, self.machine.next_event(), *queues) - now)

    def _pass(self, seconds: float) -> None:
        if self._realtime:
            time.sleep(max(seconds, 1e-4))
        else:
            self._now += max(seconds, 1e-9)

    def wait(self, seconds: float) -> None:
        self._pass(seconds)

    def close(self) -> None:
        self._lost = True

    def reopen(self) -> bool:
        self._lost = not self._returns
        return self._returns
