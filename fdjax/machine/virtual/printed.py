"""What a virtual machine laid down, kept as roads and written as a file that can be measured."""

import math
from array import array
from pathlib import Path
from typing import TextIO

from fdjax.errors import InputError
from fdjax.machine.program import Program
from fdjax.moves import Move

_DIAMETER = 1.75
_AREA = math.pi / 4 * _DIAMETER**2
"""Of the filament in which a print is written down, mm^2."""
_MARKS = ("layer ", "road", "prime", "end")


class Print:
    """The moves of a machine that deposited, in order."""

    def __init__(self) -> None:
        self._numbers = array("d")  # eight a move: start, end, volume, speed

    def add(self, move: Move) -> None:
        """Keep a move that deposits, or that takes material back."""
        if move.volume:
            self._numbers.extend((*move.start, *move.end, move.volume, move.speed))

    def __len__(self) -> int:
        return len(self._numbers) // 8

    @property
    def volume(self) -> float:
        """Deposited in all, less what was taken back, mm^3."""
        return sum(self._numbers[6::8])

    def moves(self) -> list[Move]:
        """The moves."""
        rows = [self._numbers[k : k + 8] for k in range(0, len(self._numbers), 8)]
        return [Move((a, b, c), (x, y, z), v, w) for a, b, c, x, y, z, w, v in rows]

    def write(self, path: Path, program: Program | None = None) -> None:
        """Write the roads as G-code, with what the program's file says of its part and layers.

        The layers are those that the file marks; what was laid at any other height, as priming is,
        is marked as priming. Raises `InputError` where the file cannot be written.
        """
        levels, head = [], []
        for _, line in program.lines() if program is not None else ():
            _, found, rest = line.partition("fdjax ")
            if not found or line[:1] not in "#;":
                continue
            if rest.startswith("layer "):
                settings = dict(word.split("=") for word in rest.split()[1:])
                levels.append((float(settings["z"]), rest.strip()))
            elif not rest.startswith(_MARKS) and not rest.startswith(("filament", "flow")):
                head.append(f"; fdjax {rest.strip()}")
        head += [f"; fdjax filament = {_DIAMETER}", "; fdjax flow = 1.0"]
        try:
            with path.open("w", encoding="utf-8") as out:
                out.write("\n".join([*head, "G21", "G90", "M83", ""]))
                self._write_moves(out, levels)
                out.write("; fdjax end\n")
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror})") from None

    def _write_moves(self, out: TextIO, levels: list[tuple[float, str]]) -> None:
        level, at, owed = -2, None, 0.0
        for move in self.moves():
            if move.volume < 0 or move.start == move.end:
                owed = max(owed - move.volume, 0.0)  # taken back, or returned
                continue
            paid = min(owed, move.volume)
            owed -= paid
            x, y, z = move.end
            near = [k for k, (height, _) in enumerate(levels) if abs(height - z) < 1e-3]
            here = near[0] if near else -1
            if levels and here != level:
                if level == -1:
                    out.write("; fdjax prime end\n")
                out.write("; fdjax prime begin\n" if here < 0 else f"; fdjax {levels[here][1]}\n")
                level = here
            if move.start != at:
                sx, sy, sz = move.start
                out.write(f"G0 X{sx:.4f} Y{sy:.4f} Z{sz:.4f}\n")
            out.write(
                f"G1 X{x:.4f} Y{y:.4f} E{(move.volume - paid) / _AREA:.6f} F{60 * move.speed:g}\n"
            )
            at = move.end
        if level == -1:
            out.write("; fdjax prime end\n")
