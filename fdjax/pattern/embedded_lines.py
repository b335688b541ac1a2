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
) -> Lines:
    """The lines of a layer with the fine ones between them.

    Divided is the grid that the layer's lines make with those of the other family in the same
    phase, which lie on the layer above or below or on the same: so a fine line begins and ends on
    lines of the other family, base or fine ones.

    - `combs`: lines of both families in all phases; `edge`: what they keep from the walls.
    - `trace`: gives points and widths of lines (n, points) in xi, eta.
    - `joined`: whether lines that run through a zone take fine ones on their way, along where
      lines of the other family lie on other layers.
    """
    axes = [
        Axis.of(Scan(family, scan.phase, scan.phases), comb)
        for family, comb in zip(FAMILIES, combs, strict=True)
    ]
    squeeze = Squeeze(edge)

    def middles(parts: int) -> Floats:
        u, v = ((e[1:] + e[:-1]) / 2 for e in (axis.edges(parts) for axis in axes))
        return _points(trace, *squeeze(*np.meshgrid(u, v, indexing="ij")), len(edge.left))

    divided = embedded.divided(middles, (axes[0].cells, axes[1].cells))
    if scan.family == "eta":
        divided, axes = divided.T, axes[::-1]
    own, other = axes
    parts = embedded.parts
    net = Net(scan.family, parts, own.edges(parts), other.edges(parts), squeeze, trace)
    fine = [
        run
        for run in _runs(divided, parts)
        if 0 < net.at[run.line] < 1 and net.along[run.stop] > net.along[run.start]
    ]
    if not fine:
        return base
    whole = [Run((k + 1) * parts, 0, len(net.along) - 1) for k in range(len(base.xy))]
    clearance = CLEAR * max(float(width.max()) for width in base.width)
    bundles = bundled(net, whole, fine, clearance) if joined else Bundles(net)
    changed = [run for run in whole if run in bundles.through]
    alone = [run for run in fine if run not in bundles.taken]
    made = changed + alone
    xy, width = net.traced([bundles.course(run) for run in made])
    kept = [k for k, run in enumerate(whole) if run not in bundles.through]
    # The plan joins levels 1, 2, 4 ... apart.
    apart = 1 << (parts - 1).bit_length()
    runs = [*(whole[k] for k in kept), *made]
    return replace(
        base,
        level=np.array([(run.line // parts - 1) * apart + run.line % parts for run in runs]),
        xy=[*(base.xy[k] for k in kept), *xy],
        width=[*(base.width[k] for k in kept), *width],
    )


def border_joins(embedded: Embedded, width: Any, height: float, shares: Any) -> tuple[Any, Any]:
    """Where fine lines are joined in the mean: places xy, (n, 2), mm, and volumes, (n,), mm^3.

    - `width`: of the widest road; `height`: of a layer, mm; `shares`: of the layers, of a family.
    """
    places, length = embedded.ways(CLEAR * width)
    return places, shares * section_area(width, height) * length


def _runs(divided: NDArray[np.intp], parts: int) -> list[Run]:
    """The fine lines between cells, along the second axis, from line to line of the first."""
    found = []
    for line in range(1, len(divided)):
        if line % parts == 0:
            continue
        there = np.zeros(divided.shape[1] + 2, int)
        for beside in (divided[line - 1], divided[line]):
            there[1:-1] |= line % (parts // beside) == 0
        change = np.diff(there)
        found += [
            Run(line, int(a), int(b))
            for a, b in zip(np.flatnonzero(change > 0), np.flatnonzero(change < 0), strict=True)
        ]
    return found


def _points(trace: Trace, xi: Floats, eta: Floats, points: int) -> Floats:
    """Points of places (n, m), in rows as long as lines have points."""
    more = -xi.size % points
    rows = [np.pad(each.ravel(), (0, more)).reshape(-1, points) for each in (xi, eta)]
    return trace(*rows)[0].reshape(-1, 2)[: xi.size].reshape(*xi.shape, 2)
