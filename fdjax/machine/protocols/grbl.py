"""grbl: what is on its way never exceeds the machine's receive buffer.

Where status reports (`?`) have a Bf field, they say how many bytes the machine has not read yet: a
burst of lines goes out when it has read everything, and no answer that is lost or made up can
change that. Without the field, which is how grbl comes, characters are counted: `ok` releases the
oldest line; where none comes for long, a machine that is idle has run everything.
"""

import re

from fdjax.machine.entry import Entry
from fdjax.machine.protocols.base import AbstractProtocol, is_ok, same
from fdjax.moves import Position

BUFFER = 127
"""Bytes on their way: one less than the receive buffer."""
_RESOLUTION = 0.0015
_POLL = 0.02
_STATUS = re.compile(r"<(\w+)[^<>]*>$")
_BUFFER = re.compile(r"\|Bf:(\d+),(\d+)[|>]")
_NUMBER = r"(-?\d+\.\d+)"
_THREE = rf"{_NUMBER},{_NUMBER},{_NUMBER}[|>]"
_PLACE = re.compile(rf"\|([WM])Pos:{_THREE}")
_BETWEEN = re.compile(rf"\|WCO:{_THREE}")
_BANNER = ("Grbl", "['$'", "for help")


class GrblProtocol(AbstractProtocol):
    """See the module."""

    firmware = "grbl"
    guarantee = (
        "each line once and in order, or a stop, under answers lost, doubled, damaged, delayed or "
        "made up, and under stalls, disconnects and resets; bytes to the machine do not change. "
        "Without Bf in status reports ($10), no answer may be made up"
    )

    def __init__(self) -> None:
        super().__init__()
        self._bytes = 0  # of the lines on their way
        self._counts = False  # status reports have a Bf field
        self._size = 128  # of the receive buffer
        self._asked = False
        self._polling = False
        self._between: tuple[float, ...] | None = None  # machine's place less the file's
        self._elsewhere: Position | None = None
        self._expected: Position = (None, None, None, None)  # after the last line

    def open(self, now: float) -> None:
        self.out += b"\n?"
        self._wait(now, 2.0)

    def room(self, text: str) -> bool:
        busy = self._asked or self._polling  # a burst is complete when the status is asked for
        fits = not busy and self._bytes + len(text) + 1 <= BUFFER
        return self.ready and (fits or not self.pending)

    def _send(self, entry: Entry) -> None:
        self._expected = entry.after
        self._bytes += len(entry.text) + 1
        self.out += f"{entry.text}\n".encode("ascii", "replace")

    def finish(self, now: float) -> None:
        """The status is asked for after every burst, so after the last one too."""

    def tick(self, now: float) -> None:
        if self._counts and self.pending and not self._asked and not self._polling:
            self._ask(now)
        if self._polling and now >= self._deadline:
            self._ask(now)
        super().tick(now)

    def _ask(self, now: float) -> None:
        self.out += b"?"
        self._asked, self._polling = True, False
        self._wait(now)

    def answer(self, text: str, now: float) -> None:
        if any(piece in text for piece in _BANNER):
            if self.pushed:
                raise self.stopped(f"the machine has been reset: {text}")
            self.facts["FIRMWARE_NAME"] = text.partition(" [")[0]
        elif is_ok(text):
            if self.pending and not self._counts:
                self._release(1, now)
                self._prove()
        elif text.startswith("error:") and self.pushed:
            oldest = 0 if self._counts or not self.pending else self.pending[0].line
            raise self.stopped(f"the machine refused a line: {text}", line=oldest)
        elif text.startswith("ALARM"):
            raise self.stopped(f"the machine stopped itself: {text}")
        elif found := _STATUS.match(text):
            self._status(found[1], text, now)
        else:
            self._note("message", text)

    def _release(self, count: int, now: float) -> None:
        for entry in list(self.pending)[:count]:
            self._bytes -= len(entry.text) + 1
        self._done(count, now)

    def _status(self, state: str, text: str, now: float) -> None:
        self._note("position", text)
        if state in ("Alarm", "Door", "Sleep"):
            raise self.stopped(f"the machine is in state {state}")
        found, here = _BUFFER.search(text), self._place(text)
        if not self.ready:
            self.ready, self._counts = True, found is not None
            self._size = max(self._size, int(found[2])) if found else self._size
            return
        if not self._asked or (found is None and self._counts):
            return
        self._asked = False
        self._tried = 0
        if found is None and state != "Idle":
            self._wait(now)
            return
        if found is not None and self._size - int(found[2]) > 0:
            self._polling = True
            self._deadline = now + _POLL
            return
        if state == "Idle" and here is not None and not same(here, self._expected, _RESOLUTION):
            if here == self._elsewhere:
                raise self.stopped("the machine stands elsewhere than the file says")
            self._elsewhere, self._polling = here, True  # a report may be damaged
            self._deadline = now
            return
        self._release(len(self.pending), now)
        self._prove()

    def _place(self, text: str) -> Position | None:
        """Where the machine is, as the file counts; None where a report does not tell.

        What lies between its own count and the file's, it says now and then only (WCO), and at
        once where that has changed.
        """
        if found := _BETWEEN.search(text):
            self._between = tuple(map(float, found.groups()))
        found = _PLACE.search(text)
        if found is None or (found[1] == "M" and self._between is None):
            return None
        shift = self._between if found[1] == "M" and self._between else (0.0, 0.0, 0.0)
        x, y, z = (float(value) - by for value, by in zip(found.groups()[1:], shift, strict=True))
        return x, y, z, None

    def overdue(self, now: float) -> None:
        if not self.ready:
            self.open(now)
        else:
            self._ask(now)
