"""Checks of a build against a machine's limits, before anything is written."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import STRtree, contains_xy, distance, intersects, prepare

from fdjax.limits import Limits
from fdjax.plan.meetings import Meetings
from fdjax.plan.segments import Crossings, Segments
from fdjax.plan.spacing import approaches, spans
from fdjax.plan.toolpath import Build, Layer, Outline

Floats = NDArray[np.float64]

TOLERANCE = 0.02
"""How far a bead may reach over the outline, mm: below what a machine resolves."""

SHARP = 45.0
"""A corner with a smaller interior angle, degrees, over-deposits at its inside."""

_SLACK = 1e-3
_LEAST_STEP = 0.01


@dataclass(frozen=True)
class Finding:
    """One kind of fault in one layer, at its worst place.

    - `severity`: "error" (the build must not be written) or "warning".
    - `kind`: "crossing", "nodes", "width", "layer height", "spacing", "short road", "span",
      "outline", "bed" or "corner".
    - `message`: what is wrong, how badly, and what the limit is.
    - `layer`: index of the layer; `xy`: the worst place, mm, part coordinates, or None.
    - `count`: how many places; `value`: the worst, in the unit of the message.
    """

    severity: str
    kind: str
    message: str
    layer: int
    xy: tuple[float, float] | None
    count: int = 1
    value: float = 0.0

    def __str__(self) -> str:
        place = "" if self.xy is None else f" at ({self.xy[0]:.3f}, {self.xy[1]:.3f})"
        return f"{self.severity}: {self.kind}, layer {self.layer}{place}: {self.message}"


def check(
    build: Build,
    limits: Limits | None = None,
    *,
    both_families: bool = False,
) -> tuple[Finding, ...]:
    """Everything about a build that a machine with these limits cannot lay, or not well.

    One finding a kind and layer, layer by layer:

    - crossing (error): roads that cross or touch, a road and itself too. Where three edges of one
      graph or more meet at their ends, and with `both_families` where "xi" cross "eta" roads, are
      nodes (warning): their number and excess volume, of straight beads with flat sides as high as
      the layer what they hold beside their union (see `Meetings`; `w1 w2 / sin(angle)` for two
      that cross, where the sine is kept above 0.1).
    - width, layer height (error): outside the machine's range.
    - spacing: centre lines of one family closer than the least spacing, or than their mean width
      where the machine names none: a warning, and an error below half of it, where one bead
      lies on the other. A run's own turn does not count, nor what lies by such a node of both
      roads (see `approaches`).
    - short road (error): shorter than the least road, whose flow cannot be started and stopped.
    - span (warning): a stretch of road over no bead of the layer below, ends included, longer
      than the longest span. The first layer lies on the bed.
    - outline (error): a bead more than `TOLERANCE` outside its layer's outline or in a hole.
    - bed (error): a bead beyond the machine's room, with the build's origin.
    - corner (warning): an interior angle below `SHARP` degrees.
    """
    limits = limits or Limits()
    findings: list[Finding] = []
    below: tuple[Segments, STRtree] | None = None
    for number, layer in enumerate(build.layers):
        segments = Segments.of(layer.roads)
        reach = max(segments.width.max(initial=0.0), limits.least_spacing or 0.0)
        tree = STRtree(segments.boxes(reach / 2))
        found = [
            *_sizes(layer, segments, limits),
            *_pairs(layer, segments, tree, limits, both_families),
            *_spans(segments, below, limits),
            *_outline(layer, segments),
            *_bed(build, layer, segments, limits),
            *_corners(segments),
        ]
        findings += [Finding(*item[:3], number, *item[3:]) for item in found]
        below = (segments, tree)
    return tuple(findings)


_Found = Iterator[tuple[str, str, str, tuple[float, float] | None, int, float]]
"""Severity, kind, message, place, count and worst value."""


def _place(xy: Floats) -> tuple[float, float]:
    return float(xy[0]), float(xy[1])


def _sizes(layer: Layer, segments: Segments, limits: Limits) -> _Found:
    low, high = limits.layer_height
    if not low - 1e-9 <= layer.height <= high + 1e-9:
        text = f"{layer.height:g} mm; the machine lays {low:g} to {high:g} mm"
        yield "error", "layer height", text, None, 1, layer.height
    low, high = limits.road_width
    beyond = np.maximum(low - segments.width, segments.width - high)
    count = int((beyond > 1e-9).sum())
    if count:
        worst = int(np.argmax(beyond))
        width = float(segments.width[worst])
        text = (
            f"{count} segments, the worst {width:g} mm wide; the machine lays {low:g} to {high:g}"
        )
        yield "error", "width", text, _place(segments.start[worst]), count, width
    short = segments.road_length < limits.least_road - 1e-9
    if short.any():
        worst = int(np.argmin(segments.road_length))
        length = float(segments.road_length[worst])
        text = (
            f"{short.sum()} roads, the shortest {length:.3f} mm; "
            f"the machine cannot start and stop the flow within {limits.least_road:g} mm"
        )
        place = _place(segments.road_ends[worst, 0])
        yield "error", "short road", text, place, int(short.sum()), length


def _pairs(
    layer: Layer,
    segments: Segments,
    tree: STRtree,
    limits: Limits,
    both_families: bool,
) -> _Found:
    i, j = segments.near_pairs(tree)
    crossings = segments.crossings(i, j)
    graph = segments.of_graph[segments.road]
    node = crossings.vertex & graph[crossings.i] & graph[crossings.j]
    families = np.zeros_like(node)
    if both_families:
        names = np.array([road.family for road in layer.roads])
        pair = np.stack([names[segments.road[k]] for k in (crossings.i, crossings.j)], 1)
        families = (np.sort(pair, axis=1) == ["eta", "xi"]).all(1)
    node |= families
    count = int((~node).sum())
    if count:
        text = f"roads cross in {count} places"
        yield "error", "crossing", text, _place(crossings.xy[~node][0]), count, float(count)
    yield from _nodes(segments, crossings, families, layer.height)
    close = approaches(segments, i, j, limits.least_spacing, _SLACK)
    if len(close.i):
        worst = int(np.argmin(close.distance / close.limit))
        gap, limit = float(close.distance[worst]), float(close.limit[worst])
        count = len(np.union1d(close.i, close.j))
        text = (
            f"{count} segments, the closest {gap:.3f} mm from the next; the limit is {limit:g} mm"
        )
        severity = "error" if gap < limit / 2 else "warning"
        yield severity, "spacing", text, _place(close.xy[worst]), count, gap


def _nodes(
    segments: Segments, crossings: Crossings, families: NDArray[np.bool_], height: float
) -> _Found:
    """Nodes of graphs, and crossings of two families."""
    met = Meetings.of(segments)
    i, j = crossings.i[families], crossings.j[families]
    shared = segments.width[i] * segments.width[j] / np.maximum(crossings.sine[families], 0.1)
    excess = height * np.concatenate([met.area, shared])
    count, volume = len(excess), float(excess.sum())
    if count:
        place = np.concatenate([met.xy, crossings.xy[families]])[np.argmax(excess)]
        text = f"roads meet in {count} nodes, {volume:.3f} mm^3 more than the layer holds"
        yield "warning", "nodes", text, _place(place), count, volume


def _spans(segments: Segments, below: tuple[Segments, STRtree] | None, limits: Limits) -> _Found:
    if below is None or not len(segments.length) or not np.isfinite(limits.longest_span):
        return
    found = spans(segments, *below)
    long = found.length > limits.longest_span + _SLACK
    if long.any():
        worst = int(np.argmax(found.length))
        length, count = float(found.length[worst]), int(long.sum())
        text = (
            f"{count} stretches over nothing, the longest {length:.3f} mm; "
            f"the limit is {limits.longest_span:g} mm"
        )
        yield "warning", "span", text, _place(found.xy[worst]), count, length


def _outline(layer: Layer, segments: Segments) -> _Found:
    if layer.outline is None or not len(segments.length):
        return
    suspect = _near_wall(layer.outline, segments)
    if not len(suspect):
        return
    start, end = segments.start[suspect], segments.end[suspect]
    inside = contains_xy(layer.outline, *start.T) & contains_xy(layer.outline, *end.T)
    clear = distance(layer.outline.boundary, segments.lines[suspect])
    over = segments.width[suspect] / 2 - np.where(inside, clear, -clear)
    count = int((over > TOLERANCE).sum())
    if count:
        worst = int(np.argmax(over))
        text = f"{count} segments reach over it, by up to {over[worst]:.3f} mm"
        place = _place((start[worst] + end[worst]) / 2)
        yield "error", "outline", text, place, count, float(over[worst])


def _near_wall(outline: Outline, segments: Segments) -> NDArray[np.intp]:
    """Segments that leave the outline shrunk by half the widest road, give or take."""
    safe = outline.buffer(TOLERANCE / 2 - segments.width.max() / 2, join_style="mitre")
    wall = safe.boundary
    prepare(safe)
    prepare(wall)
    return np.flatnonzero(~contains_xy(safe, *segments.start.T) | intersects(wall, segments.lines))


def _bed(build: Build, layer: Layer, segments: Segments, limits: Limits) -> _Found:
    room = np.array(limits.bed[:2])
    xy = np.concatenate([segments.start, segments.end])
    margin = np.concatenate([segments.width, segments.width])[:, None] / 2
    on_bed = xy + np.asarray(build.origin) - np.asarray(limits.bed_origin)
    beyond = np.maximum(margin - on_bed, on_bed + margin - room).max(axis=1, initial=-np.inf)
    count = int((beyond > _SLACK).sum())
    size = " x ".join(f"{side:g}" for side in limits.bed)
    if count:
        worst = int(np.argmax(beyond))
        text = f"reaches {beyond[worst]:.3f} mm beyond the bed of {size} mm"
        yield "error", "bed", text, _place(xy[worst]), count, float(beyond[worst])
    if layer.z > limits.bed[2] + _SLACK:
        text = f"its top is at z = {layer.z:g} mm; the machine's room is {size} mm"
        yield "error", "bed", text, None, 1, layer.z


def _corners(segments: Segments) -> _Found:
    # Steps this short are rounding, not corners.
    index = np.flatnonzero(segments.length > _LEAST_STEP)
    if not len(index):
        return
    road = segments.road[index]
    last = np.append(road[1:] != road[:-1], True)
    first = np.concatenate([[0], np.flatnonzero(last)[:-1] + 1])
    follower = np.arange(1, len(index) + 1)
    follower[last] = first
    before = np.flatnonzero(~last | segments.closed[road])
    a, b = index[before], index[follower[before]]
    cosine = -(segments.unit[a] * segments.unit[b]).sum(1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    count = int((angle < SHARP - 1e-6).sum())
    if count:
        worst = int(np.argmin(angle))
        text = f"{count} corners sharper than {SHARP:g} degrees, the sharpest {angle[worst]:.1f}"
        yield "warning", "corner", text, _place(segments.end[a[worst]]), count, float(angle[worst])
