"""`fdjax virtual`: a virtual machine for other programs, and logs played back to one."""

from pathlib import Path

from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.machine.journal import read_log
from fdjax.machine.virtual import MACHINES
from fdjax.machine.virtual.base import AbstractVirtualMachine
from fdjax.machine.virtual.serve import PseudoTerminal


def _machine(firmware: str, name: str | None, **options) -> AbstractVirtualMachine:
    if name is None:
        name = "stratasys-fdm1650" if firmware == "fdm1650" else "marlin-0.4"
    return MACHINES[firmware](profile.load(name), **options)


def serve(firmware: str, machine: str | None, pace: float) -> None:
    """Play a machine at a pseudo-terminal until interrupted."""
    if not 0 <= pace < 1e6:
        raise InputError(f"--pace: {pace:g}; 0 (at once) or a positive number is needed")
    player = _machine(firmware, machine, pace=pace)
    terminal = PseudoTerminal()
    print(f"a virtual {firmware} listens at {terminal.name}; Ctrl-C ends it", flush=True)
    try:
        terminal.serve(player, until=lambda: False)
    finally:
        terminal.close()


def replay(firmware: str, machine: str | None, log: Path, printed: Path | None) -> None:
    """Give a virtual machine what a log says was sent; say, or save, what it laid down."""
    player = _machine(firmware, machine, record=True)
    assert player.print is not None
    entries = read_log(log)
    now = 0.0
    for time, way, data in entries:
        if way == ">":
            now = max(now, time)
            player.receive(data, now)
            while (due := player.next_event()) < float("inf"):
                now = max(now, due)
                player.advance(now)
            player.answers()
    sent = sum(len(data) for _, way, data in entries if way == ">")
    print(f"{sent} bytes sent; {player.print.volume:.3f} mm^3 laid down")
    if printed is not None:
        player.print.write(printed)
