"""A virtual Klipper: lines from a pseudo-terminal, run one after the other."""

import re

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.machine.pushes import check_push
from fdjax.machine.virtual.gcode import AbstractGcodeMachine

_FRAME = re.compile(r"^N-?\d+\s*|\s*\*\s*\d+\s*$")


class VirtualKlipper(AbstractGcodeMachine):
    """See the module. Numbers and checksums are passed over."""

    firmware = "Klipper"
    dialect = "klipper"
    banner = "// Klipper state: Startup"
    queue_length = 1_000_000

    def __init__(self, machine: Machine, **options) -> None:
        super().__init__(machine, **options)
        self._partial = b""
        self._down = False

    def _forget(self) -> None:
        super()._forget()
        self._partial = b""
        self._down = False

    def _take(self, data: bytes) -> None:
        *lines, self._partial = (self._partial + data).split(b"\n")
        for raw in lines:
            text = raw.decode("ascii", "replace").partition(";")[0].strip()
            if text == "M112":
                self._shut_down()
            elif text:
                self._queue.append(text)

    def _shut_down(self) -> None:
        self._down = True
        self._queue.clear()
        for heater in self.heaters.values():
            heater.set(0.0, self.now)
        self.say("// Klipper state: Shutdown")

    def _text(self, line: str) -> str:
        return _FRAME.sub("", line).strip()

    def _begin(self, line: str) -> float:
        if self._down:
            self.say("!! Shutdown due to M112 command")
            return self.now
        if not self._text(line):  # a number alone is no command, and no fault
            return self.now
        return super()._begin(line)

    def _limited(self, moves: tuple) -> tuple:
        (a, b, c), (d, e, f) = self.room
        for move in moves:
            x, y, z = move.end
            if not (a <= x <= d and b <= y <= e and c <= z <= f):
                raise InputError(f"Move out of range: {x:.3f} {y:.3f} {z:.3f}")
            if move.volume > 0 and self._is_cold():
                raise InputError("Extrude below minimum temp")
            if move.volume:
                check_push(self.state, move, self.machine)
        return moves

    def _complain(self, why: str) -> None:
        self.say(f"!! {why}")

    def _refuse_unhomed(self) -> str:
        return "!! Must home axis first"

    def _refuse(self, text: str) -> None:
        self.say(f'// Unknown command:"{text.split()[0]}"')

    def _temperatures(self) -> str:
        """Sorted by their names, and no `T:` (heaters.py, `_get_temp`)."""
        return " ".join(
            f"{name}:{heater.at(self.now):.1f} /{heater.target:.1f}"
            for name, heater in sorted(self.heaters.items())
        )

    def _answers_to(self, name: str) -> bool:
        if name == "M105":
            self.say(f"ok {self._temperatures()}")
            return True
        return name == "M110" or super()._answers_to(name)

    def _identity(self) -> str:
        return "FIRMWARE_VERSION:v0.12.0 FIRMWARE_NAME:Klipper"
