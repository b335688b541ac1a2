"""A virtual Marlin: what Marlin 2 does with a serial line, faults of its own included."""

import re

from fdjax.formats.profile import Machine
from fdjax.gcode.words import code_of
from fdjax.machine.protocols.base import checksum
from fdjax.machine.virtual.gcode import AbstractGcodeMachine

_NUMBER = re.compile(r"N\s*(-?\d+)")
_TEXT = re.compile(r"^N-?\d+\s*")


class VirtualMarlin(AbstractGcodeMachine):
    """See the module.

    - `advanced`: acknowledgements are `ok N.. P.. B..`; `keepalive`: it says when it is busy;
      `emergency_parser`: M108, M112 and M410 act as soon as they arrive; `wait`: it says when it
      waits for lines; `bare_resend`: no `ok` follows a Resend.
    """

    firmware = "Marlin 2.1 (virtual)"
    dialect = "marlin"
    banner = "start"
    receive_buffer = 127
    longest = 95

    def __init__(
        self,
        machine: Machine,
        *,
        advanced: bool = True,
        keepalive: bool = True,
        emergency_parser: bool = True,
        wait: bool = False,
        bare_resend: bool = False,
        **options,
    ) -> None:
        super().__init__(machine, **options)
        self._advanced = advanced
        self._keepalive = keepalive
        self._emergency_parser = emergency_parser
        self._says_wait = wait
        self._bare_resend = bare_resend
        self._buffer = bytearray()  # received and not read
        self._partial = bytearray()  # of the line that is being read
        self._scanned = bytearray()  # of the line that the emergency parser sees
        self._last = 0
        self._next_word = 0.0  # when to say that it is busy or waits
        self._halted = False

    def _forget(self) -> None:
        super()._forget()
        self._buffer.clear()
        self._partial.clear()
        self._last = 0
        self._halted = False

    def _take(self, data: bytes) -> None:
        if self._emergency_parser:
            self._scan(data)
        self._buffer += data[: self.receive_buffer - len(self._buffer)]

    def _scan(self, data: bytes) -> None:
        for byte in data:
            if byte != 10:
                self._scanned.append(byte)
                continue
            word, self._scanned = self._scanned.decode("ascii", "replace").strip(), bytearray()
            if word == "M112":
                self._halt()
            elif word == "M410":
                self._planned.clear()
            elif word == "M108" and self._current is not None:
                self._until = self.now

    def _halt(self) -> None:
        self._halted = True
        self._queue.clear()
        self._current = None
        for heater in self.heaters.values():
            heater.set(0.0, self.now)
        self.say("Error:Printer halted. kill() called!")

    def _due(self) -> float:
        due = super()._due()
        if self._current is not None and self._keepalive:
            return min(due, self._next_word)
        if self._says_wait and self._current is None:
            return min(due, self._next_word)
        return due

    def _work(self) -> None:
        if self._halted:
            return
        super()._work()
        if self.now >= self._next_word:
            if self._current is not None and self._keepalive and self._next_word:
                heats = self._text(self._current)[:4] in ("M109", "M190")
                self.say(self._temperatures() if heats else "echo:busy: processing")
            elif self._current is None and self._says_wait and self._next_word:
                self.say("wait")
            self._next_word = self.now + (2.0 if self._current is not None else 1.0)

    def _accept(self) -> None:
        while len(self._queue) < self.queue_length:
            end = self._buffer.find(b"\n")
            piece = self._buffer if end < 0 else self._buffer[:end]
            self._partial += piece[: self.longest - len(self._partial)]
            if end < 0:
                self._buffer.clear()
                return
            del self._buffer[: end + 1]
            line, self._partial = self._partial.decode("ascii", "replace"), bytearray()
            line = line.partition(";")[0].strip("\r ")
            if line and self._is_good(line):
                self._queue.append(line)
                self._next_word = self.now + 2.0

    def _is_good(self, line: str) -> bool:
        if line[0] != "N":
            return True
        found = _NUMBER.match(line)
        number = int(found[1]) if found else 0
        renumbers = "M110" in line
        if renumbers:
            again = _NUMBER.search(line, 4)
            number = int(again[1]) if again else number
        elif number != self._last + 1:
            return self._bad("Line Number is not Last Line Number+1")
        body, star, said = line.rpartition("*")
        if not star:
            return self._bad("No Checksum with line number")
        digits = re.match(r"\s*(\d*)", said)
        if int(digits[1] or 0 if digits else 0) != checksum(body):
            return self._bad("checksum mismatch")
        self._last = number
        return True

    def _bad(self, why: str) -> bool:
        self.say(f"Error:{why}, Last Line: {self._last}")
        self._buffer.clear()
        self.say(f"Resend: {self._last + 1}")
        if not self._bare_resend:
            self.say("ok")
        return False

    def _text(self, line: str) -> str:
        text = _TEXT.sub("", line, count=1).partition("*")[0].strip(" ")
        return code_of(text) if "(" in text else text

    def _clamp(self) -> None:
        if self.state.settings.get(("M211", "", 1.0), {}).get("S") != "0":
            super()._clamp()

    def _refuse(self, text: str) -> None:
        if text[:1] == "T" and text[1:].isdigit():
            self.say(f"echo:{text} Invalid extruder")
        else:
            super()._refuse(text)

    def _acknowledge(self, line: str) -> None:
        if self._has_answered(line):
            return
        found = _NUMBER.match(line) if self._advanced else None
        if found is None:
            self.say("ok")
            return
        free = 16 - len(self._planned)
        self.say(f"ok N{found[1]} P{max(free, 0)} B{self.queue_length - 1 - len(self._queue)}")

    def _answers_to(self, name: str) -> bool:
        if name == "M112":
            self._halt()
            return True
        if name in ("M110", "M108", "M410"):
            return True
        if name == "M105":
            self.say(f"ok {self._temperatures()} @:0 B@:0")
            return True
        return super()._answers_to(name)

    def _place(self, x: float, y: float, z: float, e: float) -> str:
        steps = f"Count X:{80 * x:.0f} Y:{80 * y:.0f} Z:{400 * z:.0f}"
        return f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:{e:.2f} {steps}"

    def _identity(self) -> str:
        parser = int(self._emergency_parser)
        return (
            f"FIRMWARE_NAME:{self.firmware} PROTOCOL_VERSION:1.0 MACHINE_TYPE:Virtual "
            f"EXTRUDER_COUNT:1\nCap:AUTOREPORT_TEMP:0\nCap:EMERGENCY_PARSER:{parser}"
        )
