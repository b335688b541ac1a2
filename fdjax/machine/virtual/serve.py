"""A virtual machine at a pseudo-terminal, for any program that talks to a serial port."""

import os
import select
import time
from collections.abc import Callable

from fdjax.errors import InputError
from fdjax.machine.virtual.base import AbstractVirtualMachine

_WAIT = 0.05


class PseudoTerminal:
    """The two ends of a terminal: `name` is what other programs open.

    Raises `InputError` where the system has none (Windows).
    """

    def __init__(self) -> None:
        try:
            import tty
        except ImportError:
            raise InputError("this system has no pseudo-terminals; use virtual: ports") from None
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)

    def serve(self, machine: AbstractVirtualMachine, *, until: Callable[[], bool]) -> None:
        """Let the machine talk to whoever opens the terminal, until told to end."""
        began = time.monotonic()
        while not until():
            due = machine.next_event() - (time.monotonic() - began)
            ready, _, _ = select.select([self._master], [], [], min(max(due, 0.0), _WAIT))
            now = time.monotonic() - began
            if ready:
                machine.receive(os.read(self._master, 4096), now)
            machine.advance(now)
            for _, data in machine.answers():
                os.write(self._master, data)

    def close(self) -> None:
        """Take the terminal away: to whoever has it open, the cable is unplugged."""
        os.close(self._slave)
        os.close(self._master)
