"""The layers of a G-code file that fdjax did not write: which roads are the part."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats.gcode_heights import heights_of, layer_keys
from fdjax.formats.gcode_runs import NEAR, Runs
from fdjax.formats.gcode_scan import Floats, Ints, Mask
from fdjax.formats.gcode_track import Track
from fdjax.formats.slicers import ASIDE, ROLES, Comments, Settings
from fdjax.plan.toolpath import Layer, Outline, Roads
from fdjax.road.bead import road_width


@dataclass(frozen=True)
class Choice:
    """What of a file is asked for; all of the part unless given.

    - `roles`: of `slicers.ROLES`, "perimeter" being outer ones and overhangs too, or "all".
    - `things`: names of objects, with * and ? as in file names.
    - `layers`: first and last layer of the part, from 1.

    Raises `InputError` for a role that there is not and layers that are none.
    """

    roles: tuple[str, ...] = ()
    things: tuple[str, ...] = ()
    layers: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        for role in self.roles:
            if role not in (*ROLES, "all"):
                raise InputError(f"role: {role!r}; one of {', '.join((*ROLES, 'all'))} is needed")
        if self.layers is not None and not 1 <= self.layers[0] <= self.layers[1]:
            raise InputError(f"layers: {self.layers[0]}:{self.layers[1]}; as 1:20 is needed")


def layers_of(
    track: Track,
    comments: Comments,
    settings: Settings,
    *,
    layer_height: float | None,
    outline: Outline | None,
    choice: Choice,
) -> tuple[tuple[Layer, ...], dict[str, str]]:
    """The layers that are asked for, and how they were read.

    `layer_height` (mm) and `outline` replace what the file says. Raises `InputError` where nothing
    is left, where layers are sloping and no pitch is told, or where a height cannot be told.
    """
    runs = Runs.of(track, comments)
    aside = _aside(runs, comments, outline)
    part = aside == 0
    _choose(runs, aside, choice)
    asked = aside == 0
    reading = _left_out(runs, aside)
    if not asked.any():
        said = reading.get("left out", "nothing is deposited")
        raise InputError(f"G-code: nothing is left of the part: {said}")
    # Layers and heights are the part's, whatever is asked for of it.
    layered = np.flatnonzero(part | asked)
    key = np.full(len(part), -1)
    key[layered], tops = layer_keys(runs, layered, comments, layer_height)
    heights = np.full(len(part), np.nan)
    heights[layered], thickness, reading["heights"] = heights_of(
        runs, layered, key[layered], tops, settings, layer_height
    )
    rectangular = settings.slicer.startswith("Cura")
    if rectangular:
        reading["section"] = "rectangles, as CuraEngine has them"
    first, last = choice.layers or (1, len(tops))
    if first > len(tops):
        raise InputError(f"layers: {first}:{last}; the part has {len(tops)}")
    order = np.flatnonzero(asked)
    order = order[np.argsort(key[order], kind="stable")]
    ends = np.searchsorted(key[order], np.arange(len(tops) + 1))
    (role, names), begun = runs.roles(), runs.told("layer")
    layers = []
    for number in range(first - 1, min(last, len(tops))):
        own = order[ends[number] : ends[number + 1]]
        if len(own):
            high = float(thickness[number])
            height, *marks = (runs.of_those(own, each) for each in (heights, role, begun))
            roads = _roads(runs, own, height, high, marks, names, rectangular)
            layers.append(Layer(float(tops[number]), high, roads, outline))
    if not layers:
        raise InputError(f"layers: {first}:{last}; they hold nothing that is asked for")
    return tuple(layers), reading


def _roads(
    runs: Runs,
    own: Ints,
    height: Floats,
    high: float,
    marks: Sequence[NDArray],
    names: tuple[str, ...],
    rectangular: bool,
) -> Roads:
    """Some runs as the roads of a layer this high; `height` and `marks` are of their pieces."""
    track, pieces = runs.track, runs.pieces(own)
    section = track.volume[pieces] / track.length(pieces)
    role, tool = marks[0], track.tool[pieces]
    plain = not rectangular and np.allclose(height, high, rtol=1e-9)
    return flat_roads(
        track.start[pieces, :2],
        track.end[pieces, :2],
        [track.road[pieces], *marks, tool],
        section / height if rectangular else road_width(section, height),
        None if plain else section,
        tool,
        role,
        names,
    )


_REASONS = ("", *ASIDE, "raft", "outside the outline", "other objects", "other roles")


def _aside(runs: Runs, comments: Comments, outline: Outline | None) -> NDArray[np.uint8]:
    """Index in `_REASONS` of why each run is no part, 0 for those that are."""
    reasons = {role: _REASONS.index(role) for role in ASIDE}
    raft, outside, priming = map(_REASONS.index, ("raft", "outside the outline", "priming"))
    told = (raft if each.raft else reasons.get(each.role, 0) for each in runs.stretches)
    aside = np.fromiter(told, np.uint8)[runs.stretch]
    if outline is not None:
        aside[(aside == 0) & ~_meets(runs, outline)] = outside
    if comments.layered:
        primes = runs.those(lambda each: each.layer == 0)
    else:
        # A nozzle that goes down to its first layer has primed higher up.
        start, end = runs.z
        lowest = end[np.abs(end - start) <= NEAR].min(initial=np.inf)
        primes = np.arange(len(end)) < np.argmax(end <= lowest + NEAR)
    aside[primes] = priming
    return aside


def _choose(runs: Runs, aside: NDArray[np.uint8], choice: Choice) -> None:
    """Mark in `aside` what is asked for and what is not."""
    if choice.roles:
        wider = {"perimeter": ("perimeter", "outer perimeter", "overhang")}
        roles = {name for role in choice.roles for name in wider.get(role, (role,))}
        asked = runs.those(lambda each: each.role in roles or "all" in roles)
        aside[asked] = 0
        aside[~asked & (aside == 0)] = _REASONS.index("other roles")
    if choice.things:
        names = {each.thing for each in runs.stretches}
        found = {n for n in names if n and any(fnmatch(n, thing) for thing in choice.things)}
        if not found:
            known = ", ".join(sorted(names - {""})) or "none"
            raise InputError(f"object: {', '.join(choice.things)}; the file has {known}")
        others = runs.those(lambda each: each.thing not in found)
        aside[others & (aside == 0)] = _REASONS.index("other objects")


def _meets(runs: Runs, outline: Outline) -> Mask:
    """Which runs belong to a road that comes into the outline somewhere."""
    track = runs.track
    shapely.prepare(outline)
    road = track.road[runs.first[:-1]]
    begins = np.flatnonzero(np.diff(road, prepend=-1))
    number = np.repeat(np.arange(len(begins)), np.diff(np.append(begins, len(road))))
    place = track.start[runs.first[begins]]
    inside = shapely.intersects_xy(outline, place[:, 0], place[:, 1])
    # Of roads that begin outside each piece is looked at.
    far = np.flatnonzero(~inside[number])
    if len(far):
        pieces = runs.pieces(far)
        ends = np.stack([track.start[pieces, :2], track.end[pieces, :2]], 1)
        hits = shapely.intersects(outline, shapely.linestrings(ends))
        inside[runs.of_those(far, number)[hits]] = True
    return inside[number]


def _left_out(runs: Runs, aside: NDArray[np.uint8]) -> dict[str, str]:
    volumes = np.bincount(aside, runs.volume, len(_REASONS))
    counts = np.bincount(aside, minlength=len(_REASONS))
    said = [
        f"{name} {volume:.1f} mm^3"
        for name, volume, count in zip(_REASONS[1:], volumes[1:], counts[1:], strict=True)
        if count
    ]
    role, names = runs.roles()
    kept = np.unique(role[aside == 0])
    unknown = [names[number] for number in kept if number and names[number] not in ROLES]
    found = {"left out": ", ".join(said)} if said else {}
    if unknown:
        found["unknown roles"] = f"{', '.join(unknown)}: counted as the part"
    return found


def flat_roads(
    start: Floats,
    end: Floats,
    marks: Sequence[NDArray[np.integer]],
    width: Floats,
    section: Floats | None,
    material: NDArray[np.integer],
    role: NDArray[np.integer],
    names: tuple[str, ...],
    *,
    family: NDArray[np.integer] | None = None,
    closed: Mask | None = None,
) -> Roads:
    """Pieces as roads; one ends where any of its marks, each of shape (n,), changes.

    `family` and `closed` are told by the first piece of a road; without them there is no family,
    and a road is closed that ends where it began.
    """
    begins = np.ones(len(start), bool)
    begins[1:] = (start[1:, 0] != end[:-1, 0]) | (start[1:, 1] != end[:-1, 1])
    for mark in marks:
        begins[1:] |= mark[1:] != mark[:-1]
    at = np.flatnonzero(begins)
    count = len(at)
    first = np.append(at + np.arange(count), len(start) + count)
    points = np.empty((len(start) + count, 2))
    points[
        np.arange(1, len(start) + 1) + np.repeat(np.arange(count), np.diff(at, append=len(start)))
    ] = end
    points[first[:-1]] = start[at]
    ends = np.diff(first)
    if closed is None:
        rings = (ends > 3) & (points[first[:-1]] == points[first[1:] - 1]).all(1)
    else:
        rings = closed[at]
    families = np.zeros(count, int) if family is None else family[at]
    return Roads(points, first, width, material[at], rings, families, role[at], names, section)
