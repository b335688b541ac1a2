"""From a layer domain and a porosity to controls that give it: the whole of a design."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from fdjax.errors import InputError
from fdjax.grid.base import Sides
from fdjax.grid.continuation import Continuation
from fdjax.grid.quality import Quality, quality
from fdjax.grid.solvers import AbstractSolver, Newton
from fdjax.grid.spacing import fit_log_density
from fdjax.limits import Limits
from fdjax.optimise.least_squares import Outcome, Progress, optimise
from fdjax.optimise.objective import Objective
from fdjax.optimise.start import Start, begin
from fdjax.part.patch import Patch
from fdjax.pattern.base import Lines
from fdjax.pattern.grid_lines import Controls, GridLines
from fdjax.pattern.width import free_of
from fdjax.precision import require_float64
from fdjax.road.holes import Holes
from fdjax.road.porosity import Samples, equal_edges, whole_lines
from fdjax.road.stacking import Stacking
from fdjax.road.window import SoftWindows

CONTROLS = ("spacing", "stretching", "phi", "psi", "width", "width_field")
"""What a design may move; see `pattern.grid_lines.Controls`."""

QUALITY_NODES = 65
"""Nodes each way of the grid whose quality is reported."""

_MAP_CONTROLS = {
    "uniform": (),
    "stretched": ("stretching",),
    "two-boundary": ("spacing",),
    "transfinite": ("spacing",),
    "elliptic": ("spacing", "phi", "psi"),
}


@dataclass(frozen=True, eq=False)
class Design:
    """A finished design.

    - `pattern` with `controls`: what was found; `outcome`: how the last optimisation went;
      `steps`, `seconds`: of all of them together.
    - `made`: whether the map converged and is unfolded.
    - `broken`: largest share by which each kind of limit is broken, where it is.
    - `road_width`: least and largest, mm.
    - `quality`: of the map's grid of `QUALITY_NODES` nodes each way.
    - `volume`: that the target asks for in all layers together, mm^3.
    - `limits`: of the machine, as the design kept them.
    """

    pattern: GridLines
    controls: Controls
    outcome: Outcome
    steps: int
    seconds: float
    made: bool
    broken: dict[str, float]
    road_width: tuple[float, float]
    quality: Quality
    volume: float
    limits: Limits

    def recounted(self, laid: float) -> "Design":
        """The design with as many lines as bring a plan that held `laid` mm^3 nearest to `volume`.

        Walls, corners and holes make a plan differ from its model by some tenths of a per cent.
        """
        layers = self.pattern.stacking.layers
        share = laid / (float(_survey(self.pattern, self.limits).volume) * layers)
        pattern = _refit_comb(self.pattern, self.limits, self.volume / layers, share)
        return self if pattern is self.pattern else replace(self, pattern=pattern)

    def lines(self) -> list[list[Lines]]:
        """The lines of each layer, from wall to wall, for `fdjax.plan.trace.lay`."""
        return self.pattern.lines(self.controls)


def design(
    patch: Patch,
    target: Callable[[Any, Any], Any],
    *,
    limits: Limits,
    layers: int = 10,
    layer_height: float = 0.2,
    map: str = "transfinite",
    mode: str = "alternate-staggered",
    phases: int = 5,
    road_width: float | None = 0.4,
    lines: tuple[int, int] | None = None,
    controls: tuple[str, ...] = ("spacing",),
    window: float = 5.0,
    objective: str = "windows",
    knots: int | None = None,
    field_knots: tuple[int, int] = (8, 6),
    smoothness: float = 1e-4,
    iterations: int = 60,
    patience: float = 0.1,
    span_limit: bool = True,
    nodes: tuple[int, int] = (33, 33),
    phi: float = 0.0,
    psi: float = 0.0,
    p: float = 0.0,
    q: float = 0.0,
    alpha: tuple[float, float] = (0.5, 0.5),
    beta: tuple[float, float] = (1.1, 1.1),
    solver: AbstractSolver | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Design:
    """Move the controls of a grid pattern until its roads have the porosity `target(x, y)`.

    - `patch`: the layer domain; `target`: porosity (0 to 1) of JAX arrays x, y in mm; `limits`: of
      the machine.
    - `layers`, `layer_height` (mm), `mode`, `phases`: of the stack, see `road.stacking.Stacking`;
      modes that are not staggered take no phases.
    - `map`: a key of `pattern.grid_lines.MAPS`; `nodes`, `solver`, `phi`, `psi`, `p`, `q`: of the
      elliptic one, by default Newton's method with continuation; `alpha`, `beta`: of the
      stretched one.
    - `road_width`: mm; with "width" or "width_field" among the controls only where to begin, and
      None then leaves that to the target's mean.
    - `lines`: of each family on a layer; chosen from the target's mean if None.
    - `controls`: some of `CONTROLS`; `knots`: spline coefficients of each side's spacing, by
      default as many as windows of this size, and the solver's nodes, can tell apart;
      `field_knots`: of a field.
    - `window`: side (mm) of the windows in which `objective` "windows" compares porosity,
      turn-arounds included; "cells" compares the lines' own cells.
    - `smoothness`: weight of roughness; `iterations`: most evaluations in all; `patience`: gain
      of the objective over four improvements below which a stage ends.

    Raises `InputError` for what cannot be designed at all. A result that folds or misses is
    returned, and says so.
    """
    require_float64()
    _check_controls(map, controls)
    stacking = Stacking(mode, phases if mode.endswith("staggered") else 1, layers)
    limits = limits if span_limit else replace(limits, longest_span=np.inf)
    sides = Sides.of(patch)
    free_width = "width" in controls or "width_field" in controls
    start = begin(
        sides,
        target,
        height=layer_height,
        width=None if free_width and road_width is None else road_width,
        stacking=stacking,
        limits=limits,
        lines=lines,
        window=window,
    )
    elliptic_nodes = nodes if map == "elliptic" else None
    first = _first(controls, start, patch, limits, window, knots, field_knots, beta, elliptic_nodes)
    samples = _samples(first, start, patch, window)
    pattern = GridLines(
        sides=sides,
        comb=_comb(start.comb),
        width=start.width,
        width_range=limits.road_width,
        height=layer_height,
        first=first,
        samples=samples,
        holes=Holes.of(patch.outline, width=start.width, resolution=window / 8),
        phi=phi,
        psi=psi,
        p=p,
        q=q,
        beta=beta,
        alpha=alpha,
        skew_limit=jnp.full([len(each.places) for each in samples], 0.9, jnp.float64),
        kind=map,
        stacking=stacking,
        nodes=nodes,
        solver=solver or Continuation(Newton()),
    )
    # No more skewed than the grid that the outline itself gives.
    skew = jnp.maximum(pattern.skew_limit, 1.02 * _survey(pattern, limits).skew)
    pattern = eqx.tree_at(lambda p: p.skew_limit, pattern, skew)
    windows = SoftWindows.over(patch.outline, lambda x, y: 1 - np.asarray(target(x, y)), window)
    layer_volume = windows.total * layer_height
    if lines is None:
        pattern = _refit_comb(pattern, limits, layer_volume)
    stages = [None, windows] if objective == "windows" and map == "elliptic" else [windows]
    stages = [None] if objective == "cells" else stages
    steps, seconds, outcome = 0, 0.0, None
    for stage in stages:
        problem = Objective(pattern, stage, target, layer_height, limits, smoothness)
        budget = iterations - steps if stage is stages[-1] else iterations // 4
        outcome = optimise(
            problem, pattern.first, steps=budget, patience=patience, progress=progress
        )
        steps, seconds = steps + outcome.steps, seconds + outcome.seconds
        pattern = eqx.tree_at(lambda p: p.first, pattern, outcome.controls)
    if lines is None:
        pattern = _refit_comb(pattern, limits, layer_volume)
    assert outcome is not None
    seen = _survey(pattern, limits)
    broken = {name: float(worst) for name, worst in seen.worst.items() if worst > 0}
    return Design(
        pattern=pattern,
        controls=outcome.controls,
        outcome=outcome,
        steps=steps,
        seconds=seconds,
        made=bool(seen.made),
        broken=broken,
        road_width=(float(seen.width[0]), float(seen.width[1])),
        quality=quality(np.asarray(seen.nodes)),
        volume=layer_volume * layers,
        limits=limits,
    )


def _check_controls(map: str, controls: tuple[str, ...]) -> None:
    for name in controls:
        if name not in CONTROLS:
            raise InputError(f'controls: "{name}" is not one of {", ".join(CONTROLS)}')
        if not name.startswith("width") and name not in _MAP_CONTROLS.get(map, CONTROLS):
            has = ", ".join((*_MAP_CONTROLS[map], "width", "width_field"))
            raise InputError(f'controls: map "{map}" has no "{name}"; it has {has}')
    if "width" in controls and "width_field" in controls:
        raise InputError("controls: width and width_field exclude each other")


def _lengths(patch: Patch) -> tuple[float, float]:
    """Length of the longer of bottom and top, and of left and right, mm."""

    def length(side: Any) -> float:
        return float(np.hypot(*np.diff(side.polyline(), axis=0).T).sum())

    return max(map(length, (patch.bottom, patch.top))), max(map(length, (patch.left, patch.right)))


def _first(
    controls: tuple[str, ...],
    start: Start,
    patch: Patch,
    limits: Limits,
    window: float,
    knots: int | None,
    field_knots: tuple[int, int],
    beta: tuple[float, float],
    nodes: tuple[int, int] | None,
) -> Controls:
    """The controls to start from; those not asked for are None."""
    if knots is None:
        # As many as windows can tell apart and, where a solver has to follow, its nodes.
        knots = int(np.ceil(max(_lengths(patch)) / (0.75 * window))) + 3
        knots = int(np.clip(knots, 8, 32 if nodes is None else max(8, min(nodes) // 2)))
    along_xi, along_eta = (jnp.asarray(fit_log_density(d, knots)) for d in start.density)
    width = free_of(start.width, *limits.road_width)
    widths = {"width": jnp.asarray(width), "width_field": jnp.full(field_knots, width)}
    wanted = {name: widths[name] for name in controls if name in widths}
    return Controls(
        spacing=jnp.stack([along_xi, along_eta] * 2) if "spacing" in controls else None,
        stretching=jnp.log(jnp.asarray(beta) - 1) if "stretching" in controls else None,
        phi=jnp.zeros(field_knots) if "phi" in controls else None,
        psi=jnp.zeros(field_knots) if "psi" in controls else None,
        width=next(iter(wanted.values()), None),
    )


def _samples(first: Controls, start: Start, patch: Patch, window: float) -> tuple[Samples, Samples]:
    """Samples about a fifth of a window apart, where the design starts."""
    samples = []
    for length, density, comb in zip(_lengths(patch), start.density, start.comb, strict=True):
        count = int(np.clip(np.ceil(5 * length / window), 16, 160))
        lines = np.cumsum(density) - (density + density[0]) / 2
        share = lines / lines[-1] if first.spacing is not None else np.linspace(0, 1, len(lines))
        edges = whole_lines(equal_edges(partial(_place, share), count), comb)
        # Where lines are further apart than that, samples between them too.
        pieces = 2 * int(count / len(edges) / 2 + 0.25) + 1
        samples.append(Samples.between(edges, pieces))
    return samples[0], samples[1]


def _place(share: Any, t: Any) -> Any:
    """Where along a side the share t of all lines is reached, given it at equal steps."""
    return np.interp(t, share, np.linspace(0, 1, len(share)))


def _comb(counts: Sequence[int]) -> tuple[Any, Any]:
    return jnp.asarray(float(counts[0])), jnp.asarray(float(counts[1]))


class _Survey(NamedTuple):
    """What a pattern has at its first controls.

    `volume` of the mean layer, mm^3; `skew` of the grid where it is limited; whether it could be
    `made`; the `worst` share by which each kind of limit is broken, negative where it is kept;
    least and largest road `width`, mm; `nodes` of an even grid, (n, n, 2).
    """

    volume: Any
    skew: Any
    made: Any
    worst: dict[str, Any]
    width: tuple[Any, Any]
    nodes: Any


@eqx.filter_jit
def _survey(pattern: GridLines, limits: Limits) -> _Survey:
    realised = pattern.realise(pattern.first)
    excess = pattern.penalties(realised, limits)._asdict()
    places = jnp.linspace(0, 1, QUALITY_NODES)
    width = realised.width(places[:, None], places[None])
    return _Survey(
        pattern.deposit(realised).volume.sum(),
        pattern.skew(realised),
        realised.made,
        {name: values.max() for name, values in excess.items()},
        (width.min(), width.max()),
        realised.grid(places[:, None], places[None]),
    )


def _refit_comb(pattern: GridLines, limits: Limits, volume: float, laid: float = 1.0) -> GridLines:
    """The pattern with as many lines, of the family that has more, as the mean asks for.

    `volume` is what the mean layer shall hold, mm^3; `laid` is the share of the model's volume
    that a plan was seen to have.
    """
    counts = [int(n) for n in pattern.comb]
    more = int(np.argmax(counts))

    def model(extra: int) -> float:
        trial = [n + extra * (k == more) for k, n in enumerate(counts)]
        trial_pattern = eqx.tree_at(lambda p: p.comb, pattern, _comb(trial))
        return laid * float(_survey(trial_pattern, limits).volume)

    began, now = list(counts), model(0)
    # A second look, since turn-arounds change with the count; the third is for rounding.
    for _ in range(3):
        change = round((volume - now) / (model(1) - now))
        if change == 0:
            break
        counts[more] = max(1, counts[more] + change)
        now = model(0)
    return pattern if counts == began else eqx.tree_at(lambda p: p.comb, pattern, _comb(counts))
