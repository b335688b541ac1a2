"""A virtual grbl 1.1: a receive buffer of 128 bytes, real-time commands, `ok` for each line.

It has no extruder: what it lays down is its spindle's or its dispenser's power along G1.
"""

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.gcode.firmware import firmware_of
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import parse
from fdjax.machine.virtual.gcode import AbstractGcodeMachine

BUFFER = 128
AREA_PER_POWER = 1e-4
"""mm^2 of section for each unit of S: of the virtual dispenser, nobody else's."""
_KNOWN = frozenset(
    [f"G{number}" for number in (0, 1, 2, 3, 4, 17, 20, 21, 28, 54, 90, 91, 92)]
    + [f"M{number}" for number in (0, 2, 3, 4, 5, 8, 9, 30)]
    + ["$H", ""]  # words alone go on with the last motion
)


class VirtualGrbl(AbstractGcodeMachine):
    """See the module."""

    firmware = "grbl"
    dialect = "grbl"
    banner = "Grbl 1.1h ['$' for help]"
    queue_length = 1

    def __init__(self, machine: Machine, **options) -> None:
        super().__init__(machine, **options)
        self._buffer = bytearray()
        self._held = False
        self._verdict = "ok"

    def _fresh(self) -> GcodeState:
        return GcodeState(firmware_of(self.dialect), area_per_power=AREA_PER_POWER)

    def _forget(self) -> None:
        super()._forget()
        self._buffer.clear()
        self._held = False

    def _take(self, data: bytes) -> None:
        for byte in data:
            if byte == ord("?"):
                self.advance(self.now)
                self._report()
            elif byte == ord("!"):
                self._held = True
            elif byte == ord("~"):
                self._held = False
            elif byte == 0x18:
                self.reset(self.now)
            elif len(self._buffer) < BUFFER:
                self._buffer.append(byte)

    def _report(self) -> None:
        busy = self._current is not None or self.rest_at > self.now
        state = "Hold:0" if self._held else "Run" if busy else "Idle"
        place = self.state
        self.say(
            f"<{state}|WPos:{place.x:.3f},{place.y:.3f},{place.z:.3f}"
            f"|Bf:{max(0, 15 - len(self._planned))},{BUFFER - len(self._buffer)}|FS:0,0>"
        )

    def _work(self) -> None:
        if not self._held:
            super()._work()

    def _accept(self) -> None:
        while not self._queue:
            end = self._buffer.find(b"\n")
            if end < 0:
                return
            line = self._buffer[:end].decode("ascii", "replace").strip()
            del self._buffer[: end + 1]
            if line:
                self._queue.append(line)

    def _acknowledge(self, line: str) -> None:
        self.say(self._verdict)

    def _begin(self, line: str) -> float:
        self._verdict = "ok"
        try:
            name, words = parse(line)
            if name not in _KNOWN:
                raise InputError(name)
            self.ran(line)
            return self._run(name, words, line)
        except InputError:
            self._verdict = "error:20"
            return self.now
