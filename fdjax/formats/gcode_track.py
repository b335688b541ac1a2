"""What G-code lays, segment by segment: the interpreter run over a whole file, in bulk."""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats.gcode_bulk import advance, paid, takes_many
from fdjax.formats.gcode_scan import Block, Floats, Ints, blocks
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import NoCommand, code_of, command_of
from fdjax.moves import Move

_FEW = 12
"""Lines up to which one after the other is faster than all at once."""
_HARMLESS = re.compile(
    r"M(?:7[3-8]|10[4-9]|11[0-9]|14[0-9]|15[0-9]|190|191|20[1-9]|21[0-9]|220|300|400|42[0-9]|566"
    r"|572|593|84|900|907|862(?:\.\d+)?)(?![\d.])"
)
"""Commands that change nothing on which a deposit depends."""
_KNOWN = re.compile(r"[GT]\d+(?:\.\d+)?$|M\d{1,3}(?:\.\d+)?$|\$H$|SET_|EXCLUDE_OBJECT|TIMELAPSE_")
_NAMED = re.compile(r"(?:M98|M206|M218|G12|SET_GCODE_OFFSET)$")
"""What runs another file or puts nozzles elsewhere, which is told to the user."""
_TELLING = re.compile(r"[0-9{}\[\]#=]")
"""In a line that is no command: it may have been one, or be a program's."""
_OBJECT = re.compile(r"EXCLUDE_OBJECT_(START|END)(?:.*NAME=(\S+))?|M486 S(-?\d+)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Track:
    """Straight pieces that are laid, one after the other.

    - `start`, `end`: shape (n, 3), mm on the bed; `volume`: shape (n,), mm^3.
    - `line`: of the file; `road`: rises wherever the flow stops; `tool`; shapes (n,).
    - `by_length`: whether E was filament, not mm^3, somewhere; `commanded`: whether there was any
      command; `lines`: of the file; `base`: Z of the bed's coordinate that the file calls 0.
    - `disputed`: whether E moved while firmwares differ on whether it is relative; `backwards`:
      share of the moves with E, of absolute E, that would lay nothing.
    - `unknown`: names of commands that are passed over, with their first lines.
    """

    start: Floats
    end: Floats
    volume: Floats
    line: Ints
    road: Ints
    tool: Ints
    by_length: bool
    commanded: bool
    lines: int
    base: float
    disputed: bool
    backwards: float
    unknown: dict[str, int]

    def length(self, pieces: slice | Ints) -> Floats:
        """Of some pieces, seen from above, mm."""
        start, end = self.start[pieces], self.end[pieces]
        run, rise = end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]
        return np.sqrt(run * run + rise * rise)


_KINDS = (np.int32, float)
_COLUMNS = (("start", 3), ("end", 3), ("volume", 1), ("line", 0), ("road", 0), ("tool", 0))
COLUMNS = tuple(name for name, _ in _COLUMNS)
"""Names of the arrays of a `Track`."""


@dataclass
class _Tracker:
    state: GcodeState
    comment: Callable[[int, str], None]
    thing: Callable[[int, str], None]
    keeps_short: Callable[[], bool]
    behind: Callable[[int, str], None] | None
    owed: float = 0.0  # of material, mm^3, pulled back and not yet returned
    owings: dict[int, float] = field(default_factory=dict)  # of tools that are not in use
    tool: int = 0
    road: int = 0
    commanded: bool = False
    by_length: bool = False
    base: float | None = None
    disputed: bool = False
    unknown: dict[str, int] = field(default_factory=dict)
    rows: list[tuple[float, ...]] = field(default_factory=list)
    columns: dict[str, NDArray] = field(default_factory=dict)
    size: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    by_word: bool = False  # whether M82 and M83 alone make E relative
    by_last: bool = False  # and if G90 and G91 do so too
    line: int = 0

    def take(self, block: Block) -> None:
        """Take the lines of a block."""
        motions = np.flatnonzero(block.plain | block.resets)
        spoken = block.comments | block.others
        if self.behind is not None:
            spoken |= block.plain
        for index in np.flatnonzero(spoken).tolist():
            text = block.text(index)
            self.line = block.first + index
            if text[:1] == ";":
                self.comment(self.line, text)
            elif block.plain[index]:
                if self.behind is not None and ";" in text:
                    self.behind(self.line, text[text.index(";") :])
            elif match := _OBJECT.match(text):
                name = match[2] or match[3] or ""
                self.thing(self.line, "" if name.startswith("-") else name)
        done = 0
        for index in np.flatnonzero(block.others).tolist():
            self.line = block.first + index
            code = code_of(block.text(index))
            if not code:
                continue
            if not _HARMLESS.match(code):
                reached = int(np.searchsorted(motions, index))
                self.run_many(block, motions[done:reached])
                done = reached
                self.line = block.first + index
            self.run(code)
        self.run_many(block, motions[done:])
        self.settle()

    def run(self, code: str) -> None:
        """Take one line, without comment, to the state."""
        state = self.state
        self.commanded = self.commanded or (code[0] in "GMTgmt" and code[1:2].isdigit())
        before = state.e
        try:
            moves = state.run(code)
        except NoCommand:
            if _TELLING.search(code):
                raise
            if code == "%":
                return
            self.unknown.setdefault(code[:20], self.line)
            return
        name = command_of(code)[0]
        if name in ("M82", "M83"):
            self.by_word = self.by_last = name == "M83"
        elif name in ("G90", "G91"):
            self.by_last = name == "G91"
        elif name and not moves and (_NAMED.match(name) or not _KNOWN.match(name)):
            self.unknown.setdefault(name[:30], self.line)
        if state.tool != self.tool:
            self.road += 1
            self.owings[self.tool] = self.owed
            self.tool = state.tool
            self.owed = self.owings.get(self.tool, 0.0)
        if moves and state.e != before:
            self.look_at_modes()
        has_e = "E" in code.upper()
        for move in moves:
            self.follow(move, has_e)

    def follow(self, move: Move, has_e: bool) -> None:
        """Take one move of a line, which names E or not."""
        start, end, _, volume, _ = move
        moved = start[0] != end[0] or start[1] != end[1]
        if moved and has_e:
            self.counts["e"] += 1
            self.counts["none"] += volume <= 0
        paid = 0.0
        if volume < 0:
            self.owed -= volume
        elif self.owed and volume:
            paid = min(self.owed, volume)
            self.owed -= paid
        laid = volume - paid
        if moved and (laid > 0 or (laid == 0 and has_e and self.keeps_short())):
            self.rows.append((*start, *end, laid, self.line, self.road, self.tool))
        elif moved or start[2] != end[2] or volume < 0:
            self.road += 1
            return
        else:
            return
        if self.base is None:
            self.base = self.state.shift[2]
        self.by_length = self.by_length or not self.state.volumetric

    def look_at_modes(self) -> None:
        """Whether E is absolute may depend on the firmware."""
        state = self.state
        modes = {self.by_last, self.by_word, self.by_word or not state.absolute}
        self.disputed = self.disputed or len(modes) > 1

    def run_many(self, block: Block, chosen: Ints) -> None:
        """Take these plain lines and resets of a block."""
        state = self.state
        if len(chosen) <= _FEW or not takes_many(state):
            for index in chosen.tolist():
                self.line = block.first + index
                text = block.text(index)
                move = state.plain(text)
                if move is None:
                    self.run(code_of(text))
                else:
                    self.commanded = True
                    if " E" in text:
                        self.look_at_modes()
                    self.follow(move, " E" in text)
            return
        self.commanded = True
        self.settle()
        motions = advance(state, block, chosen)
        start, end, volume, has_e = motions.start, motions.end, motions.volume, motions.has_e
        if has_e.any():
            self.look_at_modes()
        moved = motions.moved
        climbs = start[2] != end[2]
        both = has_e & moved
        self.counts["e"] += int(both.sum())
        self.counts["none"] += int((both & (volume <= 0)).sum())
        laid, self.owed = paid(volume, self.owed)
        lays = moved & (laid > 0)
        if self.keeps_short():
            lays |= both & (laid == 0) & (volume >= 0)
        stops = ~lays & (moved | climbs | (volume < 0))
        road = self.road + np.cumsum(stops)
        self.road = int(road[-1])
        own = np.flatnonzero(lays)
        if len(own):
            if self.base is None:
                self.base = state.shift[2]
            self.by_length = self.by_length or not state.volumetric
            numbers = block.first + chosen[own]
            ends = (each.take(own, axis=1).T for each in (start, end))
            values = (*ends, laid[own], numbers, road[own], self.tool)
            self._keep(values, len(own))
        self.line = block.first + int(chosen[-1])

    def settle(self) -> None:
        """Rows that were taken one by one join the others."""
        if self.rows:
            table = np.array(self.rows)
            self.rows.clear()
            numbers = (table[:, column].astype(np.intp) for column in (7, 8, 9))
            self._keep((table[:, :3], table[:, 3:6], table[:, 6], *numbers), len(table))

    def _keep(self, values: tuple[NDArray | int, ...], count: int) -> None:
        begin, self.size = self.size, self.size + count
        if self.size > len(self.columns["line"]):
            self.reserve(2 * self.size)
        for name, value in zip(COLUMNS, values, strict=True):
            self.columns[name][begin : self.size] = value

    def reserve(self, count: int) -> None:
        """Make room for so many pieces; what is not used takes no memory."""
        for name, width in _COLUMNS:
            # Of points all x lie together, then all y, then all z.
            room = np.empty((3, count)).T if width == 3 else np.empty(count, _KINDS[width])
            old = self.columns.get(name, room[:0])
            room[: len(old)] = old
            self.columns[name] = room

    def result(self) -> Track:
        columns = {name: column[: self.size] for name, column in self.columns.items()}
        counted = max(self.counts["e"], 1)
        return Track(
            **columns,
            by_length=self.by_length,
            commanded=self.commanded,
            lines=self.line,
            base=self.base or 0.0,
            disputed=self.disputed,
            backwards=self.counts["none"] / counted,
            unknown=self.unknown,
        )


def track(
    data: bytes,
    state: GcodeState,
    *,
    comment: Callable[[int, str], None],
    thing: Callable[[int, str], None],
    keeps_short: Callable[[], bool],
    behind: Callable[[int, str], None] | None = None,
) -> Track:
    """Run a file on a state. Does what the state's own `run` does, line by line.

    `comment` takes number and text of each comment line, `thing` number and name where a command
    begins an object, `behind` those of comments behind plain motion. `keeps_short` says whether a
    move whose E is rounded to nothing is laid.
    Raises `InputError`, with the line, for what the state cannot follow.
    """
    tracker = _Tracker(state, comment, thing, keeps_short, behind, tool=state.tool)
    tracker.reserve(data.count(b"\n") + 1)
    number = 0
    try:
        for block in blocks(data):
            tracker.take(block)
            number = block.first + len(block.start) - 1
    except InputError as error:
        raise InputError(f"G-code line {tracker.line}: {error}") from None
    tracker.line = number
    return tracker.result()
