"""What the lines of a machine file would do, one after the other."""

import re
import sys
from math import inf

from fdjax.errors import InputError
from fdjax.gcode import objects
from fdjax.gcode.commands import passes_over
from fdjax.gcode.motion import MotionTime
from fdjax.gcode.settings import said
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import Refused, command_of
from fdjax.machine.findings import FORBIDDEN, LONGEST, Findings
from fdjax.machine.program import Program
from fdjax.machine.pushes import check_push
from fdjax.machine.sml_state import SmlState
from fdjax.machine.surveyed import LayerStart, Survey
from fdjax.moves import Move, Point

_PRINTERS = frozenset({"auto", "marlin", "klipper", "rrf"})
_HALTS = frozenset({"G28", "$H", "M109", "M190", "M400"})
"""They wait until the machine stands still."""
_HOME = {"sml": "FH", "grbl": "$H"}
_END = re.compile(r"\W*fdjax end\s*$")
_LEAST = -1e-6
"""How far off the bed a move may be, by rounding, mm."""


def _nothing(line: str) -> None:
    """SML has no line that all others are like."""


class Box:
    """Smallest and largest coordinates."""

    def __init__(self) -> None:
        self.low: Point = (inf, inf, inf)
        self.high: Point = (-inf, -inf, -inf)

    def add(self, point: Point) -> None:
        (x, y, z), (a, b, c), (d, e, f) = point, self.low, self.high
        if not (a <= x <= d and b <= y <= e and c <= z <= f):
            self.low = (min(a, x), min(b, y), min(c, z))
            self.high = (max(d, x), max(e, y), max(f, z))

    def corners(self) -> tuple[Point, Point] | None:
        return None if self.low[0] == inf else (self.low, self.high)


class Surveyor:
    """Takes the lines of a program one by one.

    `longest` replaces the firmware's longest line, bytes.
    """

    def __init__(self, program: Program, longest: int | None) -> None:
        stream = program.machine.stream
        self._program = program
        self._machine = program.machine
        self._state = program.state()
        sml = isinstance(self._state, SmlState)
        self._firmware = "sml" if sml else stream.firmware
        low, high = program.machine.room
        self._low = [side + _LEAST for side in low]
        self._high = [side - _LEAST for side in high]
        self._weighs = self._firmware == "klipper"
        self._strip = program.code
        self._plain = self._state.plain if isinstance(self._state, GcodeState) else _nothing
        self._run = self._run_sml if sml else self._run_gcode
        self._longest = longest or LONGEST.get(self._firmware, 0)
        self._short = self._longest - 20 if self._longest else sys.maxsize  # a frame takes 17
        self._motion = MotionTime(stream.acceleration, stream.corner_speed)
        self._facts = program.facts()
        self._findings = Findings()
        self._line = self._commands = 0
        self._volume = self._owed = 0.0  # owed: pulled back and not yet returned
        self._owings: dict[int, float] = {}  # of tools that are not in use
        self._tool = 0
        self._deposits, self._moves = Box(), Box()
        self._hottest = [0.0, 0.0]
        self._layers: list[tuple[int, float | None]] = []
        self._marks = 0  # marks of time that are no layer's
        self._z: float | None = None  # of the layer's last deposit
        self._top = -inf
        self._layered = self._ended = self._macros = False
        self._united = sml
        self._primes = False
        self._unhomed = self._cold = True
        self._see()

    def take(self, number: int, line: str) -> None:
        """Take the next line of the file."""
        move = self._plain(line) if len(line) <= self._short else None
        if move is not None:
            self._line = number
            self._commands += 1
            self._follow(move)
            return
        text = self._strip(line)
        if not text:
            if not self._tells(line):
                return
            if self._program.is_layer(line):
                self._begin_layer(number)
            elif _END.match(line):
                self._ended = True
            elif "fdjax prime" in line:
                self._primes = "begin" in line
            return
        self._line = number
        self._commands += 1
        if len(text) > self._short or not text.isascii():
            self._measure(text)
        try:
            moves = self._run(text)
        except InputError as error:
            self._refuse(text, error)
            return
        for move in moves:
            self._follow(move)

    def _tells(self, line: str) -> bool:
        """Whether a comment says something of what follows."""
        return self._program.is_layer(line) or "fdjax " in line

    def _follow(self, move: Move) -> None:
        start, end, _, volume, _ = move
        if start != end:
            if self._unhomed:
                self._check_home(start, end)
            self._moves.add(end)
            x, y, z = end
            (a, b, c), (d, e, f) = self._low, self._high
            if not (a <= x <= d and b <= y <= e and c <= z <= f):
                self._outside(end)
        if volume:
            if self._weighs:
                self._weigh(move)
            self._deposit(start, end, volume)
        self._motion.add(move)

    def _weigh(self, move: Move) -> None:
        assert isinstance(self._state, GcodeState)
        try:
            check_push(self._state, move, self._machine)
        except Refused as error:
            # The key says which limit it is.
            self._say("error", "refused", str(error), str(error).rpartition("(")[2])

    def _run_gcode(self, text: str) -> tuple[Move, ...]:
        moves = self._state.run(text)
        if text[:3] in ("G1 ", "G0 "):
            return moves
        name, at = command_of(text)
        words = said(text, at)
        names = {
            name,
            *(f"{letter}{words[letter].lstrip('0')}" for letter in "GM" if letter in words),
        }
        for other in names & FORBIDDEN.keys():
            if not (other == "M30" and self._firmware == "grbl"):
                right = f"{other} may not stand in a file that is sent: {FORBIDDEN[other]}"
                self._say("error", "forbidden", right, other)
        self._united = self._united or bool(names & {"G20", "G21"})
        if not (name and name[0] in "GMT" and name[1].isdigit()):
            self._foreign(name, text)
        if isinstance(self._state, GcodeState):
            if passes_over(self._state.firmware, name):
                right = f"{self._firmware} does not know {name}, and goes on without it"
                self._say("warning", "unknown", right, name)
            if name == "G4" and words and not words.keys() & self._state.firmware.dwell.keys():
                right = " or ".join(self._state.firmware.dwell)
                self._say("warning", "wait", f"{text} is no wait to {self._firmware}; {right} is")
            if name in objects.COMMANDS and self._state.objects.left_out:
                names = ", ".join(sorted(self._state.objects.left_out))
                self._say("warning", "left out", f"objects that are not printed: {names}", names)
        self._macros = self._macros or name == "M98"
        if name in _HALTS:
            self._motion.flush()
        if name in ("M204", "SET_VELOCITY_LIMIT") and isinstance(self._state, GcodeState):
            self._motion.accelerate(self._state.accelerations)
        self._see()
        return () if name in ("G28", "$H") else moves

    def _run_sml(self, text: str) -> tuple[Move, ...]:
        if "FH" not in text.upper():
            return self._state.run(text)
        moves: tuple[Move, ...] = ()
        for command in re.findall(r"[^;]*;|[^;]+$", text):
            made = self._state.run(command)
            moves += () if "FH" in command.upper() else made
        self._motion.flush()
        self._see()
        return moves

    def _see(self) -> None:
        """Look at what only a few lines change: homed axes, heat and tools."""
        state = self._state
        if isinstance(state, SmlState):
            self._unhomed, self._cold = not state.homed, False
            return
        self._unhomed = not state.homed.issuperset("XYZ")
        self._cold = self._firmware in _PRINTERS and state.nozzle < self._coldest
        heat = (max(state.nozzles.values(), default=0.0), state.bed)
        self._hottest = [max(pair) for pair in zip(self._hottest, heat, strict=True)]
        limits = self._machine.stream.hottest
        for name, asked, limit in zip(("nozzle", "bed"), heat, limits, strict=True):
            if asked > limit:
                right = f"at most {limit:g} C is right for this machine"
                self._say("error", "heat", f"{name} {asked:g} C; {right}", name)
        count = self._machine.gcode.tools if self._machine.gcode else 1
        tool = max({state.tool, *state.nozzles})
        if tool >= count:
            many = f"{count} tool{'s' * (count > 1)}, counted from 0"
            self._say("error", "tool", f"tool {tool}, but {self._machine.name} has {many}")
        if state.tool != self._tool:
            self._owings[self._tool] = self._owed
            self._tool = state.tool
            self._owed = self._owings.get(self._tool, 0.0)

    @property
    def _coldest(self) -> float:
        said = self._state.coldest if isinstance(self._state, GcodeState) else None
        return self._machine.stream.coldest if said is None else said

    def _foreign(self, name: str, text: str) -> None:
        """A line that is no G, M or T command."""
        firmware = self._firmware
        macro = len(name) > 1 and not (name[0] == "$" or name[1].isdigit())
        if firmware in (("marlin", "grbl") if macro else ("marlin", "klipper")):
            right = "a command such as G1 must begin it"
            self._say("error", "unknown", f"{firmware} does not run {text[:30]!r}; {right}")
        self._macros = self._macros or macro

    def _refuse(self, text: str, error: InputError) -> None:
        if "\0" in text:
            self._say("error", "binary", "the line holds bytes that are no text; write it again")
        elif isinstance(error, Refused):
            self._say("error", "refused", str(error))
        else:
            self._say("error", "unknown", f"{error}; a command of the machine's language is needed")

    def _measure(self, text: str) -> None:
        """Check the length of a line as it is sent."""
        if self._firmware == "sml":
            length = max(len(part.encode()) + 1 for part in text.split(";"))
        else:
            length = len(text.encode()) + 1
        if self._firmware not in ("sml", "grbl"):
            length += len(f"N{10 * self._commands} *255")
        if length > self._longest > 0:
            right = f"{length} bytes as it is sent; {self._firmware} holds {self._longest}"
            severity = "warning" if self._firmware == "auto" else "error"
            self._say(severity, "long line", f"{right}; make it shorter")

    def _check_home(self, start: Point, end: Point) -> None:
        state = self._state
        if isinstance(state, GcodeState):
            if not state.absolute and start[:2] == end[:2] and start[2] < end[2]:
                return  # a lift to home safely
            moved = {axis for axis, a, b in zip("XYZ", start, end, strict=True) if a != b}
            if moved <= state.homed:
                return
        right = _HOME.get(self._firmware, "G28")
        severity = "warning" if self._firmware == "grbl" or self._macros else "error"
        self._say(severity, "homing", f"motion before homing; {right} must come first")

    def _outside(self, point: Point) -> None:
        where = ", ".join(f"{axis} {value:.6g}" for axis, value in zip("XYZ", point, strict=True))
        low, high = self._machine.room
        room = ", ".join(
            f"{axis} {a:g} to {b:g}" for axis, a, b in zip("XYZ", low, high, strict=True)
        )
        right = f"a move to {where} mm leaves the machine's room of {room} mm"
        keys = "the profile's bed_origin and lowest say where that begins"
        self._say("error", "bed", f"{right}; place the part within it ({keys})")

    def _deposit(self, start: Point, end: Point, volume: float) -> None:
        if self._cold and volume > 0:
            self._chill()
        self._owed -= volume
        if self._owed >= 0:
            return
        self._volume -= self._owed
        self._owed = 0.0
        if start == end or self._primes:
            return
        self._deposits.add(start)
        self._deposits.add(end)
        if end[2] != self._z:
            self._reach(end[2])

    def _chill(self) -> None:
        state = self._state
        assert isinstance(state, GcodeState)
        # Another tool's heater may be this one's too.
        shared = state.heater not in state.nozzles and self._hottest[0] >= self._coldest
        severity = "warning" if self._macros or shared else "error"
        right = f"M109 with {self._coldest:g} C or more must come first"
        right += "; the profile's stream.coldest" + (" or M302" if state.firmware.coldest else "")
        right += " lets it be colder"
        message = f"cold extrusion: nozzle {state.tool} is set to {state.nozzle:g} C; {right}"
        self._say(severity, "cold", message, severity)

    def _reach(self, z: float) -> None:
        """Deposit at another z than before: a new layer, where comments do not tell the layers."""
        if self._layered:
            if self._z is None:
                self._layers[-1] = (self._layers[-1][0], z)
        elif self._begins_layer(z):
            self._top = z
            self._layers.append((self._line, z))
            self._motion.mark()
        self._z = z

    def _begins_layer(self, z: float) -> bool:
        """Whether deposit at this height is a new layer's, where comments do not tell them."""
        return not self._layered and z > self._top + self._machine.layer_height[0] / 2

    def _begin_layer(self, number: int) -> None:
        if not self._layered:
            self._layered = True
            self._marks = len(self._layers)
            self._layers.clear()
        self._layers.append((number, None))
        self._motion.mark()
        self._z = None

    def _say(self, severity: str, kind: str, message: str, key: str = "") -> None:
        self._findings.add(severity, kind, message, line=self._line, key=key)

    def result(self, lines: int) -> Survey:
        """What there is to say, after the last line."""
        self._motion.flush()
        self._end()
        state = self._state
        filament = 0.0
        if isinstance(state, GcodeState):
            filament = self._volume * state.flow / state.filament_area
        seconds = self._motion.marks[self._marks :]
        layers = zip(self._layers, seconds, strict=True)
        return Survey(
            lines=lines,
            commands=self._commands,
            layers=tuple(LayerStart(line, z, at) for (line, z), at in layers),
            seconds=self._motion.seconds,
            volume=self._volume,
            filament=filament,
            grams=self._volume / 1000 * self._machine.stream.density,
            deposits=self._deposits.corners(),
            moves=self._moves.corners(),
            nozzle=self._hottest[0],
            bed=self._hottest[1],
            findings=self._findings.all(),
        )

    def _end(self) -> None:
        """Findings that only the end of the file shows."""
        state = self._state
        if not self._commands:
            self._say("error", "empty", "the file holds no command; write it again")
        if "version" in self._facts and not self._ended:
            self._say("error", "truncated", "the end mark of fdjax is missing; write it again")
        if isinstance(state, SmlState):
            if state.rest.strip() or state.path is not None:
                lacking = "EC" if state.path is not None else "a semicolon"
                self._say("error", "truncated", f"{lacking} is missing; write it again", "SML")
        else:
            on = [f"nozzle {tool}" for tool, heat in sorted(state.nozzles.items()) if heat > 0]
            on += ["bed"] * (state.bed > 0) + ["spindle or laser"] * (state.power > 0)
            if on:
                right = "M104 S0, M140 S0 and M5 turn them off"
                self._say("warning", "left on", f"{', '.join(on)} at the end of the file; {right}")
        self._line = 0
        if self._commands and self._firmware in _PRINTERS and not (self._volume or self._macros):
            self._say("error", "empty", "nothing is deposited; E pushes filament, in G1 to G3")
        if not self._united and self._moves.corners():
            self._say("warning", "units", "no G21 or G20 states the units; G21 is right for mm")
        named = self._facts.get("machine", self._machine.name)
        if named != self._machine.name:
            right = f"it was written for {named}, not for {self._machine.name}; name that one"
            self._say("error", "machine", f"a file for another machine: {right}")
