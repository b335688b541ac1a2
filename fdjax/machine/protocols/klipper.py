"""Klipper: no line numbers, no checksums, never a Resend; one line at a time.

Its port is a pseudo-terminal, so what is written arrives; what may be lost is answers. The report
of a position (M114) proves that all lines before it have been taken.
"""

from typing import ClassVar

from fdjax.machine.protocols.querying import AbstractQuerying

_GONE = ("Klipper state: Shutdown", "Klipper state: Disconnect", "Klipper state: Startup")


class KlipperProtocol(AbstractQuerying):
    """See the module. A line that is refused (`!!`) ends the stream, although an `ok` follows."""

    firmware = "klipper"
    guarantee = (
        "each line once and in order, or a stop, under answers lost, doubled, damaged, delayed or "
        "made up, and under stalls, disconnects and restarts; bytes to the machine do not change"
    )
    loses: ClassVar[bool] = False

    def _framed(self, text: str) -> bytes:
        return f"{text}\n".encode("ascii", "replace")

    def _fatal(self, text: str) -> str | None:
        if text.startswith("!!"):
            return f"the machine refused a line: {text}"
        if any(sign in text for sign in _GONE):
            return f"the machine restarted or shut down: {text}"
        return None
