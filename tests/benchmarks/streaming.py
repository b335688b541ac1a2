"""How fast streams are, and how much memory they take, at virtual machines without faults.

    python tests/benchmarks/streaming.py [--lines 200000] [--long 5000000]

Lines a second of a stream in ping-pong and with windows; then one long file, in
a process of its own, with the largest memory that it took.
"""

import argparse
import random
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fdjax.formats import profile
from fdjax.machine import virtual
from fdjax.machine.program import Program
from fdjax.machine.protocols import protocol
from fdjax.machine.stream import Stream
from fdjax.machine.survey import survey
from fdjax.machine.virtual.port import VirtualPort

PRINTER = profile.load("marlin-0.4")
CASES = (
    ("marlin, windows", "marlin", {"advanced": True}),
    ("marlin, ping-pong", "marlin", {"advanced": False}),
    ("klipper", "klipper", {}),
    ("rrf", "rrf", {}),
    ("grbl", "grbl", {}),
)


def write(path: Path, lines: int, *, extruder: bool) -> Program:
    """A file of short moves."""
    chance = random.Random(1)
    with path.open("w") as file:
        file.write("G21\nG90\nG28\nG92 X0 Y0 Z0\nG1 F3000\n")
        if extruder:
            file.write("M83\nM104 S200\nM109 S200\nG92 E0\n")
        for _ in range(lines):
            x, y = chance.uniform(0, 200), chance.uniform(0, 200)
            file.write(f"G1 X{x:.3f} Y{y:.3f}" + (" E0.00123\n" if extruder else "\n"))
    return Program(path, PRINTER)


def send(program: Program, machine: str, **options) -> float:
    """Seconds that a stream takes."""
    port = VirtualPort(virtual.MACHINES[machine](PRINTER, **options))
    stream = Stream(program, port, protocol(machine, PRINTER.stream))
    began = time.perf_counter()
    stream.run()
    return time.perf_counter() - began


def long(path: Path) -> None:
    """Check and send one file; print times and memory."""
    program = Program(path, PRINTER)
    began = time.perf_counter()
    found = survey(program)
    checked = time.perf_counter() - began
    seconds = send(program, "marlin")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{found.commands} lines: checked at {found.commands / checked:.0f}, sent at "
        f"{found.commands / seconds:.0f} lines a second, at most {memory:.0f} MiB"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lines", type=int, default=200_000)
    parser.add_argument("--long", type=int, default=5_000_000)
    parser.add_argument("--file", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.file is not None:
        long(arguments.file)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "job.gcode"
        for title, machine, options in CASES:
            program = write(path, arguments.lines, extruder=machine != "grbl")
            seconds = send(program, machine, **options)
            print(f"{title:20} {arguments.lines / seconds:8.0f} lines a second", flush=True)
        write(path, arguments.long, extruder=True)
        subprocess.run([sys.executable, __file__, "--file", str(path)], check=True)


if __name__ == "__main__":
    main()
