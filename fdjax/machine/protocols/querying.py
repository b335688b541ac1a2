"""Firmware that acknowledges lines but does not number them: where in doubt, ask for the position.

One line is on its way at a time. The machine answers in order, so a report of its position comes
after all that it said of earlier lines.
"""

from abc import abstractmethod
from typing import ClassVar

from fdjax.machine.protocols.base import (
    AbstractProtocol,
    is_ok,
    position,
    reports_heat,
    same,
)
from fdjax.moves import Position

QUIET = 0.5
"""Seconds of silence after which no late answer is expected any more."""
_MOST_REPEATS = 20
_PROVE_EVERY = 64
"""Lines after which the position is asked for without need."""


class AbstractQuerying(AbstractProtocol):
    """One line at a time, and the position where an acknowledgement does not come.

    - `query`: command that reports the position; `resolution`: of the report, mm.
    - `loses`: whether a line may get lost on its way to the machine.
    """

    query: ClassVar[str] = "M114"
    resolution: ClassVar[float] = 0.0006
    loses: ClassVar[bool]

    def __init__(self) -> None:
        super().__init__()
        self._places: list[Position] | None = None  # reported so far, None where not asked
        self._repeats = 0  # of the line on its way
        self._drift = 0.0  # of E, which firmware sums in single precision
        self._oks = 0  # since the greeting
        self._settling = False  # reports are there, and perhaps more answers to come
        self._due = 0  # acknowledgements of these questions that are still to come
        self._expected: Position = (None, None, None, None)  # after the last line

    @abstractmethod
    def _framed(self, text: str) -> bytes:
        """A line as it is sent."""

    @abstractmethod
    def _fatal(self, text: str) -> str | None:
        """Why the stream must stop after this answer, if it must."""

    def _greet(self, now: float) -> None:
        self._oks = 0
        self.facts.clear()
        self.out += b"\n" + self._framed("M115")
        self._wait(now, 2.0)

    def open(self, now: float) -> None:
        self._greet(now)

    def room(self, text: str) -> bool:
        if self._places is None and self.acknowledged - self.proven >= _PROVE_EVERY:
            return False
        return self.ready and not self.pending and self._places is None

    def _send(self, entry) -> None:
        self._expected = entry.after
        if entry.text.startswith("G92"):
            self._drift = 0.0
        self.out += self._framed(entry.text)

    @property
    def finished(self) -> bool:
        return not self.pending and self.proven == self.acknowledged

    def finish(self, now: float) -> None:
        if self._places is None and not self.pending and self.proven < self.acknowledged:
            self._ask(now)

    @property
    def deadline(self) -> float:
        waiting = self.pending or not self.ready or self._places is not None
        return self._deadline if waiting else float("inf")

    def tick(self, now: float) -> None:
        if self._places is None and self.acknowledged - self.proven >= _PROVE_EVERY:
            self.finish(now)
        super().tick(now)

    def answer(self, text: str, now: float) -> None:
        fatal = self._fatal(text)
        if fatal is not None and (self.ready or text.startswith("!!")):
            refused = text.startswith("!!") and self.pending
            raise self.stopped(fatal, line=self.pending[0].line if refused else 0)
        if is_ok(text):
            if reports_heat(text):
                self._note("temperature", text)
            self._ok(text, now)
        elif reports_heat(text) or "busy" in text:
            self._note("temperature" if reports_heat(text) else "busy", text)
            self._lives(now)
        elif (place := position(text)) is not None:
            self._note("position", text)
            if self._places is not None:
                self._places.append(place)
                self._tried = 0
                self._look(now)
        else:
            self._said(text, now)

    def _said(self, text: str, now: float) -> None:
        if "FIRMWARE_NAME" in text:
            name = text.partition("FIRMWARE_NAME:")[2].strip()
            self.facts["FIRMWARE_NAME"] = name.split(" FIRMWARE")[0]
        self._note("fault" if text.startswith("Error") else "message", text)
        self._lives(now)

    def _ok(self, text: str, now: float) -> None:
        if not self.ready:
            if "FIRMWARE_NAME" in text:
                self._said(text, now)
            self.ready = bool(self.facts) and self._is_set_up()
            self._oks += 1
        elif self._places is not None:
            self._due -= bool(self._places)  # before the first report it may be the line's own
            self._look(now)
        elif self.pending:
            self._repeats = 0
            self._done(1, now)

    def _is_set_up(self) -> bool:
        """Whether what the greeting asked for has been done."""
        return True

    def overdue(self, now: float) -> None:
        if not self.ready:
            self._greet(now)
        elif self._settling:
            self._settling = False
            self._tried -= 1  # silence was wanted
            self._judge(now)
        else:
            self._ask(now)

    def _ask(self, now: float) -> None:
        if self._places is None:
            self._places, self._due = [], 0
        self._due += 1
        self.out += self._framed(self.query)
        self._wait(now)

    def _look(self, now: float) -> None:
        """Judge by the reports once all questions are acknowledged, or it is quiet.

        A question's late `ok` would else count for the next line.
        """
        if self._places and self._due <= 0:
            self._settling = False
            self._judge(now)
        elif self._places:
            self._settling = True
            self._deadline = now + QUIET

    def _judge(self, now: float) -> None:
        """What the reported position says of the line on its way, and of all before.

        A report may be damaged: bad news must come twice, and so must what a choice hangs on.
        """
        places = self._places or []
        place, sure = places[-1], len(places) > 1 and same(places[-1], places[-2], 0.0)
        before, after = self._drifted()
        as_expected = same(place, after, self.resolution)
        if not sure and (not as_expected or (self.loses and self.pending)):
            self._ask(now)
            return
        self._places = None
        if not self.pending or not self.loses:
            if not as_expected:
                raise self.stopped(f"the machine is at {_text(place)}, not {_text(after)}")
            if place[3] is not None and self._expected[3] is not None:
                self._drift = place[3] - self._expected[3]
            self._done(len(self.pending), now)
            self._prove()
            return
        entry = self.pending[0]
        moves = not same(before, after, 2 * self.resolution)
        if not as_expected and not same(place, before, self.resolution):
            raise self.stopped(f"the machine is at {_text(place)}, not {_text(after)}")
        if moves and as_expected:
            self._repeats = 0
            self._done(1, now)
            self._prove()
        elif moves or entry.repeatable:
            self._repeats += 1
            if self._repeats > _MOST_REPEATS:
                raise self.stopped("the machine answers, but does not run a line")
            self._send(entry)
            self._wait(now)
        else:
            raise self.stopped("no answer, and the position does not tell whether the line was run")

    def _drifted(self) -> tuple[Position, Position]:
        """Positions before and after the line on its way, or else where the last one ended."""
        before = self.pending[0].before if self.pending else self._expected
        return _moved(before, self._drift), _moved(self._expected, self._drift)


def _moved(place: Position, drift: float) -> Position:
    x, y, z, e = place
    return x, y, z, None if e is None else e + drift


def _text(place: Position) -> str:
    return ", ".join("?" if value is None else f"{value:.3f}" for value in place)
