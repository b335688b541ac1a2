"""What firmwares make of the same G-code, where they differ: the columns of the table."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Kept:
    """A setting that holds until it is given again, word by word.

    - `by`: words that say whose it is (a tool, a fan, a heater): each of them has its own.
      `of_tool`: the one of `by` that names a tool, where without it the tool in use is meant.
    - `once`: words that do something once and set nothing.
    - `over`: words, and the others that each puts out of force.
    - `ends`: commands whose setting this one puts out of force. `bare`: whether it sets something
      without a word.
    """

    by: tuple[str, ...] = ()
    of_tool: str = ""
    once: tuple[str, ...] = ()
    over: Mapping[str, str] = field(default_factory=dict)
    ends: tuple[str, ...] = ()
    bare: bool = False


@dataclass(frozen=True)
class Firmware:
    """How a firmware reads G-code.

    - `e_mode`: what G90 and G91 do to E. "set": they set its mode too, and M82, M83 set it again.
      "while": G91 makes it relative for as long as it is in force. "apart": only M82 and M83 do.
    - `first_motion`: what words alone go on with before any motion; none with most.
    - `first_speed`: mm/s, before any F; 0 where no motion but G0 is made without one.
    - `modal`: whether words alone go on with the last motion; elsewhere a sender has to name it.
    - `runs_all`: whether it runs all commands of a line, or the first only.
    - `extrudes`: whether it knows E.
    - `dwell`: seconds of a unit of each word of G4; the first of them that is given counts.
    - `needs_dwell`: whether G4 without any of these is refused.
    - `no_speed`: what F0 is: "ignored", "refused" or the "slowest" speed.
    - `splines`: whether it may have G5.
    - `chord`: mm of the straight pieces of arcs, 0 for fine ones. `radius_arcs`, `relative_arcs`:
      whether it takes R, and arcs under G91.
    - `fan`, `flow_tool`: words that name the fan of M106 and the tool of M221; none for one only.
    - `bare_fan`: whether M106 without S is full speed.
    - `one_acceleration`: whether M204 sets one for roads and travel, the lesser of P and T.
    - `tool_begins_anew`: whether another tool's E counts from 0, and M221 ends.
    - `coldest`: whether M302 sets the temperature below which nothing is pushed.
    - `home_ends`: commands whose setting homing puts out of force.
    - `stands`: lines that say at which height the nozzle stands, without homing; `shifts_machine`:
      whether G92 says where the machine itself is, so that axes that it names count as homed, and
      soft end stops go with it.
    - `skipping`: what becomes of the coordinates while the moves of an object that is left out are
      not made: each of them "stays", or "goes on".
    - `save`, `restore`: commands that save the state and bring it back; `stacks`: without a name,
      the last one saved first. `saves_place`: whether the place is all that they save.
    - `kept`: settings by their commands; `harmless`: extended commands that do not move.
    - `refused`: commands that it refuses, and why.
    - `known`: the G and M commands that it knows, where the table of all does not do; it passes
      over all others with a word, or refuses them where it `refuses_unknown`.
    """

    name: str
    e_mode: str = "set"
    first_motion: str = ""
    first_speed: float = 25.0
    modal: bool = False
    runs_all: bool = False
    extrudes: bool = True
    dwell: Mapping[str, float] = field(default_factory=lambda: {"S": 1.0, "P": 1e-3})
    needs_dwell: bool = False
    no_speed: str = "slowest"
    splines: bool = False
    chord: float = 0.0
    radius_arcs: bool = True
    relative_arcs: bool = True
    fan: str = "P"
    bare_fan: bool = True
    one_acceleration: bool = False
    flow_tool: str = "T"
    tool_begins_anew: bool = False
    coldest: bool = True
    home_ends: tuple[str, ...] = ()
    stands: tuple[str, ...] = ("G92 Z{z:.3f}",)
    shifts_machine: bool = False
    skipping: str = "goes on"
    save: str = ""
    restore: str = ""
    stacks: bool = False
    saves_place: bool = False
    kept: Mapping[str, Kept] = field(default_factory=dict)
    harmless: frozenset[str] = frozenset()
    refused: Mapping[str, str] = field(default_factory=dict)
    known: frozenset[str] = frozenset()
    refuses_unknown: bool = False
