"""A line on its way to a machine, with what is known of it beforehand."""

from dataclasses import dataclass

from fdjax.gcode.state import GcodeState
from fdjax.machine.program import State
from fdjax.moves import Position

BLOCKING = 1800.0
"""Seconds that heating, homing and the like may take without a sign of life."""
_QUICK = frozenset(
    [f"G{number}" for number in (0, 1, 2, 3, 17, 20, 21, 90, 91, 92)]
    + [f"M{number}" for number in (3, 4, 5, 73, 82, 83, 104, 105, 106, 107, 114, 117, 140, 204)]
)
"""Commands that take no longer than their motion, as settings do; all others may heat, home or
probe."""


@dataclass(slots=True)
class Entry:
    """A line on its way to the machine.

    - `line`: of the file; 0 for what the sender adds.
    - `seconds`: of its motion; `waits`: that it may take besides, to heat, home or probe.
    - `before`, `after`: x, y, z, e that the machine reports before and after it, mm.
    - `repeatable`: whether running it twice is as good as once.
    """

    text: str
    line: int = 0
    seconds: float = 0.0
    waits: float = 0.0
    before: Position = (0.0, 0.0, 0.0, 0.0)
    after: Position = (0.0, 0.0, 0.0, 0.0)
    repeatable: bool = False


def _is_quick(name: str, state: GcodeState) -> bool:
    return name in _QUICK or name in state.firmware.kept


def entry_of(text: str, line: int, state: State) -> Entry:
    """The entry of a line, past which `state` is taken. Raises `InputError` for no command."""
    before = state.position
    moves = state.run(text)
    seconds = sum(move.seconds or move.length / max(move.speed, 1e-3) for move in moves)
    slow = isinstance(state, GcodeState) and not _is_quick(text.partition(" ")[0].upper(), state)
    # A travel to where the machine stands already does nothing.
    absolute = isinstance(state, GcodeState) and state.absolute
    repeatable = not moves or (absolute and not any(move.volume for move in moves))
    blocking = BLOCKING if slow else 0.0
    return Entry(text, line, seconds, blocking, before, state.position, repeatable)
