"""RepRapFirmware: checksums, but no order and no Resend: one line at a time, never a blind retry.

A line that arrives damaged is dropped without a word. Where an acknowledgement does not come, the
position tells whether the line was run; where it cannot tell, the stream stops.
"""

from typing import ClassVar

from fdjax.machine.protocols.base import checksum
from fdjax.machine.protocols.querying import AbstractQuerying

_CHECKED = "M575 P0 S1"


class RrfProtocol(AbstractQuerying):
    """See the module."""

    firmware = "rrf"
    guarantee = (
        "each line once and in order, or a stop, under bytes lost, doubled or damaged (one a "
        "frame) toward the machine and answers lost or damaged; a line that neither moves nor lays "
        "(a temperature, the fan, a mode) may be said twice; an `ok` that nobody gave is found out "
        "at the next position, not at once"
    )
    patience: ClassVar[float] = 3.0
    loses: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__()
        self._number = 0

    def _framed(self, text: str) -> bytes:
        self._number = self._number % 99_999 + 1
        body = f"N{self._number} {text}"
        return f"{body}*{checksum(body)}\n".encode("ascii", "replace")

    def bare(self, text: str) -> bytes:
        return self._framed(text)

    def _greet(self, now: float) -> None:
        # Lines without a checksum are dropped from now on; twice, as one may come without its own.
        self.out.extend(2 * self._framed(_CHECKED))
        super()._greet(now)

    def farewell(self) -> bytes:
        return self._framed("M575 P0 S0")

    def _is_set_up(self) -> bool:
        return self._oks >= 2

    def _fatal(self, text: str) -> str | None:
        if "is starting up" in text or text == "start":
            return f"the machine has rebooted: {text}"
        if text.startswith("Error:"):
            return f"the machine refused a line: {text}"
        return None
