"""The layers of a G-code file that fdjax did not write: which roads are the part, how high each is.

The order of layers is the file's. A road's height is what the file says of it, else the slicer's
setting, else the difference to the layer before; where two of them differ, the one that gives the
road a width like the other roads'.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch

import numpy as np
import shapely
from numpy.typing import NDArray

from fdjax.errors import InputError
from fdjax.formats.gcode_scan import Floats, Ints, Mask
from fdjax.formats.gcode_track import COLUMNS, Track
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
class _Pieces:
    """The pieces of a track, and the stretch of comments in which each lies, shape (n,)."""

    track: Track
    stretch: NDArray[np.int32]
    stretches: Sequence[Stretch]

    @classmethod
    def of(cls, track: Track, comments: Comments) -> "_Pieces":
        lines = np.array([each.line for each in comments.stretches])
        index = np.searchsorted(lines, track.line, side="right").astype(np.int32) - 1
        return cls(track, index, comments.stretches)

    def told(self, name: str) -> NDArray:
        """What comments say of each piece: a number of `Stretch`, shape (n,)."""
        return np.array([getattr(each, name) for each in self.stretches])[self.stretch]

    def those(self, test: Callable[[Stretch], bool]) -> Mask:
        """The pieces whose stretch passes a test, shape (n,)."""
        return np.array([test(each) for each in self.stretches])[self.stretch]

    def roles(self) -> tuple[NDArray[np.int32], tuple[str, ...]]:
        """Index of each piece's role, and the roles; the first is none."""
        names = ("", *sorted({each.role for each in self.stretches} - {""}))
        index = {name: number for number, name in enumerate(names)}
        codes = np.array([index[each.role] for each in self.stretches], np.int32)
        return codes[self.stretch], names

    def of_those(self, chosen: Mask) -> "_Pieces":
        if chosen.all():
            return self
        own = {name: getattr(self.track, name)[chosen] for name in COLUMNS}
        return replace(self, track=replace(self.track, **own), stretch=self.stretch[chosen])


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
    reading: dict[str, str] = {}
    pieces = _Pieces.of(track, comments)
    aside = _aside(pieces, comments, outline)
    part = aside == 0
    _choose(pieces, aside, choice)
    reading |= _left_out(pieces, aside)
    if (aside > 0).all():
        said = reading.get("left out", "nothing is deposited")
        raise InputError(f"G-code: nothing is left of the part: {said}")
    # Layers and heights are the part's, whatever is asked for of it.
    layered = part | (aside == 0)
    asked = aside[layered] == 0
    pieces = pieces.of_those(layered)
    key, tops = _layer_keys(pieces, comments, layer_height)
    heights, thickness, said = _heights(pieces, key, tops, settings, layer_height)
    reading["heights"] = said
    order = np.argsort(key, kind="stable")
    order = order[asked[order]]
    ends = np.searchsorted(key[order], np.arange(len(tops) + 1))
    length = np.hypot(*(pieces.track.end - pieces.track.start)[:, :2].T)
    section = pieces.track.volume / length
    rectangular = settings.slicer.startswith("Cura")
    if rectangular:
        reading["section"] = "rectangles, as CuraEngine has them"
    width = section / heights if rectangular else road_width(section, heights)
    role, names = pieces.roles()
    layer = pieces.told("layer")
    chosen = choice.layers or (1, len(tops))
    if chosen[0] > len(tops):
        raise InputError(f"layers: {chosen[0]}:{chosen[1]}; the part has {len(tops)}")
    layers = []
    for number in range(chosen[0] - 1, min(chosen[1], len(tops))):
        own = order[ends[number] : ends[number + 1]]
        if not len(own):
            continue
        high = float(thickness[number])
        plain = not rectangular and np.allclose(heights[own], high, rtol=1e-9)
        roads = flat_roads(
            pieces.track.start[own, :2],
            pieces.track.end[own, :2],
            np.stack(
                [each[own] for each in (pieces.track.road, role, layer, pieces.track.tool)], 1
            ),
            width[own],
            None if plain else section[own],
            pieces.track.tool[own],
            role[own],
            names,
        )
        layers.append(Layer(float(tops[number]), high, roads, outline))
    if not layers:
        raise InputError(f"layers: {chosen[0]}:{chosen[1]}; they hold nothing that is asked for")
    return tuple(layers), reading


_REASONS = ("", *ASIDE, "raft", "outside the outline", "other objects", "other roles")


def _aside(pieces: _Pieces, comments: Comments, outline: Outline | None) -> NDArray[np.uint8]:
    """Index in `_REASONS` of why each piece is no part, 0 for those that are."""
    track = pieces.track
    aside = np.zeros(len(track.line), np.uint8)
    if outline is not None:
        aside[~_meets(track, outline)] = _REASONS.index("outside the outline")
    for role in ASIDE:
        aside[pieces.those(lambda each, role=role: each.role == role)] = _REASONS.index(role)
    aside[pieces.those(lambda each: each.raft)] = _REASONS.index("raft")
    if comments.layered:
        primes = pieces.those(lambda each: each.layer == 0)
    else:
        # A nozzle that goes down to its first layer has primed higher up.
        z = track.end[:, 2]
        lowest = z[z == track.start[:, 2]].min(initial=np.inf)
        primes = np.arange(len(z)) < np.argmax(z <= lowest + _NEAR)
    aside[primes] = _REASONS.index("priming")
    return aside


def _choose(pieces: _Pieces, aside: NDArray[np.uint8], choice: Choice) -> None:
    """Mark in `aside` what is asked for and what is not."""
    if choice.roles:
        wider = {"perimeter": ("perimeter", "outer perimeter", "overhang")}
        roles = {name for role in choice.roles for name in wider.get(role, (role,))}
        asked = pieces.those(lambda each: each.role in roles or "all" in roles)
        aside[asked] = 0
        aside[~asked & (aside == 0)] = _REASONS.index("other roles")
    if choice.things:
        names = {each.thing for each in pieces.stretches}
        found = {n for n in names if n and any(fnmatch(n, thing) for thing in choice.things)}
        if not found:
            known = ", ".join(sorted(names - {""})) or "none"
            raise InputError(f"object: {', '.join(choice.things)}; the file has {known}")
        others = pieces.those(lambda each: each.thing not in found)
        aside[others & (aside == 0)] = _REASONS.index("other objects")


def _meets(track: Track, outline: Outline) -> Mask:
    """Which pieces belong to a road that comes into the outline somewhere."""
    shapely.prepare(outline)
    first = np.flatnonzero(np.diff(track.road, prepend=-1))
    number = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(track.road))))
    begins = track.start[first]
    inside = shapely.intersects_xy(outline, begins[:, 0], begins[:, 1])
    # Of roads that begin outside each piece is looked at.
    rest = np.flatnonzero(~inside[number])
    lines = shapely.linestrings(np.stack([track.start[rest, :2], track.end[rest, :2]], 1))
    inside[number[rest[shapely.intersects(outline, lines)]]] = True
    return inside[number]


def _left_out(pieces: _Pieces, aside: NDArray[np.uint8]) -> dict[str, str]:
    volumes = np.bincount(aside, pieces.track.volume, len(_REASONS))
    counts = np.bincount(aside, minlength=len(_REASONS))
    said = [
        f"{name} {volume:.1f} mm^3"
        for name, volume, count in zip(_REASONS[1:], volumes[1:], counts[1:], strict=True)
        if count
    ]
    role, names = pieces.roles()
    kept = np.unique(role[aside == 0])
    unknown = [names[number] for number in kept if number and names[number] not in ROLES]
    found = {"left out": ", ".join(said)} if said else {}
    if unknown:
        found["unknown roles"] = f"{', '.join(unknown)}: counted as the part"
    return found


def _layer_keys(
    pieces: _Pieces, comments: Comments, layer_height: float | None
) -> tuple[Ints, Floats]:
    """Index of each piece's layer, in the file's order, and the Z of each layer's top, mm."""
    track = pieces.track
    start, end = track.start[:, 2] - track.base, track.end[:, 2] - track.base
    slopes = np.flatnonzero(np.abs(start - end) > _NEAR)
    if len(slopes):
        if layer_height is not None:
            level = np.ceil(np.maximum(start, end) / layer_height - 1e-6) * layer_height
        elif comments.layered:
            level = pieces.told("layer").astype(float)
        else:
            raise InputError(
                f"G-code line {track.line[slopes[0]]}: deposits while Z moves; the layer height "
                "tells the pitch of a vase"
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
    pieces: _Pieces, key: Ints, tops: Floats, settings: Settings, layer_height: float | None
) -> tuple[Floats, Floats, str]:
    """Height of each piece and of each layer, mm, and where they are from."""
    if layer_height is not None:
        each = np.full(len(tops), layer_height)
        return each[key], each, "as given"
    track = pieces.track
    section = track.volume / np.hypot(*(track.end - track.start)[:, :2].T)
    gaps = np.concatenate([[np.nan], np.diff(tops)])
    gaps[~(gaps > _NEAR)] = np.nan
    typical = float(np.nanmedian(gaps)) if np.isfinite(gaps).any() else np.nan
    said: Sequence[str] = ()
    told, earlier = pieces.told("height"), pieces.told("earlier")
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
    heights = _likelier(section, first, second, pieces.told("width"))
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
