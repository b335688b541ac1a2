"""The fine lines of embedded grids: where they run between lines of the base."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdjax.pattern.embedded import Embedded
from fdjax.pattern.embedded_joins import CLEAR, Bundles, Run, bundled
from fdjax.pattern.embedded_net import Axis, Net, Squeeze, Trace
from fdjax.road.bead import section_area
from fdjax.road.porosity import Margins
from fdjax.road.stacking import FAMILIES, Scan
from fdjax.road.stroke import Lines

Floats = NDArray[np.float64]


def with_fine(
    base: Lines,
    embedded: Embedded,
    scan: Scan,
    combs: tuple[int, int],
    *,
    edge: Margins,
    trace: Trace,
    joined: bool,
    closed: bool = False,
) -> Lines:
    """The lines of a layer with the fine ones between them.

    Divided is the grid that the layer's lines make with those of the other family in the same
    phase, which lie on the layer above or below or on the same: so a fine line begins and ends on
    lines of the other family, base or fine ones.

    - `combs`: lines of both families in all phases; `edge`: what they keep from the walls.
    - `trace`: gives points and widths of lines (n, points) in xi, eta.
    - `joined`: whether lines that run through a zone take fine ones on their way, along where
      lines of the other family lie on other layers.
    - `closed`: whether the lines of constant xi run around a ring.
    """
    axes = [
        Axis.of(Scan(family, scan.phase, scan.phases), comb, closed=closed and family == "eta")
        for family, comb in zip(FAMILIES, combs, strict=True)
    ]
    squeeze = Squeeze(edge)

    def middles(parts: int) -> Floats:
        u, v = ((e[1:] + e[:-1]) / 2 for e in (axis.edges(parts) for axis in axes))
        return _points(trace, *squeeze(*np.meshgrid(u, v, indexing="ij")), len(edge.left))

    divided = embedded.divided(middles, (axes[0].cells, axes[1].cells))
    parts = embedded.parts
    if closed:
        # A turn begins where fewest cells are divided.
        ends = (divided[:, ::parts] > 1) | (np.roll(divided, 1, 1)[:, ::parts] > 1)
        begin = int(ends.sum(0).argmin())
        axes[1] = axes[1]._replace(begin=begin)
        divided = np.roll(divided, -begin * parts, 1)
    if scan.family == "eta":
        divided, axes = divided.T, axes[::-1]
    own, other = axes
    along = other.edges(parts)
    turn = len(along) - 1 if other.closed else 0
    if turn:
        along = np.concatenate([along, along[1:] + 1])
    net = Net(scan.family, parts, own.edges(parts), along, squeeze, trace, turn)
    fine = [
        run
        for run in _runs(divided, parts, turn)
        if (own.closed or 0 < net.at[run.line] < 1) and net.along[run.stop] > net.along[run.start]
    ]
    if not fine:
        return base
    # Where the base's lines lie on the lattice.
    number = np.roll(np.arange(len(base.xy)), -own.begin)
    lines = (np.arange(len(base.xy)) + own.before) * parts
    whole = [Run(int(lines[k]), 0, turn or len(along) - 1) for k in np.argsort(number)]
    clearance = CLEAR * max(float(width.max()) for width in base.width)
    bundles = bundled(net, whole, fine, clearance) if joined else Bundles(net)
    changed = [run for run in whole if run in bundles.through]
    alone = [run for run in fine if run not in bundles.taken]
    made = changed + alone
    xy, width = net.traced([bundles.course(run) for run in made])
    for course, run in zip(xy, made, strict=True):
        if turn and run.stop - run.start == turn:
            course[-1] = course[0]
    kept = [k for k, run in enumerate(whole) if run not in bundles.through]
    # The plan joins levels 1, 2, 4 ... apart.
    apart = 1 << (parts - 1).bit_length()
    runs = [*(whole[k] for k in kept), *made]
    # Of the lines that cells begin at; before the first is a wall.
    level = np.concatenate([np.full(own.before, -1), np.asarray(base.level)[number]])
    return replace(
        base,
        level=np.array([level[run.line // parts] * apart + run.line % parts for run in runs]),
        xy=[*(base.xy[k] for k in kept), *xy],
        width=[*(base.width[k] for k in kept), *width],
    )


def border_joins(embedded: Embedded, width: Any, height: float, shares: Any) -> tuple[Any, Any]:
    """Where fine lines are joined in the mean: places xy, (n, 2), mm, and volumes, (n,), mm^3.

    - `width`: of the widest road; `height`: of a layer, mm; `shares`: of the layers, of a family.
    """
    places, length = embedded.ways(CLEAR * width)
    return places, shares * section_area(width, height) * length


def _runs(divided: NDArray[np.intp], parts: int, turn: int) -> list[Run]:
    """The fine lines between cells, along the second axis, from line to line of the first.

    `turn`: cells along a closed axis, 0 for another; what runs across its beginning is one line.
    """
    found = []
    for line in range(1, len(divided)):
        if line % parts == 0:
            continue
        there = np.zeros(divided.shape[1] + 2, int)
        for beside in (divided[line - 1], divided[line]):
            there[1:-1] |= line % (parts // beside) == 0
        change = np.diff(there)
        own = [
            Run(line, int(a), int(b))
            for a, b in zip(np.flatnonzero(change > 0), np.flatnonzero(change < 0), strict=True)
        ]
        if turn and len(own) > 1 and own[0].start == 0 and own[-1].stop == turn:
            own = [*own[1:-1], Run(line, own[-1].start, turn + own[0].stop)]
        found += own
    return found


def _points(trace: Trace, xi: Floats, eta: Floats, points: int) -> Floats:
    """Points of places (n, m), in rows as long as lines have points."""
    more = -xi.size % points
    rows = [np.pad(each.ravel(), (0, more)).reshape(-1, points) for each in (xi, eta)]
    return trace(*rows)[0].reshape(-1, 2)[: xi.size].reshape(*xi.shape, 2)
