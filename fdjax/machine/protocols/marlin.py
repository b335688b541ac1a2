"""Marlin: numbered, checksummed lines; the machine itself refuses what is out of order.

Sources: the serial protocol of Marlin 2 (M110, Resend, busy, ADVANCED_OK) and its command queue.

A `Resend` is a hint; it is proof where its error names the last line too, or where it comes again.
Lines stay at hand after they are acknowledged, so that a made-up `ok` can be taken back. The last
line of all is sent twice, for the machine to refuse it and so to prove that it has everything.
"""

import re
from collections import deque

from fdjax.machine.entry import Entry
from fdjax.machine.protocols.base import (
    AbstractProtocol,
    checksum,
    is_ok,
    position,
    reports_heat,
    same,
)
from fdjax.moves import Position

BUFFER = 127
"""Bytes that the machine's serial buffer holds, as a rule."""
GROWTH = 1 / 64
"""Bytes by which each line that arrives well lets more be in flight, after faults let less."""
QUIET = 0.1
"""Seconds of silence after which a flood of errors is over."""

_LAST = re.compile(r"Last Line:\s*(\d+)")
_EXPECTED = re.compile(r"expected line (\d+)")
_RESEND = re.compile(r"(?:resend|rs):?\s*N?(\d+)$", re.IGNORECASE)
_OK = re.compile(r"ok N(\d+)(?: P\d+)?(?: B(\d+))?(?: T:.*)?$")
_FACT = re.compile(r"(Cap:\w+|FIRMWARE_NAME):\s?(.*?)(?=\s+[A-Z_]+:|$)")
_HALTED = re.compile(
    r"halted|stopped due to errors|kill\(\)|thermal|m(ax|in)temp|heating failed", re.IGNORECASE
)
_KEPT = 512
_MOST_RESENDS = 40
_RESOLUTION = 0.006


class MarlinProtocol(AbstractProtocol):
    """See the module."""

    firmware = "marlin"
    guarantee = (
        "each line once and in order, or a stop, under bytes lost, doubled, damaged (one a frame) "
        "or delayed both ways, and answers lost, doubled or made up"
    )

    def __init__(self) -> None:
        super().__init__()
        self._number = 0  # of the last line that the machine is thought to have
        self._in_flight = 0  # so many of the pending lines have been sent
        self._bytes = 0  # of the lines in flight
        self._kept: deque[Entry] = deque(maxlen=_KEPT)  # acknowledged, the last one last
        self._slots = 1  # lines that may be in flight, and bytes of them
        self._most = float(BUFFER)
        self._goal: tuple[int, bool] | None = None  # number asked for, and whether that is proof
        self._last: int | None = None  # of the error before a Resend
        self._hint: int | None = None  # what was asked for the time before
        self._cut = False  # that error said that a line came without its end
        self._resends = 0
        self._furthest = 0
        self._proving = False
        self._known = False  # it has answered to M115
        self._suspect: Entry | None = None  # may have been run, without its number
        self._places: list[Position] = []  # that the machine reported since

    def open(self, now: float) -> None:
        frame = "N0 M110 N0"
        self.out += f"\n{frame}*{checksum(frame)}\n".encode()
        self._wait(now, 2.0)

    def room(self, text: str) -> bool:
        if not self.ready or self._recovering or self._in_flight < len(self.pending):
            return False
        if self.pending and self.pending[-1].waits:
            return False  # nothing stands behind a heat-up, so that it can be broken off
        fits = self._bytes + len(text) + 16 <= self._most
        return not self.pending or (fits and len(self.pending) < self._slots)

    @property
    def _recovering(self) -> bool:
        return self._goal is not None or self._proving or self._suspect is not None

    def _frame(self, number: int, entry: Entry) -> bytes:
        body = f"N{number} {entry.text}"
        return f"{body}*{checksum(body)}\n".encode("ascii", "replace")

    def _send(self, entry: Entry) -> None:
        self._in_flight += 1
        frame = self._frame(self._number + self._in_flight, entry)
        self._bytes += len(frame)
        self.out += frame

    def _send_waiting(self) -> None:
        """Lines that are sent again go one by one."""
        if self._in_flight == 0 and self.pending:
            self._bytes = 0
            self._send(self.pending[0])

    @property
    def finished(self) -> bool:
        return not self.pending and self.proven == self.pushed

    def finish(self, now: float) -> None:
        if not self.pending and self.proven < self.pushed and not self._proving:
            self._proving = True
            self._ask(now)

    @property
    def deadline(self) -> float:
        waiting = self.pending or not self.ready or self._recovering
        return self._deadline if waiting else float("inf")

    # Answers.

    def answer(self, text: str, now: float) -> None:
        if self._goal is not None:
            self._wait(now, QUIET)
        if is_ok(text):
            self._note_heat(text)
            self._ok(text, now)
        elif found := _LAST.search(text):
            self._last, self._cut = int(found[1]), "no checksum" in text.lower()
        elif found := _EXPECTED.search(text):  # Repetier and its kin
            self._last, self._cut = int(found[1]) - 1, False
        elif found := _RESEND.match(text):
            last, self._last = self._last, None
            self._asked_for(int(found[1]), last, now)
        elif text == "start":
            if self.proven:
                raise self.stopped("the machine says `start`: it has rebooted")
            # It reset when the port was opened, and took its time.
            self.ready, self._in_flight, self.pushed = False, 0, 0
            self.pending.clear()
            self.open(now)
        elif "busy" in text or "paused for user" in text or reports_heat(text):
            self._note("temperature" if reports_heat(text) else "busy", text)
            if self._goal is not None:
                return
            if reports_heat(text):
                self._lives(now)
            else:
                self._tried = 0
                self._wait(now)
        elif text == "wait":
            if self.pending and self.ready and self._goal is None:
                self._goal = (-1, False)  # it waits for what we wait for: an answer was lost
                self._wait(now, QUIET)
        elif (place := position(text)) is not None:
            self._note("position", text)
            self._places.append(place)
        else:
            self._said(text, now)

    def _note_heat(self, text: str) -> None:
        if reports_heat(text):
            self._note("temperature", text)

    def _said(self, text: str, now: float) -> None:
        if text.startswith(("Error:", "!!")) and _HALTED.search(text):
            raise self.stopped(f"the machine halted: {text}")
        self.facts.update(_FACT.findall(text))
        self._known = self._known or "FIRMWARE_NAME" in text
        odd = text.startswith("Error:") or "prevented" in text or "Unknown command" in text
        self._note("fault" if odd else "message", text)

    def _ok(self, text: str, now: float) -> None:
        if not self.ready:
            self.ready = True
            self.push(Entry("M115", repeatable=True), now)  # its answer proves that numbers hold
            return
        if self._goal is not None or self._proving:
            return
        if self.proven == 0:
            if self._known and self.pending:
                self._take(1, now)
                self._prove()
            return
        advanced = _OK.match(text)
        if advanced is not None:
            count = int(advanced[1]) - self._number
            if 0 < count <= self._in_flight:
                self._take(count, now)
                self._prove()
                if advanced[2] is not None and not self.pending:
                    self._slots = max(1, min(int(advanced[2]), 8))
        elif self._in_flight:
            reported = reports_heat(text) and self.pending[0].text == "M105"
            self._take(1, now)
            if reported:
                self._prove()  # nothing else is answered so

    def _take(self, count: int, now: float) -> None:
        """The machine has so many more lines."""
        for entry in list(self.pending)[:count]:
            self._number += 1
            self._bytes = max(0, self._bytes - len(self._frame(self._number, entry)))
            self._kept.append(entry)
        self._in_flight = max(0, self._in_flight - count)
        self._most = min(self._most + GROWTH * count, BUFFER)
        tried = self._tried
        self._done(count, now)
        if self.acknowledged > self._furthest:
            self._furthest, self._resends = self.acknowledged, 0
        else:
            self._tried = tried
        if self._suspect is None:
            self._send_waiting()
        else:
            self._judge(now)

    # Going back.

    def _asked_for(self, number: int, last: int | None, now: float) -> None:
        """Wait until it is quiet, for one fault brings many of these; then see what it can mean."""
        # Where no last line is ever named, the end must do with the same answer twice.
        proof = last == number - 1 if last is not None else self._proving and number == self._hint
        if last is not None and not proof:
            number = -1  # one of the two numbers is damaged
        if proof and self.proven > 0 and number <= self._proven_number:
            raise self.stopped(
                f"the machine asks for its line {number}, which it has run: it has rebooted"
            )
        if not self.ready:
            return
        self._goal = (number, proof)
        self._wait(now, QUIET)

    @property
    def _proven_number(self) -> int:
        return self._number - (self.acknowledged - self.proven)

    def overdue(self, now: float) -> None:
        if not self.ready:
            self.open(now)
        elif self._goal is not None:
            (number, proof), self._goal = self._goal, None
            self._hint = number
            self._tried -= 1  # silence was wanted
            self._resends += 1
            self._most /= 2  # its buffer may be smaller, or the line bad
            if self._resends > _MOST_RESENDS:
                raise self.stopped("the machine asks for lines again and again")
            self._go_to(number, proof, now)
        else:
            self._ask(now)

    def _go_to(self, number: int, proof: bool, now: float) -> None:
        """Go on with the line of a number."""
        back = self._number + 1 - number  # acknowledged lines to take back
        if not -len(self.pending) <= back <= min(len(self._kept), self.acknowledged - self.proven):
            self._ask(now)
            return
        self._proving = False
        self._bytes = 0
        if back < 0:
            self._in_flight = max(self._in_flight, -back)
            self._take(-back, now)
        self._in_flight = 0
        for _ in range(back):
            self.pending.appendleft(self._kept.pop())
            self.line = min(self.line, max(self.pending[0].line - 1, self.proven_line))
        if back > 0:
            self._number -= back
            self.acknowledged -= back
        if proof:
            self._prove()
            if self._cut and self.pending:
                self._suspect = self.pending[0]
                self._query()
        self._cut = False
        self._send_waiting()

    def _ask(self, now: float) -> None:
        """Send the oldest line in flight, or else the last of all, once more.

        If the machine has it, it refuses it and says which it wants.
        """
        if self.pending:
            self._in_flight = max(self._in_flight, 1)
            self.out += b"\n" + self._frame(self._number + 1, self.pending[0])
        elif self._kept:
            self.out += b"\n" + self._frame(self._number, self._kept[-1])
        self._wait(now)

    # A line that came in two pieces: the second may have been run as a line of its own.

    def _query(self) -> None:
        """Ask twice where the machine is, before the suspect is sent again."""
        self._places.clear()
        for _ in range(2):
            self.pending.appendleft(Entry("M114", repeatable=True))
            self.pushed += 1

    def _judge(self, now: float) -> None:
        suspect = self._suspect
        if suspect is None or not self.pending or self.pending[0] is not suspect:
            self._send_waiting()
            return
        places = self._places
        if len(places) < 2 or not same(places[-1], places[-2], 0.0):
            self._query()
        elif suspect.repeatable:
            self._suspect = None
        elif same(suspect.before, suspect.after, _RESOLUTION):
            raise self.stopped("a line came in two pieces, and may have been run")
        elif same(places[-1], suspect.before, _RESOLUTION):
            self._suspect = None
        elif same(places[-1], suspect.after, _RESOLUTION):
            self._suspect = None
            self.pending.popleft()
            self.acknowledged += 1
        else:
            raise self.stopped("a line came in two pieces, and the machine is elsewhere")
        self._send_waiting()
