"""Reading SML: the roads that its motion commands and flow codes lay."""

import math
import re
from collections import deque

import numpy as np

from fdjax.arcs import arc_points
from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.formats.assembly import Assembly, option
from fdjax.formats.profile import Machine, Sml
from fdjax.formats.sml_codes import (
    FARTHEST,
    MOST_ACTIONS,
    MOST_OUTPUTS,
    MOST_STEPS,
    Floats,
    Ints,
    counts_of,
)
from fdjax.plan.toolpath import Build, Outline
from fdjax.units import MICROSTEP

_MOVES = re.compile(r"(?:^MA-?\d{1,6},-?\d{1,6};\n)+", re.MULTILINE)
"""Nearly all that is in a file: moves one after the other, that are read together."""
_COMMAND = re.compile(r"([A-Za-z]{2})([-+.,\d\s]*)")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
_MACHINE = re.compile(r"^\W*fdjax machine = (.*)$", re.MULTILINE)

_ACTIONS = {"AA", "AR", "CD", "MA", "MR", "SP", "TD"}
_PASSED_OVER = {"SR", "AC", "PD", "WA", "CZ", "FH", "CD", "SP", "TD", "AZ", "MZ"}


def read(
    text: str,
    *,
    machine: Machine | None = None,
    layer_height: float | None = None,
    outline: Outline | None = None,
) -> Build:
    """The roads that an SML file lays, with the widths that its flow codes give them.

    A path (BC ... EC), or a single move outside, is a road where an even flow code is set for it
    by MM; the first such code holds from the road's start, each other from its place on. Odd codes
    start the flow and roll it back, and change no section.

    `machine` is by default the bundled one that the file's header names; it holds the law from
    codes to sections and the commands of Z and materials. `layer_height` (mm) and `outline`
    replace what the file says of them; where it says nothing, a layer's height is the difference
    of z's.

    Raises `InputError`, with the line, for text that is no SML, an unknown command, a file that is
    truncated, coordinates out of range, or too many actions, outputs or microsteps in a path.
    """
    option(layer_height, "layer height")
    if machine is None:
        named = _MACHINE.search(text)
        if named is None:
            raise InputError("SML: the file does not name its machine (or is no SML); give it")
        name = named[1].strip()
        if name not in profile.names():
            raise InputError(f"SML: machine {name!r} is not a bundled one; give its profile")
        machine = profile.load(name)
    if machine.sml is None:
        raise InputError(f"machine {machine.name} reads no SML: its profile has no [sml]")
    plotter = _Plotter(machine.sml)
    done = 0
    try:
        for moves in _MOVES.finditer(text):
            plotter.read(text[done : moves.start()])
            plotter.move(moves[0])
            done = moves.end()
        plotter.read(text[done:])
        plotter.finish()
    except InputError as error:
        raise InputError(f"SML line {plotter.line}: {error}") from None
    return plotter.assembly.build(
        unit=machine.sml.area_per_code, layer_height=layer_height, outline=outline
    )


class _Plotter:
    """The state of a machine that runs the file; positions in microsteps on the bed."""

    def __init__(self, sml: Sml) -> None:
        self.assembly = Assembly()
        self._mark = sml.mark
        self._layer = sml.layer[:2].upper()
        self._materials = [_squeeze(commands) for commands in sml.materials]
        self._footer = [_squeeze(part) for line in sml.footer for part in line.split(";")[:-1]]
        own = [*sml.materials, *sml.header, *sml.footer, *sml.stop]
        own = [part.strip()[:2].upper() for line in own for part in line.split(";")]
        self._passed_over = _PASSED_OVER.union(own)
        self._at = (0.0, 0.0)
        self._z = 0.0
        self._material = 0
        self._outputs: list[tuple[int, int]] = []
        self._suspended = False
        self._path: list[tuple[float, float]] | None = None  # since BC
        self._actions = 0
        self._last: deque[str] = deque(maxlen=max(1, len(self._footer)))
        self._comment = sml.comment
        self._rest = ""
        self.line = 0

    def read(self, text: str) -> None:
        """Whole lines of the file."""
        for line in text.splitlines():
            self.line += 1
            if line.startswith(self._comment):
                self.assembly.comment(line)
                continue
            *commands, self._rest = (self._rest + line).split(";")
            for command in commands:
                self.run(command)

    def move(self, text: str) -> None:
        """Lines that match `_MOVES`, all at once where they are of one path and within limits."""
        count = text.count("\n")
        if self._rest or self._path is None or self._actions + count > MOST_ACTIONS:
            return self.read(text)
        numbers = text.replace("MA", "").replace(";\n", ",")[:-1]
        to = np.fromstring(numbers, sep=",").reshape(count, 2)
        if np.abs(to).max() > FARTHEST + 1:
            return self.read(text)
        self._path += [(x, y) for x, y in to.tolist()]
        self._at = self._path[-1]
        self._actions += count
        self._last.extend(text.split(";\n")[:-1])
        self.line += count

    def run(self, command: str) -> None:
        """Run one command, without its semicolon."""
        command = command.strip().removeprefix(self._mark).strip()
        if not command:
            return
        match = _COMMAND.fullmatch(command)
        # The numbers are looked at apart: one pattern for all would take exponential time.
        if match is None or _NUMBER.sub("", match[2]).strip(", \t\r\n"):
            raise InputError(f"not SML: {command[:30]!r} is no two letters with numbers")
        name = match[1].upper()
        self._act(command, acts=name in _ACTIONS)
        if name in ("MA", "MR"):
            self._move(name, _numbers(match, 2))
        elif name in ("AA", "AR"):
            self._arc(name, _numbers(match, 3))
        elif name == "MM":
            self._output(match)
        elif name == "VM":
            self._suspended = True
        elif name == "BC":
            self._begin()
        elif name == "EC":
            self._end()
        elif name == self._layer:
            self._z = _numbers(match, 1)[0] * MICROSTEP
        elif _squeeze(command) in self._materials:
            self._material = self._materials.index(_squeeze(command))
        elif name not in self._passed_over:
            raise InputError(f"unknown command {name} in {command[:30]!r}")

    def _act(self, command: str, *, acts: bool = True) -> None:
        """Note a command, and count it where it is an action of a path."""
        self._last.append(command)
        if acts and self._path is not None:
            self._actions += 1
            if self._actions > MOST_ACTIONS:
                raise InputError(f"more than {MOST_ACTIONS} actions between BC and EC")

    def _begin(self) -> None:
        if self._path is not None:
            raise InputError("BC inside a continuous path; EC is missing before it")
        self._path, self._actions = [self._at], 0

    def _end(self) -> None:
        if self._path is None:
            raise InputError("EC without BC")
        path, self._path = self._path, None
        self._lay(path)

    def _move(self, name: str, to: list[float]) -> None:
        if name == "MR":
            to = [self._at[0] + to[0], self._at[1] + to[1]]
        self._go([(to[0], to[1])])

    def _arc(self, name: str, words: list[float]) -> None:
        x, y, degrees = words
        centre = (x, y) if name == "AA" else (self._at[0] + x, self._at[1] + y)
        start = (self._at[0] * MICROSTEP, self._at[1] * MICROSTEP)
        points = arc_points(
            start, (centre[0] * MICROSTEP, centre[1] * MICROSTEP), math.radians(degrees)
        )
        self._go([(x / MICROSTEP, y / MICROSTEP) for x, y in points])

    def _go(self, points: list[tuple[float, float]]) -> None:
        end = points[-1]
        if not (abs(end[0]) <= FARTHEST + 1 and abs(end[1]) <= FARTHEST + 1):
            raise InputError(f"({end[0]:g}, {end[1]:g}) is out of range; +-{FARTHEST + 1} can be")
        if self._path is None:
            self._lay([self._at, *points])
        else:
            self._path += points
        self._at = end

    def _output(self, match: re.Match[str]) -> None:
        numbers = _NUMBER.findall(match[2])
        if not numbers:
            self._outputs, self._suspended = [], False
            return
        count, code, *_ = [int(float(number)) for number in numbers] + [-1]
        if not 0 <= code <= 255:
            raise InputError(f"MM{match[2]}: a flow code from 0 to 255 is needed")
        if len(self._outputs) == MOST_OUTPUTS:
            raise InputError(
                f"more than {MOST_OUTPUTS} output changes (MM) since they were cleared"
            )
        self._outputs.append((count, code))

    def _lay(self, points: list[tuple[float, float]]) -> None:
        """A move is over: a road, if a gain code is set for it, else travel."""
        path = np.array(points)
        moved = np.append(True, (np.diff(path, axis=0) != 0).any(axis=1))
        path = path[moved]
        gains = [output for output in self._outputs if output[1] % 2 == 0]
        if self._suspended or len(path) < 2 or not any(code for _, code in gains):
            return
        counts = counts_of(path)
        if counts[-1] > MOST_STEPS:
            raise InputError(f"a path of {counts[-1]} microsteps; {MOST_STEPS} can be")
        places = sorted((count + (counts[-1] if count < 0 else 0), code) for count, code in gains)
        path = _with_places(path, counts, [place for place, _ in places[1:]])
        counts = counts_of(path)
        codes = np.full(len(path) - 1, float(places[0][1]))
        for place, code in places[1:]:
            codes[_nearest(counts, place) :] = code
        self.assembly.add(path * MICROSTEP, codes, z=self._z, material=self._material)

    def finish(self) -> None:
        """Check that the file is whole."""
        if not self._last:
            raise InputError("not SML: there is no command")
        if rest := self._rest.strip():
            raise InputError(f"the file is truncated: {rest[:30]!r} has no semicolon")
        if self._path is not None:
            raise InputError("the file is truncated: BC without EC")
        if self._footer and [_squeeze(command) for command in self._last] != self._footer:
            raise InputError(f"the file is truncated: it does not end in {';'.join(self._footer)};")
        if self.assembly.facts.written_by_fdjax and not self.assembly.ended:
            raise InputError("the file is truncated: no end mark of fdjax")
        if self.assembly.empty:
            raise InputError("nothing is deposited")


def _nearest(counts: Ints, place: int) -> int:
    k = int(np.searchsorted(counts, place))
    return k - (k > 0 and (k == len(counts) or place - counts[k - 1] < counts[k] - place))


def _with_places(path: Floats, counts: Ints, places: list[int]) -> Floats:
    """The path with a point added at each place, microsteps from its start, that has none near."""
    added = []
    for place in places:
        if abs(counts[_nearest(counts, place)] - place) > 1 and 0 < place < counts[-1]:
            k = int(np.searchsorted(counts, place))
            share = (place - counts[k - 1]) / (counts[k] - counts[k - 1])
            added.append((k, path[k - 1] + share * (path[k] - path[k - 1])))
    if not added:
        return path
    return np.insert(path, [k for k, _ in added], [point for _, point in added], axis=0)


def _numbers(match: re.Match[str], count: int) -> list[float]:
    numbers = [float(number) for number in _NUMBER.findall(match[2])]
    if len(numbers) != count:
        raise InputError(f"{match[1].upper()} has {len(numbers)} numbers, not {count}")
    return numbers


def _squeeze(commands: str) -> str:
    return re.sub(r"\s", "", commands).rstrip(";").upper()
