"""SML over a serial line in the way of the Asymtek language: ENQ and ACK, XON and XOFF, `?`.

The machine's buffer holds 256 bytes. A block goes out when two enquiries in a row were answered and
no further answer comes: one answer that nobody gave cannot overfill the buffer, nor can two.
CR and LF do nothing but take room, so a buffer's worth of them proves that all before was run.
A machine that was reset has lost what was in it, and refuses what is a motion's until it is homed:
so the last rate is said again, and run, before the file homes the machine, and at its end.

That Stratasys machines do all this is an inference from the language's kinship (see the profile).
"""

import re
from typing import ClassVar

from fdjax.machine.entry import Entry
from fdjax.machine.protocols.base import AbstractProtocol

ENQ, ACK, XON, XOFF, ERROR = b"\x05", b"\x06", b"\x11", b"\x13", b"?"
BUFFER = 256
BLOCK = 64
QUIET = 0.02
_RATE = re.compile(r"SR\d+;")


class SmlProtocol(AbstractProtocol):
    """See the module; `handshake` as in the profile."""

    firmware = "sml"
    guarantee = (
        "each line once and in order, or a stop, under answers lost, doubled, damaged, delayed or "
        "made up (at most two in a row), and under stalls, disconnects and resets after which the "
        "machine wants to be homed; bytes to the machine do not change. The rate in force is said "
        "again before the machine is homed and at the end"
    )
    patience: ClassVar[float] = 5.0

    def __init__(self, handshake: tuple[str, ...] = ("enq-ack",)) -> None:
        super().__init__()
        self._enquires = "enq-ack" in handshake
        self._block = 0  # bytes of the block that is going out
        self._answers = 0  # of the enquiries after it
        self._enquiring = False
        self._quiet = False  # waiting for answers too many
        self._held = False  # by XOFF
        self._behind: list[tuple[int, int, int]] = []  # bytes accepted, count, line
        self._accepted = 0  # bytes
        self._left = b""  # of a line longer than a block
        self._rate = b""  # the last one
        self._checking = self._checked = False  # whether the machine still takes it
        self._silent = False  # it was, since the check began

    def open(self, now: float) -> None:
        self.out += b"\r\n"
        if self._enquires:
            self._enquire(now)
        else:
            self.ready = True

    def room(self, text: str) -> bool:
        if not self.ready or self._held or self._left:
            return False
        if not self._enquires:
            return not self.pending
        closed = self._enquiring or self._quiet
        if "FH" in text and self._rate and not self._checked:
            if not closed and self._block == 0:
                self._check()
            return False
        return not closed and (self._block == 0 or self._block + len(text) + 1 <= BLOCK)

    def _send(self, entry: Entry) -> None:
        text = f"{entry.text}\n".encode("ascii", "replace")
        self._checked = False
        self._left += text
        for rate in _RATE.findall(entry.text):
            self._rate = f"{rate}\n".encode()
        self._put()

    def _check(self) -> None:
        """Have the rate run again: twice, as one `?` may be lost."""
        self._checking, self._silent = True, False
        self._left = 2 * self._rate + b"\n" * BUFFER
        self._put()

    def _put(self) -> None:
        count = BLOCK - self._block if self._enquires else len(self._left)
        piece, self._left = self._left[:count], self._left[count:]
        self.out += piece
        self._block += len(piece)

    def tick(self, now: float) -> None:
        idle = not (self._enquiring or self._quiet or self._held)
        if self.ready and self._block and idle:
            if self._enquires:
                self._enquire(now)
            else:
                self._taken(now)
        super().tick(now)

    @property
    def finished(self) -> bool:
        checked = self._checked or not (self._rate and self._enquires)
        return not self.pending and self.proven == self.acknowledged and checked

    def finish(self, now: float) -> None:
        """Push the last line out of the machine's buffer with what does nothing."""
        if self.pending or self.finished or self._block:
            return
        if not self._enquires:
            self._prove()
        elif not (self._enquiring or self._quiet or self._held):
            if self._rate:
                self._check()
                return
            self.out += b"\n" * BLOCK
            self._block = BLOCK

    @property
    def deadline(self) -> float:
        waiting = self._enquiring or self._quiet or self._held or not self.ready
        return self._deadline if waiting else float("inf")

    def _enquire(self, now: float) -> None:
        self.out += ENQ
        self._enquiring = True
        self._wait(now)

    def feed(self, data: bytes, now: float) -> None:
        for byte in data:
            one = bytes([byte & 0x7F])
            if one == ACK:
                self._acknowledged(now)
            elif one == XOFF:
                self._held = True
                self._wait(now)
            elif one == XON:
                self._held = False
            elif one == ERROR:
                raise self.stopped("the machine answers `?`: it refused a command")

    def answer(self, text: str, now: float) -> None:
        """Answers are single bytes."""

    def _acknowledged(self, now: float) -> None:
        self._tried = 0
        if self._quiet:
            self._deadline = now + QUIET
            return
        if not self._enquiring:
            return
        self._answers += 1
        if self._answers < 2:
            self._enquire(now)
        else:
            self._enquiring, self._quiet = False, True
            self._deadline = now + QUIET

    def overdue(self, now: float) -> None:
        if self._quiet:
            self._tried -= 1
            self._quiet = False
            self._answers = 0
            self.ready = True
            self._taken(now)
        else:
            self._held = False
            self._silent = True
            self._enquire(now)

    def _taken(self, now: float) -> None:
        """The block is in the machine's buffer."""
        self._accepted += self._block
        self._block = 0
        if self._left:
            self._put()
            return
        if self._checking and self._silent:
            self._check()
            return
        self._checked, self._checking = self._checking, False
        self._done(len(self.pending), now)
        self._behind.append((self._accepted, self.acknowledged, self.line))
        while self._behind and self._behind[0][0] + BUFFER <= self._accepted:
            _, self.proven, self.proven_line = self._behind.pop(0)
