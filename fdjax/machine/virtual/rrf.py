"""A virtual RepRapFirmware: checksums, but no line order, and a bad line goes without a word."""

import re

from fdjax.formats.profile import Machine
from fdjax.machine.protocols.base import checksum
from fdjax.machine.virtual.gcode import AbstractGcodeMachine

_NUMBER = re.compile(r"^N-?\d+\s*")
_DIGITS = re.compile(r"[0-9]{1,3}")


class VirtualRepRapFirmware(AbstractGcodeMachine):
    """See the module. M575 P0 S1 makes it drop lines without a checksum too."""

    firmware = "RepRapFirmware for Duet (virtual)"
    dialect = "rrf"
    banner = "RepRapFirmware for Duet is starting up"
    queue_length = 8

    def __init__(self, machine: Machine, **options) -> None:
        super().__init__(machine, **options)
        self._buffer = bytearray()
        self._wants_checksum = False

    def _forget(self) -> None:
        super()._forget()
        self._buffer.clear()
        self._wants_checksum = False

    def _take(self, data: bytes) -> None:
        self._buffer += data[: 512 - len(self._buffer)]

    def _accept(self) -> None:
        while len(self._queue) < self.queue_length:
            end = self._buffer.find(b"\n")
            if end < 0:
                return
            line = self._buffer[:end].decode("ascii", "replace").strip("\r ")
            del self._buffer[: end + 1]
            body, star, said = line.rpartition("*")
            if not star:
                body = line
                if self._wants_checksum:
                    continue
            elif not _DIGITS.fullmatch(said) or int(said) != checksum(body):
                continue
            text = _NUMBER.sub("", body).partition(";")[0].strip()
            if text:
                self._queue.append(text)

    def _run(self, name: str, words: dict[str, str], text: str) -> float:
        if name == "M575":
            self._wants_checksum = words.get("S") in ("1", "3")
            return self.now
        return super()._run(name, words, text)

    def _clamp(self) -> None:
        """Its G92 says where the machine is, so its limits go with it."""
        state = self.state
        state.on_bed = (state.x, state.y, state.z)
        super()._clamp()
        x, y, z = (place + by for place, by in zip(state.on_bed, state.shift, strict=True))
        state.on_bed = (x, y, z)

    def _refuse_unhomed(self) -> str:
        return "Error: G0/G1: insufficient axes homed"

    def _refuse(self, text: str) -> None:
        if text[:1] in "Mm" and text[1:2].isdigit():
            self.say(f"Warning: {text}: Command is not supported")
        else:
            self.say(f"Error: Bad command: {text}")

    def _complain(self, why: str) -> None:
        self.say(f"Error: {why}")

    def _answers_to(self, name: str) -> bool:
        if name == "M105":
            self.say(f"ok {self._temperatures()}")
            return True
        return name in ("M112", "M110", "M21") or super()._answers_to(name)
