"""Programs to send, and what became of them: shared by the tests of streams."""

import math
import random
from dataclasses import dataclass
from pathlib import Path

from fdjax.errors import StreamError
from fdjax.formats import profile
from fdjax.machine import virtual
from fdjax.machine.program import Program
from fdjax.machine.protocols import protocol
from fdjax.machine.stream import Stream
from fdjax.machine.virtual.base import AbstractVirtualMachine
from fdjax.machine.virtual.port import VirtualPort

FIRMWARE = {name: name for name in virtual.MACHINES} | {"fdm1650": "sml"}

PRINTER = profile.load("marlin-0.4")
STRATASYS = profile.load("stratasys-fdm1650")

_OWN = ("M105", "M110", "M114", "M115", "M575")
"""What senders say of their own accord."""
_OFF = ("M104", "M140", "M107", "M5", "PD;", "MM;", "CD0;")
"""What they say at the end of a print that failed."""


def gcode(path: Path, lines: int, seed: int = 0, *, extruder: bool = True) -> Program:
    """A program of moves anywhere on the bed, with settings among them."""
    chance = random.Random(seed)
    text = ["G21", "G90"]
    if extruder:
        text += ["M83", "M104 S200", "M109 S200"]
    here = (0.0, 0.0)
    text += ["G28", "G92 X0 Y0 Z0 E0" if extruder else "G92 X0 Y0 Z0", "G1 F3000"]
    while len(text) < lines:
        if extruder and chance.random() < 0.05:
            text.append(f"M106 S{chance.randrange(256)}")
            continue
        x, y, e = chance.uniform(0, 200), chance.uniform(0, 200), chance.uniform(0.1, 2)
        e = min(e, 0.2 * math.dist(here, (x, y)))  # a section that Klipper takes
        here = (x, y)
        text.append(f"G1 X{x:.3f} Y{y:.3f}" + (f" E{e:.4f}" if extruder else ""))
    path.write_text("\n".join(text) + "\n")
    return Program(path, PRINTER)


def sml(path: Path, lines: int, seed: int = 0) -> Program:
    """A program of roads of a few points each."""
    chance = random.Random(seed)
    text = ["PD;MM;", "FH;", "AZ8;", "SP1;"]
    while len(text) < lines - 12:
        x, y = chance.randrange(8000), chance.randrange(8000)
        text += [f"SR4000;MA{x},{y};", ">PD0.08,41;MM;MM0,53;MM6,48;MM-70,175;SR800;AC5;", "BC;"]
        for _ in range(chance.randrange(1, 8)):
            text.append(f"MA{chance.randrange(8000)},{chance.randrange(8000)};")
        text += ["EC;", "CD0;", "PD;MM;"]
    path.write_text("\n".join([*text, "CD0;", "FH;"]) + "\n")
    return Program(path, STRATASYS)


def program(folder: Path, machine: str, lines: int, seed: int = 0) -> Program:
    """A program for a virtual machine."""
    if machine == "fdm1650":
        return sml(folder / "job.sml", lines, seed)
    return gcode(folder / "job.gcode", lines, seed, extruder=machine != "grbl")


def units(program: Program) -> list[tuple[str, int]]:
    """What a machine runs of a program, one by one, with the line that it stands in."""
    if program.language == "gcode":
        return list(program.commands())
    return [
        (f"{part};", command.line)
        for command in program.commands()
        for part in command.text.split(";")[:-1]
    ]


@dataclass
class Run:
    """A stream and what its machine ran."""

    stream: Stream
    port: VirtualPort
    error: StreamError | None

    @property
    def machine(self) -> AbstractVirtualMachine:
        return self.port.machine

    def ran(self) -> list[str]:
        """What the machine ran, without what the sender said of its own accord."""
        return [text for text in self.machine.executed if not text.startswith(_OWN)]

    def verdict(self) -> str:
        """ "whole" or "stopped" where the guarantee was kept; else what is wrong."""
        ran, wanted = self.ran(), units(self.stream.program)
        if self.stream.protocol.firmware == "rrf":
            ran, wanted = _settings_once(ran), _settings_once(wanted)
        if self.stream.protocol.firmware == "sml":
            ran, wanted = rates_once(ran), rates_once(wanted)
        texts = [text for text, _ in wanted]
        if self.error is None:
            return "whole" if ran == texts else "not the file"
        while ran and ran[-1].startswith(_OFF) and ran != texts[: len(ran)]:
            ran.pop()
        if ran != texts[: len(ran)]:
            return "not the beginning of the file"
        least = sum(line < self.error.line for _, line in wanted)
        most = sum(line <= self.error.sent for _, line in wanted)
        return "stopped" if least <= len(ran) <= most else "stopped elsewhere than it says"


def rates_once(texts: list) -> list:
    """SML may be told the rate that is in force again: these do not count."""
    kept, rate = [], ""
    for item in texts:
        text = item if isinstance(item, str) else item[0]
        if not text.startswith("SR") or text != rate:
            kept.append(item)
        rate = text if text.startswith("SR") else rate
    return kept


def _settings_once(texts: list) -> list:
    """RepRapFirmware may be told a setting twice: repeated ones count as one."""
    kept: list = []
    for item in texts:
        text, before = (i if isinstance(i, str) else i[0] for i in (item, kept[-1] if kept else ""))
        moves = text.startswith("G1 X")
        if moves or text != before:
            kept.append(item)
    return kept


def stream(program: Program, machine: str, *, pace=0.0, port=None, listen=None, **options) -> Run:
    """A stream that has not begun, to a virtual machine that keeps what it runs.

    `port`, `listen`: further arguments of `VirtualPort` and of `Stream`; others are the machine's.
    """
    player = virtual.MACHINES[machine](
        program.machine, keep=True, record=True, pace=pace, **options
    )
    line = VirtualPort(player, **(port or {}))
    speaks = protocol(FIRMWARE[machine], program.machine.stream)
    return Run(Stream(program, line, speaks, **(listen or {})), line, None)


def send(program: Program, machine: str, **options) -> Run:
    """A stream that has ended, well or not."""
    run = stream(program, machine, **options)
    try:
        run.stream.run()
    except StreamError as error:
        run.error = error
    return run
