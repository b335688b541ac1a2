"""Reading G-code, of fdjax or of anybody: what it deposits, as roads in layers."""

import math
import re
from collections.abc import Sequence
from itertools import chain

import numpy as np

from fdjax.errors import InputError
from fdjax.formats import header
from fdjax.formats.assembly import Assembly, option
from fdjax.formats.profile import Machine
from fdjax.gcode.firmware import firmware_of
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import NoCommand, code_of
from fdjax.moves import Move, Point
from fdjax.plan.toolpath import Build, Outline

_FOREIGN_LAYER = re.compile(r"\s*;\s*(LAYER:|LAYER_CHANGE)")
_OWN_FILAMENT = re.compile(r"fdjax (?:filament|flow) [=+].*")
_FOREIGN_FILAMENT = re.compile(r"^; filament_diameter = ([\d.]+(?:[,;][\d.]+)*)\s*$", re.MULTILINE)


def read(
    text: str,
    *,
    machine: Machine | None = None,
    filament: float | Sequence[float] | None = None,
    layer_height: float | None = None,
    outline: Outline | None = None,
) -> Build:
    """The roads that a G-code file lays, with the widths that its E values give them.

    The file is followed by `gcode.state`, the interpreter that also checks and streams it, as the
    machine's firmware reads it (Marlin's, where no machine says another); arcs become polylines,
    and lines that are no command are passed over. Only XY moves that push filament out deposit:
    what a retraction (a wipe included) took back is owed first. Deposits that fdjax marks as
    priming, or that stand before a slicer's first `;LAYER:` or `;LAYER_CHANGE`, are left out.

    Filament diameter (mm; one, or one a tool) and flow factor are those of the argument, else the
    file's header, else a slicer's `; filament_diameter =`, else `machine`. `layer_height` (mm) and
    `outline` replace what the file says of them; where it says nothing, a layer's height is the
    difference of the z's of deposits.

    Raises `InputError`, with the line, for text that is no G-code, a damaged word, a file of fdjax
    that is truncated, a file that deposits nothing or deposits while Z moves, what the interpreter
    cannot follow, or an unknown filament diameter.
    """
    given = [filament] if isinstance(filament, int | float) else list(filament or ())
    for diameter in given:
        option(diameter, "filament")
    option(layer_height, "layer height")
    if "\0" in text:
        raise InputError("not G-code: the file is binary")
    extrusion = machine.gcode.extrusion if machine is not None and machine.gcode else None
    stated, flow = _stated(text)
    diameters = given or stated or ([extrusion.filament] if extrusion else [])
    areas = [math.pi / 4 * diameter**2 for diameter in diameters] or [1.0]
    state = GcodeState(
        firmware_of(machine.stream.firmware if machine is not None else ""),
        filament_area=areas[0],
        areas=dict(enumerate(areas)),
        flow=flow or (extrusion.flow if extrusion else 1.0),
    )
    assembly = Assembly()
    printer = _Printer(assembly, state)
    number = 0
    try:
        plain, points, pushed = state.plain, printer.points, printer.pushed
        for number, line in enumerate(text.splitlines(), 1):
            move = plain(line)
            if move is None:
                for move in printer.line(line):
                    printer.take(move, line, number)
            elif points and move[3] > 0 and not (move[4] or printer.owed) and " Z" not in line:
                points.append(move[1])  # what `take` does with a road that goes on
                pushed.append(move[3])
            else:
                printer.take(move, line, number)
        printer.close()
    except InputError as error:
        raise InputError(f"G-code line {number}: {error}") from None
    if not (printer.commanded or state.motion) and assembly.empty:
        raise InputError(f"not G-code: no G, M or T command in its {number} lines")
    if assembly.facts.written_by_fdjax and not assembly.ended:
        raise InputError(f"G-code line {number}: the file is truncated: no end mark of fdjax")
    if assembly.empty:
        raise InputError(f"G-code: nothing is deposited in its {number} lines")
    if printer.sloping:
        raise InputError(
            f"G-code line {printer.sloping}: deposits while Z moves; only flat layers can be read"
        )
    if not diameters and printer.by_length:
        raise InputError(
            "G-code: the file does not say the filament's diameter; give it (often 1.75 mm)"
        )
    return assembly.build(unit=1.0, layer_height=layer_height, outline=outline)


def _stated(text: str) -> tuple[list[float], float | None]:
    """Filament diameters, mm, and flow that a file states, wherever: slicers do at its end."""
    facts = header.Facts()
    for fact in _OWN_FILAMENT.findall(text):
        facts.feed(fact)
    own, flow = facts.positive("filament"), facts.positive("flow")
    if own is not None:
        return [own], flow
    said = _FOREIGN_FILAMENT.search(text)
    diameters = [float(number) for number in re.split("[,;]", said[1])] if said else []
    return [diameter for diameter in diameters if diameter > 0], flow


class _Printer:
    """Gathers what a state deposits along the file into roads."""

    def __init__(self, assembly: Assembly, state: GcodeState) -> None:
        self._assembly = assembly
        self._state = state
        self._tool = state.tool
        self.owed = 0.0  # of material, mm^3, pulled back and not yet returned
        self._owings: dict[int, float] = {}  # of tools that are not in use
        self._seen_layer = False
        self.points: list[Point] = []
        self.pushed: list[float] = []
        self.commanded = False
        self.by_length = False
        self.sloping = 0

    def line(self, line: str) -> tuple[Move, ...]:
        """Take one line of the file to the state; the moves that it makes."""
        code = "" if line[:1] == ";" else code_of(line)
        if not code:
            self._comment(line)
            return ()
        self.commanded = self.commanded or (code[0] in "GMTgmt" and code[1:2].isdigit())
        try:
            moves = self._state.run(code)
        except NoCommand:
            return ()
        if self._state.tool != self._tool:
            self.close()
            self._owings[self._tool] = self.owed
            self._tool = self._state.tool
            self.owed = self._owings.get(self._tool, 0.0)
        return moves

    def _comment(self, line: str) -> None:
        if "fdjax " in line:
            self.close()  # before the next road's or layer's facts are taken
            self._assembly.comment(line)
        elif _FOREIGN_LAYER.match(line) and not self._assembly.facts.get("version"):
            self.close()
            if not self._seen_layer:
                self._assembly.forget()
                self.sloping = 0
            self._seen_layer = True

    def take(self, move: Move, line: str, number: int) -> None:
        """Take a move that a line, of this number, makes."""
        start, end, _, volume, _ = move
        if volume < 0:
            self.owed -= volume
        elif self.owed and volume:
            paid = min(self.owed, volume)
            self.owed -= paid
            volume -= paid
        moved = start[0] != end[0] or start[1] != end[1]
        if moved and (volume > 0 or (volume == 0 and self._is_short_road(line))):
            if self._assembly.priming:
                return
            if not self.points:
                self.points.append(start)
            self.points.append(end)
            self.pushed.append(volume)
            if start[2] != end[2]:
                self.sloping = self.sloping or number
        elif moved or start[2] != end[2] or volume < 0:
            self.close()

    def _is_short_road(self, line: str) -> bool:
        """In a file of fdjax a segment may be so short that its E is rounded to nothing."""
        return self._assembly.facts.get("version") is not None and "E" in code_of(line).upper()

    def close(self) -> None:
        """End the road that is being laid, if any."""
        if self.points:
            count = len(self.points)
            flat = np.fromiter(chain.from_iterable(self.points), float, 3 * count)
            path = flat.reshape(count, 3)[:, :2]
            steps = path[1:] - path[:-1]
            section = np.array(self.pushed) / np.hypot(steps[:, 0], steps[:, 1])
            self._assembly.add(path, section, z=self.points[-1][2], material=self._tool)
            self.points.clear()
            self.pushed.clear()
            self.by_length = self.by_length or not self._state.volumetric
