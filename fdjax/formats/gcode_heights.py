"""How high the layers of a G-code file are that fdjax did not write, and the roads in them.

The order of layers is the file's. A road's height is what the file says of it, else the slicer's
setting, else the difference to the layer before; where two of them differ, the one that gives the
road a width like the other roads'.
"""

from collections.abc import Sequence

import numpy as np

from fdjax.errors import InputError
from fdjax.formats.gcode_runs import NEAR, Runs
from fdjax.formats.gcode_scan import Floats, Ints
from fdjax.formats.slicers import Comments, Settings
from fdjax.road.bead import road_width

_SAME = 0.02
"""Share by which two heights may differ and still be one."""
_THINNEST = 0.5
"""Least width of a road as a share of its layer's height, where nothing but Z tells that."""


def layer_keys(
    runs: Runs, layered: Ints, comments: Comments, layer_height: float | None
) -> tuple[Ints, Floats]:
    """Index of each of these runs' layer, in the file's order; each layer's top Z, mm."""
    start, end = (z[layered] for z in runs.z)
    slopes = np.flatnonzero(np.abs(start - end) > NEAR)
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
        level = np.round(end / NEAR)
    levels, first, key = np.unique(level, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(levels), np.intp)
    rank[order] = np.arange(len(levels))
    key = rank[key]
    tops = np.full(len(levels), -np.inf)
    np.maximum.at(tops, key, end)
    return key, np.round(tops, 9).astype(float)


def heights_of(
    runs: Runs,
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
    gaps[~(gaps > NEAR)] = np.nan
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
