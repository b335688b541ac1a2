"""Reading G-code, of fdjax or of anybody: what it deposits, as roads in layers."""

import math
import re
from collections.abc import Sequence

import numpy as np

from fdjax.errors import InputError
from fdjax.formats import header
from fdjax.formats.assembly import Marks, option
from fdjax.formats.gcode_layers import Choice, flat_roads, layers_of
from fdjax.formats.gcode_track import Track, track
from fdjax.formats.profile import Machine
from fdjax.formats.slicers import Comments, Settings, settings_of
from fdjax.gcode.firmware import KLIPPER, MARLIN, REPRAP, Firmware, firmware_of
from fdjax.gcode.state import GcodeState
from fdjax.plan.toolpath import Build, Layer, Outline
from fdjax.road.bead import road_width

_OWN_FILAMENT = re.compile(rb"fdjax (?:filament|flow) [=+].*")
_HEAD = 1 << 18
"""Bytes in which a file's own header is looked for."""
_TOOLS = 100
_BACKWARDS = 1 / 3
"""Share of moves with E above which its being absolute makes no sense: they would lay nothing."""


def read(
    text: str | bytes,
    *,
    machine: Machine | None = None,
    filament: float | Sequence[float] | None = None,
    layer_height: float | None = None,
    outline: Outline | None = None,
    firmware: str | None = None,
    choice: Choice | None = None,
) -> Build:
    """The roads that a G-code file lays, with the widths that its E values give them.

    The file is followed by `gcode.state`, the interpreter that also checks and streams it; arcs
    become polylines. Only XY moves that push filament out deposit: what a retraction (a wipe
    included) took back is owed first. Left out are deposits that are no part: what fdjax marks as
    priming; what slicers call skirt, brim, support, wipe tower or custom; what stands before their
    first layer, or higher than the first layer before it; roads outside `outline`.

    - `firmware`: marlin, klipper, rrf or grbl, whose reading holds; else the machine's, else what
      the slicer says, else that of Marlin, or of another where E makes no sense by Marlin's.
    - `filament`: diameter, mm, one or one a tool; else (with the flow factor) that of the file's
      header, else what a slicer says in a comment, else the machine's.
    - `layer_height` (mm), `outline`: instead of what the file says. `fdjax.formats.gcode_layers`
      has where heights are from otherwise.
    - `choice`: roles, objects and layers that are asked for; the part where it is None.

    The build's `reading` says what was used. Raises `InputError`, with the line, for text that is
    no G-code, a damaged word, a file of fdjax that is truncated, a file that deposits nothing, what
    the interpreter cannot follow, layers whose height cannot be told, or an unknown filament
    diameter.
    """
    given = [filament] if isinstance(filament, int | float) else list(filament or ())
    for diameter in given:
        option(diameter, "filament")
    option(layer_height, "layer height")
    data = text.encode() if isinstance(text, str) else text
    if b"\0" in data:
        raise InputError("not G-code: the file is binary")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    settings = settings_of(data)
    followed = _Followed(data, settings, machine, given, firmware)
    found, marks = followed.track, followed.marks
    by_fdjax = marks.facts.written_by_fdjax
    empty = not len(found.line) and not marks.layers
    if not found.commanded and empty:
        raise InputError(f"not G-code: no G, M or T command in its {found.lines} lines")
    if by_fdjax and not marks.ended:
        raise InputError(f"G-code line {found.lines}: the file is truncated: no end mark of fdjax")
    if empty:
        raise InputError(f"G-code: nothing is deposited in its {found.lines} lines")
    if not followed.diameters and found.by_length:
        raise InputError(
            "G-code: the file does not say the filament's diameter; give it (often 1.75 mm)"
        )
    # Bambu's T255 and T1000 are no tools.
    tools = int(found.tool.max(initial=0, where=found.tool < _TOOLS)) + 1
    if 1 < len(followed.diameters) < tools:
        raise InputError(
            f"G-code: tool {tools - 1} deposits, and {len(followed.diameters)} filament diameters "
            "are told, for the tools from 0 on"
        )
    reading = dict(followed.reading)
    if marks.layers:
        layers = _marked_layers(found, marks, layer_height, outline)
    else:
        layers, more = layers_of(
            found,
            followed.comments,
            settings,
            layer_height=layer_height,
            outline=outline,
            choice=choice or Choice(),
        )
        reading |= more
    if found.unknown:
        said = [f"{name} (line {number})" for name, number in list(found.unknown.items())[:9]]
        more = len(found.unknown) - len(said)
        reading["passed over"] = ", ".join(said) + (f" and {more} more" if more else "")
    origin = marks.facts.numbers("origin", 2) or (0.0, 0.0)
    return Build(
        layers,
        name=marks.facts.get("name") or "part",
        origin=(origin[0], origin[1]),
        notes=marks.facts.notes,
        reading={} if by_fdjax else reading,
    )


class _Followed:
    """A file that the interpreter has gone through: its track, comments and marks."""

    def __init__(
        self,
        data: bytes,
        settings: Settings,
        machine: Machine | None,
        given: Sequence[float],
        firmware: str | None,
    ) -> None:
        self._data = data
        self._settings = settings
        self.reading: dict[str, str] = {}
        extrusion = machine.gcode.extrusion if machine is not None and machine.gcode else None
        own, flow = _stated(data)
        choices = (
            (list(given), "as given"),
            (own, "the file's header"),
            (list(settings.diameters), "the slicer's comments"),
            ([extrusion.filament] if extrusion else [], "the machine"),
        )
        self.diameters, whence = next((c for c in choices if c[0]), ([], ""))
        self._flow = flow or (extrusion.flow if extrusion else 1.0)
        if whence:
            told = ", ".join(f"{diameter:g}" for diameter in self.diameters)
            self.reading["filament"] = f"{told} mm, {whence}"
        if settings.volumetric:
            self.reading["filament"] = "E is mm^3, as the slicer's comments say"
        of_machine = machine.stream.firmware if machine is not None else ""
        named = firmware or (of_machine if firmware_of(of_machine).name == of_machine else "")
        named = named or settings.firmware
        self._run(firmware_of(named))
        if not named and self.track.disputed:
            self._compare()

    def _run(self, firmware: Firmware) -> None:
        areas = [math.pi / 4 * diameter**2 for diameter in self.diameters] or [1.0]
        state = GcodeState(
            firmware,
            filament_area=areas[0],
            areas=dict(enumerate(areas)),
            flow=self._flow,
            volumetric=self._settings.volumetric,
        )
        self.comments, self.marks = Comments(), Marks()
        self.track = track(
            self._data,
            state,
            comment=self._comment,
            thing=self.comments.thing,
            keeps_short=lambda: self.marks.facts.get("version") is not None,
            behind=self.comments.behind if self._settings.slicer == "Slic3r" else None,
        )

    def _comment(self, line: int, text: str) -> None:
        if "fdjax " in text:
            self.marks.feed(line, text)
        else:
            self.comments.feed(line, text)

    def _compare(self) -> None:
        """The reading under which E makes sense, where firmwares differ."""
        runs = []
        for firmware in (MARLIN, KLIPPER, REPRAP):
            try:
                self._run(firmware)
            except InputError:
                continue  # its language is another
            runs.append((firmware, self.track, self.comments, self.marks))
        sensible = [run for run in runs if run[1].backwards <= _BACKWARDS] or runs
        firmware, self.track, self.comments, self.marks = sensible[0]
        volumes = {run[0].name: float(run[1].volume.sum()) for run in runs}
        own = volumes.pop(firmware.name)
        others = [
            f"{name} would lay {volume:.1f} mm^3"
            for name, volume in volumes.items()
            if not math.isclose(volume, own, rel_tol=1e-6)
        ]
        if others:
            said = f"G90 and E as in {firmware.name}: {own:.1f} mm^3; {', '.join(others)}"
            self.reading["firmware"] = said


def _stated(data: bytes) -> tuple[list[float], float | None]:
    """Filament diameter, mm, and flow that a file of fdjax states."""
    facts = header.Facts()
    for fact in _OWN_FILAMENT.findall(data, 0, _HEAD):
        facts.feed(fact.decode(errors="replace"))
    own, flow = facts.positive("filament"), facts.positive("flow")
    return ([own] if own is not None else []), flow


def _marked_layers(
    found: Track, marks: Marks, layer_height: float | None, outline: Outline | None
) -> tuple[Layer, ...]:
    """The layers that fdjax has marked."""
    lines = np.array([layer.line for layer in marks.layers])
    layer = np.searchsorted(lines, found.line, side="right") - 1
    prime_lines = np.array([0, *(line for line, _ in marks.primes)])
    primes = np.array([False, *(primes for _, primes in marks.primes)])
    laid = (layer >= 0) & ~primes[np.searchsorted(prime_lines, found.line, side="right") - 1]
    heads = np.array([0, *marks.heads])
    head = np.searchsorted(heads, found.line, side="right") - 1
    names = ("", *sorted({name for _, name, _ in marks.settings} - {""}))
    index = {name: number for number, name in enumerate(names)}
    codes = np.array([[c, index[name], -1 if m is None else m] for c, name, m in marks.settings])
    number = np.concatenate([[0], marks.own])[head]
    slopes = np.flatnonzero(laid & (found.start[:, 2] != found.end[:, 2]))
    if len(slopes):
        raise InputError(
            f"G-code line {found.line[slopes[0]]}: deposits while Z moves; only flat layers can be "
            "read"
        )
    origin = np.asarray(marks.facts.numbers("origin", 2) or (0.0, 0.0))
    layers = []
    for at, mark in enumerate(marks.layers):
        own = np.flatnonzero(laid & (layer == at))
        height = layer_height or mark.height
        filled = mark.outline if outline is None else outline
        if not len(own):
            layers.append(Layer(mark.z, height, (), filled))
            continue
        start, end = found.start[own, :2], found.end[own, :2]
        section = found.volume[own] / np.hypot(*(end - start).T)
        groups = [found.road[own], head[own]]
        told = codes[number[own]]
        roads = flat_roads(
            start - origin,
            end - origin,
            groups,
            road_width(section, height),
            None,
            np.where(told[:, 2] >= 0, told[:, 2], found.tool[own]),
            np.zeros(len(own), int),
            names,
            family=told[:, 1],
            closed=told[:, 0].astype(bool),
        )
        layers.append(Layer(mark.z, height, roads, filled))
    return tuple(layers)
