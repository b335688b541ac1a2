"""The layers of a G-code file that fdjax did not write: which roads are the part, how high each is.

The order of layers is the file's. A road's height is what the file says of it, else the slicer's
setting, else the difference to the layer before; where two of them differ, the one that gives the
road a width like the other roads'.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats.gcode_scan import Floats, Ints, Mask
from fdjax.formats.gcode_track import Track
from fdjax.formats.slicers import ASIDE, ROLES, Comments, Settings, Stretch
from fdjax.plan.toolpath import Layer, Outline, Roads
from fdjax.road.bead import road_width

_SAME = 0.02
"""Share by which two heights may differ and still be one."""
_THINNEST = 0.5
"""Least width of a road as a share of its layer's height, where nothing but Z tells that."""
_NEAR = 1e-4
"""mm; deposits nearer in Z than this lie in one layer."""


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


@dataclass(frozen=True, eq=False)
class _Runs:
    """Runs of pieces of a track: of one road, and of one stretch between comments.

    - `first`: index of each run's first piece, and the number of pieces, shape (runs + 1,).
    - `stretch`: index in `stretches` of each run's, shape (runs,).
    """

    track: Track
    first: Ints
    stretch: Ints
    stretches: Sequence[Stretch]

    @classmethod
    def of(cls, track: Track, comments: Comments) -> "_Runs":
        lines = np.array([each.line for each in comments.stretches])
        stretch = np.searchsorted(lines, track.line, side="right") - 1
        begins = np.diff(track.road, prepend=-1) != 0
        begins[1:] |= stretch[1:] != stretch[:-1]
        # Where Z moves each piece may be of another layer.
        begins |= (np.abs(track.start[:, 2] - track.end[:, 2]) > _NEAR).any()
        first = np.flatnonzero(begins)
        return cls(track, np.append(first, len(begins)), stretch[first], comments.stretches)

    def told(self, name: str) -> NDArray:
        """What comments say of each run: a number of `Stretch`, shape (runs,)."""
        return np.array([getattr(each, name) for each in self.stretches])[self.stretch]

    def those(self, test: Callable[[Stretch], bool]) -> Mask:
        """The runs whose stretch passes a test, shape (runs,)."""
        return np.array([test(each) for each in self.stretches])[self.stretch]

    def roles(self) -> tuple[Ints, tuple[str, ...]]:
        """Index of each run's role, and the roles; the first is none."""
        names = ("", *sorted({each.role for each in self.stretches} - {""}))
        index = {name: number for number, name in enumerate(names)}
        return np.array([index[each.role] for each in self.stretches])[self.stretch], names

    @property
    def volume(self) -> Floats:
        """Of each run, mm^3."""
        return np.add.reduceat(self.track.volume, self.first[:-1])

    @property
    def section(self) -> Floats:
        """Mean section of each run, mm^2."""
        return self.volume / np.add.reduceat(self.track.length(slice(None)), self.first[:-1])

    @property
    def z(self) -> tuple[Floats, Floats]:
        """Where each run begins and ends, mm above what the file calls 0."""
        track = self.track
        start, end = track.start[self.first[:-1], 2], track.end[self.first[1:] - 1, 2]
        return start - track.base, end - track.base

    def pieces(self, runs: Ints) -> slice | Ints:
        """Indices of the pieces of some runs, in order."""
        if len(runs) == runs[-1] - runs[0] + 1:
            return slice(int(self.first[runs[0]]), int(self.first[runs[-1] + 1]))
        first = self.first[runs]
        count = self.first[runs + 1] - first
        return np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)

    def of_those(self, runs: Ints, values: NDArray) -> NDArray:
        """Values of runs, repeated for each of their pieces."""
        return np.repeat(values[runs], self.first[runs + 1] - self.first[runs])


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
    runs = _Runs.of(track, comments)
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
    key[layered], tops = _layer_keys(runs, layered, comments, layer_height)
    heights = np.full(len(part), np.nan)
    heights[layered], thickness, reading["heights"] = _heights(
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
    runs: _Runs,
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
        np.stack([track.road[pieces], *marks, tool], 1),
        section / height if rectangular else road_width(section, height),
        None if plain else section,
        tool,
        role,
        names,
    )


_REASONS = ("", *ASIDE, "raft", "outside the outline", "other objects", "other roles")


def _aside(runs: _Runs, comments: Comments, outline: Outline | None) -> NDArray[np.uint8]:
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
        lowest = end[np.abs(end - start) <= _NEAR].min(initial=np.inf)
        primes = np.arange(len(end)) < np.argmax(end <= lowest + _NEAR)
    aside[primes] = priming
    return aside


def _choose(runs: _Runs, aside: NDArray[np.uint8], choice: Choice) -> None:
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


def _meets(runs: _Runs, outline: Outline) -> Mask:
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


def _left_out(runs: _Runs, aside: NDArray[np.uint8]) -> dict[str, str]:
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


def _layer_keys(
    runs: _Runs, layered: Ints, comments: Comments, layer_height: float | None
) -> tuple[Ints, Floats]:
    """Index of each of these runs' layer, in the file's order; each layer's top Z, mm."""
    start, end = (z[layered] for z in runs.z)
    slopes = np.flatnonzero(np.abs(start - end) > _NEAR)
    if len(slopes):
        if layer_height is not None:
            level = np.ceil(np.maximum(start, end) / layer_height - 1e-6) * layer_height
        elif comments.layered:
            level = runs.told("layer")[layered].astype(float)
        else:
            line = runs.track.line[runs.first[layered[slopes[0]]]]
            raise InputError(
                f"G-code line {line}: deposits while Z moves; the layer height tells the pitch of "
                "a vase"
            )
    else:
        level = np.round(end / _NEAR)
    levels, first, key = np.unique(level, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(levels), np.intp)
    rank[order] = np.arange(len(levels))
    key = rank[key]
    tops = np.full(len(levels), -np.inf)
    np.maximum.at(tops, key, end)
    return key, np.round(tops, 9).astype(float)


def _heights(
    runs: _Runs,
    layered: Ints,
    key: Ints,
    tops: Floats,
    settings: Settings,
    layer_height: float | None,
) -> tuple[Floats, Floats, str]:
    """Height of each of these runs and of each layer, mm, and where they are from."""
    if layer_height is not None:
        each = np.full(len(tops), layer_height)
        return each[key], each, "as given"
    section = runs.section[layered]
    gaps = np.concatenate([[np.nan], np.diff(tops)])
    gaps[~(gaps > _NEAR)] = np.nan
    typical = float(np.nanmedian(gaps)) if np.isfinite(gaps).any() else np.nan
    said: Sequence[str] = ()
    told, earlier, width = (runs.told(each)[layered] for each in ("height", "earlier", "width"))
    if (told > 0).all():
        first, second = told, np.where(earlier > 0, earlier, np.nan)
        said = ("the file's word on each road",)
    elif settings.layer_height > 0:
        set_ = np.full(len(tops), settings.layer_height)
        set_[0] = settings.first_height or (settings.layer_height if len(tops) > 1 else tops[0])
        if not settings.first_height and 0 < tops[0] <= 2 * settings.layer_height:
            gaps[0] = tops[0]
        first, second = set_[key], gaps[key]
        said = ("the file's setting of the layer height",)
    else:
        first, second, said = _from_gaps(tops, gaps, typical, section)
        first, second = first[key], second[key]
    first = np.where(told > 0, told, first)
    heights = _likelier(section, first, second, width)
    thickness = gaps.copy()
    for number in np.flatnonzero(np.isnan(thickness) | (np.arange(len(tops)) == 0)):
        thickness[number] = np.median(heights[key == number])
    return heights, thickness, ", ".join(said)


def _from_gaps(
    tops: Floats, gaps: Floats, typical: float, section: Floats
) -> tuple[Floats, Floats, Sequence[str]]:
    """Heights of layers from differences of Z alone, and others that the first may have."""
    first, second = gaps.copy(), np.full(len(tops), np.nan)
    said = "differences of Z"
    if np.isnan(typical):
        if len(tops) > 1 or tops[0] <= 0:
            if len(tops) == 1:
                raise InputError(
                    f"deposits at Z = {tops[0]:g} mm tell no layer height; give the layer height"
                )
            guess = float(np.sqrt(np.median(section) / 2))
            said = f"not told: roads taken to be twice as wide as high ({guess:.3g} mm)"
            return np.full(len(tops), guess), second, (said,)
        if np.median(section) < np.pi / 4 * (_THINNEST * tops[0]) ** 2:
            raise InputError(
                f"deposits at Z = {tops[0]:g} mm alone are too thin for a layer of that height; "
                "give the layer height"
            )
        return tops.copy(), second, ("Z above the bed",)
    first[np.isnan(first)] = typical
    # A first layer up to twice as high as the others is one; above that it lies on a board.
    if typical <= tops[0] <= 2 * typical:
        first[0] = tops[0]
    elif 0 < tops[0] < typical:
        second[0] = tops[0]
    else:
        said += f", the first layer as the others (Z begins at {tops[0]:g} mm)"
    return first, second, (said,)


def _likelier(section: Floats, first: Floats, second: Floats, width: Floats) -> Floats:
    """Of two heights the one that makes a road as wide as is told, or as the others are."""
    disputed = np.isfinite(second) & (np.abs(second - first) > _SAME * first)
    if not disputed.any():
        return first
    wide, other = road_width(section, first), road_width(section, np.where(disputed, second, 1.0))
    sure = wide[~disputed]
    like = np.where(width > 0, width, np.median(sure) if len(sure) else wide)
    return np.where(disputed & (np.abs(other - like) < np.abs(wide - like)), second, first)


def flat_roads(
    start: Floats,
    end: Floats,
    marks: NDArray[np.integer],
    width: Floats,
    section: Floats | None,
    material: NDArray[np.integer],
    role: NDArray[np.integer],
    names: tuple[str, ...],
    *,
    family: NDArray[np.integer] | None = None,
    closed: Mask | None = None,
) -> Roads:
    """Pieces as roads; one ends where any of its marks, shape (n, k), changes.

    `family` and `closed` are told by the first piece of a road; without them there is no family,
    and a road is closed that ends where it began.
    """
    begins = np.ones(len(start), bool)
    begins[1:] = (marks[1:] != marks[:-1]).any(1) | (start[1:] != end[:-1]).any(1)
    at = np.flatnonzero(begins)
    count = len(at)
    points = np.insert(end, at, start[at], axis=0)
    first = np.append(at + np.arange(count), len(points))
    ends = np.diff(first)
    if closed is None:
        rings = (ends > 3) & (points[first[:-1]] == points[first[1:] - 1]).all(1)
    else:
        rings = closed[at]
    families = np.zeros(count, int) if family is None else family[at]
    return Roads(points, first, width, material[at], rings, families, role[at], names, section)
