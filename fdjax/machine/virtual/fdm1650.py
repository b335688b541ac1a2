"""A virtual Stratasys FDM 1650: SML over a line in the way of the Asymtek language.

Its buffer of 256 bytes, its enquiries and its `?` are those of the language that SML is thought to
be a dialect of; that it refuses to work before it was homed is an assumption.
"""

from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.formats.profile import Machine
from fdjax.machine.sml_state import SmlState
from fdjax.machine.virtual.base import AbstractVirtualMachine

BUFFER = 256
ROOM = 128
"""Bytes that must be free before an enquiry is answered."""
_ENQ, _ACK, _XON, _XOFF = 5, b"\x06", b"\x11", b"\x13"
_BEFORE_HOME = ("PD;", "MM;", "CD0;", "FH;", ";")
"""All that it takes before it has found home."""


class VirtualFdm1650(AbstractVirtualMachine):
    """See the module; where the profile is of a machine without SML, the bundled one is played."""

    firmware = "sml"

    def __init__(self, machine: Machine, **options) -> None:
        super().__init__(machine, **options)
        sml = machine.sml or profile.load("stratasys-fdm1650").sml
        assert sml is not None
        self._sml = sml
        self.state = SmlState(self._sml)
        self._buffer = bytearray()
        self._enquiries = 0
        self._until = 0.0
        self._text = bytearray()
        self._full = False

    def _forget(self) -> None:
        self.state = SmlState(self._sml)
        self._buffer.clear()
        self._text.clear()
        self._enquiries = 0
        self._until = self.now

    def _due(self) -> float:
        return self._until if self._until > self.now else float("inf")

    def _take(self, data: bytes) -> None:
        for byte in data:
            if byte == _ENQ:
                self._enquiries += 1
            elif len(self._buffer) < BUFFER:
                self._buffer.append(byte)

    def _signal(self, byte: bytes) -> None:
        self._answers.append((self.now, byte))

    def _work(self) -> None:
        while self._buffer and self.now >= self._until:
            end = self._buffer.find(b";")
            if end < 0:
                self._text += self._buffer
                self._buffer.clear()
                break
            command = (self._text + self._buffer[: end + 1]).decode("ascii", "replace")
            self._text.clear()
            del self._buffer[: end + 1]
            self._run(command.replace("\r", "").replace("\n", ""))
        used = len(self._buffer)
        if BUFFER - used >= ROOM:
            for _ in range(self._enquiries):
                self._signal(_ACK)
            self._enquiries = 0
        if self._full and used <= BUFFER - ROOM:
            self._full = False
            self._signal(_XON)
        elif not self._full and used > BUFFER - 32:
            self._full = True
            self._signal(_XOFF)

    def _run(self, command: str) -> None:
        bare = command.lstrip(self._sml.mark + " ").upper()
        if not self.state.homed and bare not in _BEFORE_HOME:
            self._signal(b"?")
            return
        try:
            moves = self.state.run(command)
        except InputError:
            self._signal(b"?")
            return
        self.ran(command)
        self._until = self._make(moves)
