"""What may be wrong with a machine file, and the limits that say so."""

from dataclasses import dataclass, replace

LONGEST = {"auto": 96, "marlin": 96, "rrf": 256, "grbl": 80, "sml": 256}
"""Bytes of a line, its frame and its end included, that a firmware's buffer holds. Marlin's
MAX_CMD_SIZE, grbl's LINE_BUFFER_SIZE, RepRapFirmware's, and of SML one command."""

FORBIDDEN = {
    "M0": "it waits for a person at the machine's own buttons",
    "M1": "it waits for a person at the machine's own buttons",
    "M28": "it writes what follows to the machine's card instead of running it",
    "M29": "it ends writing to the machine's card",
    "M30": "it deletes a file on the machine's card",
    "M108": "it breaks off a wait for heat",
    "M25": "it pauses a print from the machine's card",
    "M81": "it turns the machine's power off",
    "M110": "it renumbers lines, which the sender does",
    "M524": "it aborts a print from the machine's card",
    "M575": "it changes how the machine talks",
    "M997": "it replaces the machine's firmware",
    "M112": "it is an emergency stop",
    "M410": "it breaks off motion, so the position is lost",
    "M500": "it overwrites the machine's stored settings",
    "M502": "it resets the machine's settings",
    "M999": "it restarts the machine after a fault, whatever that was",
}
"""Commands that have no place in a file that is sent, and why."""


@dataclass(frozen=True)
class Finding:
    """One kind of fault in a file.

    - `severity`: "error" (the file must not be sent) or "warning".
    - `kind`: "bed", "heat", "long line", "forbidden", "homing", "units", "cold", "left on",
      "unknown" (or damaged), "refused" (by the firmware), "wait", "left out", "binary", "empty",
      "truncated", "tool" or "machine".
    - `message`: what is wrong and what would be right; `line`: of the file, where first, 0 for the
      file as a whole; `count`: in how many lines.
    """

    severity: str
    kind: str
    message: str
    line: int
    count: int = 1

    def __str__(self) -> str:
        where = f", line {self.line}" if self.line else ""
        more = f" (and in {self.count - 1} more)" if self.count > 1 else ""
        return f"{self.severity}: {self.kind}{where}: {self.message}{more}"


class Findings:
    """Collects findings; the same one in many lines counts once, with its first line."""

    def __init__(self) -> None:
        self._found: dict[str, Finding] = {}
        self._last: dict[str, int] = {}  # line in which each was found last

    def add(self, severity: str, kind: str, message: str, *, line: int, key: str = "") -> None:
        """A finding, or one line more of one of its kind and key."""
        key = f"{kind} {key}"
        found = self._found.get(key)
        if found is None:
            self._found[key] = Finding(severity, kind, message, line)
        elif self._last[key] != line:
            self._found[key] = replace(found, count=found.count + 1)
        self._last[key] = line

    def all(self) -> tuple[Finding, ...]:
        """In the order of their lines."""
        return tuple(sorted(self._found.values(), key=lambda finding: finding.line))
