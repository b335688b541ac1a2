"""Reading G-code, of fdjax or of anybody: what it deposits, as roads in layers."""

import math
import re

import numpy as np

from fdjax.errors import InputError
from fdjax.formats import arcs
from fdjax.formats.assembly import Assembly, option
from fdjax.formats.profile import Machine
from fdjax.plan.toolpath import Build, Outline

_PLAIN = re.compile(r"G1 X(-?\d*\.?\d+) Y(-?\d*\.?\d+) E(-?\d*\.?\d+)")
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_FRAME = re.compile(r"^\s*N\d+\s*|\s*\*\s*\d+\s*$", re.IGNORECASE)  # line number, checksum
_COMMAND = re.compile(r"\s*([GMT])\s*(\d+)(\.\d+)?(?![\d.])", re.IGNORECASE)
_WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+)|)\s*", re.IGNORECASE)
_FOREIGN_LAYER = re.compile(r"\s*;\s*(LAYER:|LAYER_CHANGE)")


def read(
    text: str,
    *,
    machine: Machine | None = None,
    filament: float | None = None,
    layer_height: float | None = None,
    outline: Outline | None = None,
) -> Build:
    """The roads that a G-code file lays, with the widths that its E values give them.

    Takes G0 to G3 (arcs become polylines), G20/G21, G28, G90/G91, G92, M82/M83, several tools with
    an E of their own, comments after `;` or in `()`, line numbers and checksums; other commands
    are passed over. E is relative where M83 or G91 is in force. Only XY moves that push filament
    out deposit: what a retraction (a wipe included) took back is owed first. Deposits that fdjax
    marks as priming, or that stand before a slicer's first `;LAYER:` or `;LAYER_CHANGE`, are left
    out.

    Filament diameter (mm) and flow factor are those of the argument, else the file's header, else
    `machine`. `layer_height` (mm) and `outline` replace what the file says of them; where it says
    nothing, a layer's height is the difference of the z's of deposits.

    Raises `InputError`, with the line, for text that is no G-code, a damaged word, a file of fdjax
    that is truncated, a file that deposits nothing or deposits while Z moves, volumetric E (M200),
    arcs out of the XY plane, or an unknown filament diameter.
    """
    option(filament, "filament")
    option(layer_height, "layer height")
    assembly = Assembly()
    printer = _Printer(assembly)
    if "\0" in text:
        raise InputError("not G-code: the file is binary")
    try:
        for printer.number, line in enumerate(text.splitlines(), 1):
            plain = _PLAIN.fullmatch(line)
            if plain is not None:
                x, y, e = plain.groups()
                printer.straight(float(x), float(y), None, float(e))
            else:
                printer.line(line)
        printer.close()
    except InputError as error:
        raise InputError(f"G-code line {printer.number}: {error}") from None
    number = printer.number
    if not printer.commands and assembly.empty:
        raise InputError(f"not G-code: no G, M or T command in its {number} lines")
    if assembly.facts.written_by_fdjax and not assembly.ended:
        raise InputError(f"G-code line {number}: the file is truncated: no end mark of fdjax")
    if assembly.empty:
        raise InputError(f"G-code: nothing is deposited in its {number} lines")
    if printer.sloping:
        raise InputError(
            f"G-code line {printer.sloping}: deposits while Z moves; only flat layers can be read"
        )
    extrusion = machine.gcode.extrusion if machine is not None and machine.gcode else None
    diameter = filament or assembly.facts.positive("filament")
    diameter = diameter or (extrusion and extrusion.filament)
    if diameter is None:
        raise InputError(
            "G-code: the file does not say the filament's diameter; give it (often 1.75 mm)"
        )
    flow = assembly.facts.positive("flow") or (extrusion.flow if extrusion else 1.0)
    return assembly.build(
        unit=math.pi / 4 * diameter**2 / flow, layer_height=layer_height, outline=outline
    )


class _Printer:
    """The state of a printer that runs the file; positions in mm on the bed."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self.number = 0  # of the line
        self.commands = 0
        self.sloping = 0  # line of the first deposit while Z moves
        self._seen_layer = False
        self._scale = 1.0
        self._absolute, self._e_relative, self._flat = True, False, True
        self._x = self._y = self._z = 0.0
        self._shift = {"X": 0.0, "Y": 0.0, "Z": 0.0}  # of the file's coordinates, by G92
        self._tool = 0
        self._e: dict[int, float] = {}
        self._owed: dict[int, float] = {}  # filament pulled back and not yet returned
        self._points: list[tuple[float, float]] = []
        self._pushed: list[float] = []

    def line(self, line: str) -> None:
        """Run one line of the file."""
        code = line
        if ";" in line or "(" in line:
            code = _COMMENT.sub("", line)
            if not code.strip():
                self._comment(line)
                return
        if "*" in code or code[:1] in "Nn \t":
            code = _FRAME.sub("", code)
        command = _COMMAND.match(code)
        if command is None:
            return
        self.commands += 1
        kind = command[1].upper() + str(int(command[2])) + (command[3] or "")
        rest = code[command.end() :]
        if kind in _ACTIONS:
            _ACTIONS[kind](self, _words(rest, bare=kind == "G28"))
        elif kind in _MODES:
            setattr(self, *_MODES[kind])
        elif kind[0] == "T" and not rest.strip():
            self.close()
            self._tool = int(kind[1:])

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

    def straight(self, x: float | None, y: float | None, z: float | None, e: float | None) -> None:
        """Run a G0 or G1 with these words."""
        k = self._scale
        if self._absolute:
            shift = self._shift
            x = self._x if x is None else x * k + shift["X"]
            y = self._y if y is None else y * k + shift["Y"]
            z = self._z if z is None else z * k + shift["Z"]
        else:
            x, y, z = self._x + (x or 0.0) * k, self._y + (y or 0.0) * k, self._z + (z or 0.0) * k
        pushed = None if e is None else self._filament(e * k)
        self._go(x, y, z, pushed)

    def _filament(self, e: float) -> float:
        """Filament that leaves the nozzle by a move to E; negative where it is pulled back."""
        tool = self._tool
        before = self._e.get(tool, 0.0)
        after = before + e if self._e_relative or not self._absolute else e
        self._e[tool] = after
        step = e if self._e_relative or not self._absolute else after - before
        owed = self._owed.get(tool, 0.0)
        if step < 0:
            self._owed[tool] = owed - step
        elif owed:
            paid = min(owed, step)
            self._owed[tool] = owed - paid
            step -= paid
        return step

    def _go(self, x: float, y: float, z: float, pushed: float | None) -> None:
        moved = x != self._x or y != self._y
        # In a file of fdjax a segment may be so short that its E is rounded to nothing.
        deposits = pushed is not None and (
            pushed > 0 or (pushed == 0 and self._assembly.facts.get("version") is not None)
        )
        if moved and deposits:
            if not self._assembly.priming:
                if not self._points:
                    self._points.append((self._x, self._y))
                self._points.append((x, y))
                self._pushed.append(pushed or 0.0)
                if z != self._z:
                    self.sloping = self.sloping or self.number
        elif moved or z != self._z or (pushed is not None and pushed < 0):
            self.close()
        self._x, self._y, self._z = x, y, z

    def close(self) -> None:
        """End the road that is being laid, if any."""
        if self._points:
            path = np.array(self._points)
            section = np.array(self._pushed) / np.hypot(*np.diff(path, axis=0).T)
            self._assembly.add(path, section, z=self._z, material=self._tool)
            self._points, self._pushed = [], []

    def _straight_words(self, words: dict[str, float]) -> None:
        self.straight(words.get("X"), words.get("Y"), words.get("Z"), words.get("E"))

    def _arc(self, words: dict[str, float], turn: int) -> None:
        if not self._flat:
            raise InputError("an arc out of the XY plane (after G18 or G19) cannot be read")
        k, shift, start = self._scale, self._shift, (self._x, self._y)
        base = (shift["X"], shift["Y"], shift["Z"]) if self._absolute else (*start, self._z)
        end = (
            words["X"] * k + base[0] if "X" in words else start[0],
            words["Y"] * k + base[1] if "Y" in words else start[1],
        )
        z = words["Z"] * k + base[2] if "Z" in words else self._z
        if "R" in words:
            centre = arcs.centre(start, end, words["R"] * k, turn)
        elif "I" in words or "J" in words:
            centre = (start[0] + words.get("I", 0.0) * k, start[1] + words.get("J", 0.0) * k)
        else:
            raise InputError("an arc needs I and J, or R")
        points = arcs.between(start, end, centre, turn)
        pushed = self._filament(words["E"] * k) if "E" in words else None
        share = None if pushed is None else pushed / len(points)
        rise = (z - self._z) / len(points)
        for x, y in points:
            self._go(x, y, self._z + rise, share)
        self._z = z

    def _set_position(self, words: dict[str, float]) -> None:
        now = {"X": self._x, "Y": self._y, "Z": self._z}
        for axis in now if not words else now.keys() & words.keys():
            self._shift[axis] = now[axis] - words.get(axis, 0.0) * self._scale
        if "E" in words or not words:
            self._e[self._tool] = words.get("E", 0.0) * self._scale

    def _home(self, words: dict[str, float]) -> None:
        self.close()
        axes = [axis for axis in "XYZ" if axis in words] or "XYZ"
        for axis in axes:
            self._shift[axis] = 0.0
            setattr(self, f"_{axis.lower()}", 0.0)

    def _refuse_volumetric(self, words: dict[str, float]) -> None:
        if words.get("D", 1.0) > 0 and words.get("S", 1.0) > 0:
            raise InputError("volumetric E (M200) cannot be read")


_ACTIONS = {
    "G0": _Printer._straight_words,
    "G1": _Printer._straight_words,
    "G2": lambda printer, words: printer._arc(words, -1),
    "G3": lambda printer, words: printer._arc(words, 1),
    "G28": _Printer._home,
    "G92": _Printer._set_position,
    "M200": _Printer._refuse_volumetric,
}
_MODES = {
    "G17": ("_flat", True),
    "G18": ("_flat", False),
    "G19": ("_flat", False),
    "G20": ("_scale", 25.4),
    "G21": ("_scale", 1.0),
    "G90": ("_absolute", True),
    "G91": ("_absolute", False),
    "M82": ("_e_relative", False),
    "M83": ("_e_relative", True),
}


def _words(text: str, *, bare: bool) -> dict[str, float]:
    """The letters of a command with their numbers; `bare` letters count as 0."""
    words, end = {}, 0
    text = text.strip()
    while end < len(text):
        match = _WORD.match(text, end)
        if match is None or not (match[2] or bare):
            raise InputError(f"{text[end : end + 20]!r} is no letter with a number")
        words[match[1].upper()] = float(match[2] or 0.0)
        end = match.end()
    return words
