"""The state that G-code changes: what a printer would be like after a line, and how it got there.

One interpreter for all that must know: the check before sending, the time that is left, the
position that a printer should report, the lines that rebuild its state, and the virtual machines.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.machine.moves import Move, Point, Position

_PLAIN = re.compile(r"(G[01]) X(-?\d+\.?\d*) Y(-?\d+\.?\d*)(?: E(-?\d+\.?\d*))?(?: F(\d+\.?\d*))?")
_COMMAND = re.compile(r"\s*([A-Za-z])\s*(\d+)(\.\d+)?(?![\d._])")
_EXTENDED = re.compile(r"\s*([A-Za-z_]\w*[A-Za-z_]\w*|\$\S+)")
_MODAL = re.compile(r"\s*[XYZEFIJR]\s*[-+.\d]", re.IGNORECASE)
_WORD = re.compile(r'\s*([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+)|"[^"]*")?')
_BLOCK = re.compile(r"([GM])\s*(\d+(?:\.\d+)?)", re.IGNORECASE)
_TEXT = frozenset({"M23", "M28", "M30", "M32", "M117", "M118", "M486"})
_MOVING = frozenset({"G10", "G11", "G27", "G29", "G30", "G38", "M600", "M701", "M702"})
"""They move the machine to places that they do not name."""
_MOTION = frozenset({"G0", "G1", "G2", "G3"})
_SLOWEST = 1e-3
_LARGEST_RADIUS = 1e6


def parse(code: str) -> tuple[str, dict[str, float]]:
    """The command and its words: `("G1", {"X": 10.0})`; a letter alone or with a text counts as 0.

    A command of Klipper's kind (`SET_FAN SPEED=1`) or of grbl's (`$H`) comes without words, as do
    those that end in text; words alone, which go on with the last motion, have the name "". Raises
    `InputError` for what is none of these, and where a letter stands twice, as it does in numbers
    such as 1e-5.

    >>> parse("G1 X10 F1200")
    ('G1', {'X': 10.0, 'F': 1200.0})
    """
    name, at = "", 0
    if not _MODAL.match(code):
        match = _COMMAND.match(code)
        if match is None:
            extended = _EXTENDED.match(code)
            if extended is None:
                raise InputError(f"{code.strip()[:30]!r} is no command")
            return extended[1].upper(), {}
        name = f"{match[1].upper()}{int(match[2])}{match[3] or ''}"
        if name in _TEXT:
            return name, {}
        at = match.end()
    words: dict[str, float] = {}
    end = len(code.rstrip())
    while at < end:
        word = _WORD.match(code, at)
        if word is None:
            raise InputError(f"{code[at : at + 20].strip()!r} is no letter with a number")
        key, value = word[1].upper(), word[2] or "0"
        if key in words and key not in "GM":
            raise InputError(f"{key} stands twice in {code.strip()[:40]!r}")
        words[key] = 0.0 if value[0] == '"' else float(value)
        if math.isinf(words[key]):
            raise InputError(f"{key} is too large in {code.strip()[:40]!r}")
        at = word.end()
    return name, words


@dataclass(slots=True)
class GcodeState:
    """A printer between two lines; lengths in mm, speeds in mm/s.

    - `x`, `y`, `z`, `e`: in the file's coordinates, as the machine reports them (M114).
    - `shift`: what G92 added: bed position = coordinate + shift.
    - `speed`: of the last F; before any, that of Marlin (1500 mm/min).
    - `filament`: mm pushed in all; `filament_area`: mm^2 of its section; `flow`: mm of filament
      that are told for each mm that is meant.
    - `homed`: axes that have been homed. `nozzle`, `bed`: set temperatures of the tool in use and
      of the bed; `nozzles`: of all tools.
    - `power`: spindle or laser power S while on, `spindle`: the command that set it (M3, M4), for
      machines without an extruder, which deposit `power` x `area_per_power` mm^2.
    - `unknown`: axes whose coordinate the machine may have set otherwise: since homing, a change of
      tool or a command of its own, until the file says where they are.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    e: float = 0.0
    absolute: bool = True
    relative_e: bool = False
    scale: float = 1.0
    speed: float = 25.0
    tool: int = 0
    fan: float = 0.0
    bed: float = 0.0
    nozzles: dict[int, float] = field(default_factory=dict)
    homed: frozenset[str] = frozenset()
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    filament: float = 0.0
    filament_area: float = math.pi / 4 * 1.75**2
    flow: float = 1.0
    motion: str = "G0"
    power: float = 0.0
    spindle: str = "M3"
    area_per_power: float = 0.0
    unknown: frozenset[str] = frozenset("XYZE")

    @classmethod
    def of(cls, machine: Machine) -> "GcodeState":
        """That of a machine that was switched on, with its filament."""
        if machine.gcode is None:
            return cls()
        extrusion = machine.gcode.extrusion
        return cls(filament_area=math.pi / 4 * extrusion.filament**2, flow=extrusion.flow)

    @property
    def nozzle(self) -> float:
        return self.nozzles.get(self.tool, 0.0)

    @property
    def position(self) -> Position:
        """x, y, z, e as the machine reports them, None where that is not known."""
        if not self.unknown:
            return self.x, self.y, self.z, self.e
        x, y, z, e = (None if a in self.unknown else getattr(self, a.lower()) for a in "XYZE")
        return x, y, z, e

    @property
    def placed(self) -> bool:
        """Whether it has been homed and then told where to be, so that it can leave and return."""
        return self.homed.issuperset("XYZ") and not self.unknown & set("XYZ")

    @property
    def on_bed(self) -> Point:
        sx, sy, sz = self.shift
        return self.x + sx, self.y + sy, self.z + sz

    def copy(self) -> "GcodeState":
        return replace(self, nozzles=dict(self.nozzles))

    def run(self, code: str) -> tuple[Move, ...]:
        """Take the state past a line without comments; the moves that the line makes.

        Commands that change nothing that is kept here are passed over. Raises `InputError` for
        what is no command, and for an arc that is none.
        """
        plain = _PLAIN.fullmatch(code)
        if plain is not None and self.absolute and self.scale == 1.0:
            return self._plain(*plain.groups())
        name, words = parse(code)
        name = name or self.motion
        if "G" in words or "M" in words:
            names = [letter.upper() + number for letter, number in _BLOCK.findall(code)]
            if len(names) > 1:
                return self._block(names, _BLOCK.sub("", code))
        if name in _MOTION:
            return self.move(name, words)
        if name in _SETTERS:
            _SETTERS[name](self, words)
        elif name in ("G28", "$H"):
            return self._home(words)
        elif name == "G4":
            seconds = words.get("S", 0.0) or words.get("P", 0.0) / 1000
            return (Move(self.on_bed, self.on_bed, 0.0, seconds=seconds),)
        elif name in ("G10", "M568") and "P" in words:  # a tool's temperature in RepRapFirmware
            self._heat({**words, "T": words["P"]})
        elif name[0] == "T" and name[1:].isdigit():
            self.tool = int(name[1:])
            self.unknown = frozenset("XYZE")
        elif name in _MOVING or not (name[0] in "GM" and name[1].isdigit()):
            self.unknown = frozenset("XYZE")
        return ()

    def _plain(
        self, name: str, x: str, y: str, e: str | None, feed: str | None
    ) -> tuple[Move, ...]:
        """What `move` does, for absolute coordinates in mm: nearly all lines, so in a hurry."""
        self.motion = name
        sx, sy, sz = self.shift
        z = self.z + sz
        start = (self.x + sx, self.y + sy, z)
        self.x = to_x = float(x)
        self.y = to_y = float(y)
        if feed is not None:
            self.speed = float(feed) / 60
        if self.unknown:
            self.unknown -= {"X", "Y"} if self.relative_e or e is None else {"X", "Y", "E"}
        pushed = 0.0 if e is None else self._push(float(e))
        return self._straight(start, (to_x + sx, to_y + sy, z), pushed)

    def _block(self, names: list[str], words: str) -> tuple[Move, ...]:
        """Several commands in one line, as grbl takes them: motion comes last."""
        moves: tuple[Move, ...] = ()
        for name in sorted(names, key=lambda name: parse(name)[0] in _MOTION):
            moves += self.run(f"{name} {words}")
        return moves

    def move(self, name: str, words: Mapping[str, float]) -> tuple[Move, ...]:
        """Make the motion of G0 to G3."""
        self.motion = name
        k = self.scale
        if "F" in words:
            self.speed = words["F"] * k / 60
        start = self.on_bed
        if self.absolute:
            self.x = words["X"] * k if "X" in words else self.x
            self.y = words["Y"] * k if "Y" in words else self.y
            self.z = words["Z"] * k if "Z" in words else self.z
        else:
            self.x += words.get("X", 0.0) * k
            self.y += words.get("Y", 0.0) * k
            self.z += words.get("Z", 0.0) * k
        pushed = self._push(words["E"] * k) if "E" in words else 0.0
        if self.unknown and self.absolute:
            given = words.keys() - {"E"} if self.relative_e else words.keys()
            self.unknown -= given
        if name in ("G2", "G3"):
            return self._arc(name, words, start, pushed)
        return self._straight(start, self.on_bed, pushed)

    def _push(self, e: float) -> float:
        """Filament that a move with this E pushes, mm."""
        if self.relative_e or not self.absolute:
            self.e += e
        else:
            e, self.e = e - self.e, e
        self.filament += e
        return e

    def _straight(self, start: Point, end: Point, pushed: float) -> tuple[Move, ...]:
        speed = self.speed if self.speed > _SLOWEST else _SLOWEST
        volume = pushed * self.filament_area / self.flow
        if start == end and pushed:
            return (Move(start, end, speed, volume, abs(pushed) / speed),)
        if self.area_per_power and self.motion == "G1":
            volume = self.power * self.area_per_power * Move(start, end, speed).length
        return (Move(start, end, speed, volume),)

    def _arc(
        self, name: str, words: Mapping[str, float], start: Point, pushed: float
    ) -> tuple[Move, ...]:
        from fdjax.formats import arcs  # its arrays are loaded for arcs only

        k, turn = self.scale, -1 if name == "G2" else 1
        end, speed = self.on_bed, max(self.speed, _SLOWEST)
        volume = pushed * self.filament_area / self.flow
        if "R" in words:
            centre = arcs.centre(start[:2], end[:2], words["R"] * k, turn)
        elif "I" in words or "J" in words:
            centre = (start[0] + words.get("I", 0.0) * k, start[1] + words.get("J", 0.0) * k)
        else:
            raise InputError("an arc needs I and J, or R")
        if not math.dist(start[:2], centre) < _LARGEST_RADIUS:
            raise InputError(f"an arc of more than {_LARGEST_RADIUS:g} mm radius cannot be meant")
        points = arcs.between(start[:2], end[:2], centre, turn)
        count = len(points)
        moves, before = [], start
        for number, (x, y) in enumerate(points, 1):
            after = (x, y, start[2] + (end[2] - start[2]) * number / count)
            share = volume / count
            if self.area_per_power:
                share = self.power * self.area_per_power * Move(before, after, speed).length
            moves.append(Move(before, after, speed, share))
            before = after
        return tuple(moves)

    def _home(self, words: Mapping[str, float]) -> tuple[Move, ...]:
        start = self.on_bed
        axes = [axis for axis in "XYZ" if axis in words] or list("XYZ")
        shift = dict(zip("XYZ", self.shift, strict=True))
        for axis in axes:
            setattr(self, axis.lower(), 0.0)
            shift[axis] = 0.0
        self.shift = (shift["X"], shift["Y"], shift["Z"])
        self.homed |= frozenset(axes)
        self.unknown |= frozenset(axes)
        return (Move(start, self.on_bed, HOMING_SPEED),)

    def _set_position(self, words: Mapping[str, float]) -> None:
        k, bed = self.scale, dict(zip("XYZ", self.on_bed, strict=True))
        named = words or dict.fromkeys("XYZE", 0.0)
        shift = dict(zip("XYZ", self.shift, strict=True))
        for axis in "XYZ":
            if axis in named:
                setattr(self, axis.lower(), named[axis] * k)
                shift[axis] = bed[axis] - named[axis] * k
        self.shift = (shift["X"], shift["Y"], shift["Z"])
        if "E" in named:
            self.e = named["E"] * k
        self.unknown -= named.keys()

    def _heat(self, words: Mapping[str, float]) -> None:
        if "S" in words or "R" in words:
            self.nozzles[int(words.get("T", self.tool))] = words.get("S", words.get("R", 0.0))

    def _heat_bed(self, words: Mapping[str, float]) -> None:
        if "S" in words or "R" in words:
            self.bed = words.get("S", words.get("R", 0.0))

    def _start_fan(self, words: Mapping[str, float]) -> None:
        self.fan = words.get("S", 255.0)

    def _set_power(self, words: Mapping[str, float], spindle: str) -> None:
        self.power, self.spindle = words.get("S", self.power), spindle

    def _set(self, **values: object) -> None:
        for name, value in values.items():
            setattr(self, name, value)


HOMING_SPEED = 40.0
"""mm/s, assumed of homing."""

_SETTERS = {
    "G20": lambda state, _: state._set(scale=25.4),
    "G21": lambda state, _: state._set(scale=1.0),
    "G90": lambda state, _: state._set(absolute=True),
    "G91": lambda state, _: state._set(absolute=False),
    "M82": lambda state, _: state._set(relative_e=False),
    "M83": lambda state, _: state._set(relative_e=True),
    "G92": GcodeState._set_position,
    "M104": GcodeState._heat,
    "M109": GcodeState._heat,
    "M140": GcodeState._heat_bed,
    "M190": GcodeState._heat_bed,
    "M106": GcodeState._start_fan,
    "M107": lambda state, _: state._set(fan=0.0),
    "M3": lambda state, words: state._set_power(words, "M3"),
    "M4": lambda state, words: state._set_power(words, "M4"),
    "M5": lambda state, _: state._set(power=0.0),
}
