"""From a part, a porosity and a pattern to controls that give it: the whole of a design."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
from numpy.typing import ArrayLike

from fdjax.errors import InputError
from fdjax.keys import check_values
from fdjax.limits import Limits
from fdjax.optimise.least_squares import PATIENCE, STEPS, Outcome, Progress, optimise
from fdjax.optimise.objective import LEAST_WINDOW, MARGIN, Objective, Term
from fdjax.part.part import Part
from fdjax.pattern.base import AbstractPattern, AbstractSettings
from fdjax.pattern.isolines import Isolines
from fdjax.precision import require_float64
from fdjax.programs import program
from fdjax.road.deposit import Points
from fdjax.road.stroke import Stroke
from fdjax.road.window import SoftWindows
from fdjax.target.target import Target

WIDELY = 0.005
"""Share of the places at which a limit must be reached to be what a design is limited by."""

STEEP = 0.1
"""Solid share by which a target may change over half a window: lines crowd no faster."""

OBJECTIVES = ("windows", "cells")
"""Where the porosity error is summed: windows, or the pattern's own cells."""


@dataclass(frozen=True, eq=False)
class Design:
    """A finished design.

    - `part`; `objective`: what was made small; `pattern` with `controls`: what was found.
    - `outcome`: how the last optimisation went; `steps`, `seconds`: of all of them together.
    - `made`: whether the pattern could be made there.
    - `broken`: largest share by which each kind of limit is broken, where it is.
    - `held`: share of the places where each kind of limit is reached, where it is.
    - `road_width`: least and largest, mm.
    - `volume`: that the target asks for in all layers together, mm^3.
    - `limits`: of the machine, as the design kept them.
    """

    part: Part
    objective: Objective
    pattern: AbstractPattern
    controls: Any
    outcome: Outcome
    steps: int
    seconds: float
    made: bool
    broken: dict[str, float]
    held: dict[str, float]
    road_width: tuple[float, float]
    volume: float
    limits: Limits

    @property
    def limited_by(self) -> list[str]:
        """What keeps the design from its target, in words: limits reached, and a steep target."""
        found = [
            f"{name} at its limit in {100 * share:.1f} % of the places looked at"
            for name, share in self.held.items()
            if share > WIDELY
        ]
        if self.objective.windows is not None:
            windows: SoftWindows = jax.device_get(self.objective.windows)
            used = windows.room > LEAST_WINDOW * windows.full
            asked = np.where(used, windows.target, np.nan)
            half = windows.steps // 2, windows.steps // 2, 1
            rises = [
                asked.take(range(k, asked.shape[axis]), axis)
                - asked.take(range(asked.shape[axis] - k), axis)
                for axis, k in enumerate(half)
            ]
            steepest = max(float(np.nanmax(np.abs(rise), initial=0.0)) for rise in rises)
            if steepest > STEEP:
                found.append(
                    f"a target that changes by {steepest:.2g} within {windows.size / 2:g} mm"
                )
        return found

    def recounted(self, laid: float) -> "Design":
        """The design with as many lines as bring a plan that held `laid` mm^3 nearest to `volume`.

        Walls, corners and holes make a plan differ from its model by some tenths of a per cent.
        """
        pattern = self.pattern.counted(self.volume, laid)
        return self if pattern is self.pattern else replace(self, pattern=pattern)

    def corrected(
        self,
        places: ArrayLike,
        volumes: ArrayLike,
        *,
        progress: Callable[[Progress], None] | None = None,
    ) -> "Design":
        """The design moved so that its plan, and not its model alone, meets the target.

        - `places` (n, 3), mm, and `volumes` (n,), mm^3: of what a plan of it lays, in short pieces,
          as `Build.deposits` gives them.

        What the plan lays in a window beside what the model has there is taken off the target: at
        walls a plan joins, ends early and leaves out what the model knows in the mean only.
        """
        windows: SoftWindows = self.objective.windows
        if windows is None:
            return self
        modelled, volume = jax.device_get(_modelled(self.pattern, windows))
        # By NumPy: as many pieces as no other plan has would compile anew.
        by_hand = jax.tree.map(np.asarray, windows)
        laid = by_hand.sums(Points(np.asarray(places), np.asarray(volumes)))
        counted = by_hand.room > LEAST_WINDOW * by_hand.full
        beside = np.where(counted, laid - modelled, 0.0) / np.maximum(by_hand.room, 1e-300)
        goal = replace(
            windows,
            target=jax.device_put(by_hand.target - beside),
            total=jax.device_put(by_hand.total - (np.sum(volumes) - volume)),
        )
        found, outcome = _in_rounds(
            eqx.tree_at(lambda o: (o.pattern, o.windows), self.objective, (self.pattern, goal)),
            self.pattern.correcting,
            self.pattern.patience,
            progress,
        )
        return _finished(
            self.part,
            self.objective,
            found,
            outcome,
            steps=self.steps + outcome.steps,
            seconds=self.seconds + outcome.seconds,
            volume=self.volume,
        )

    def strokes(self) -> Iterator[Sequence[Stroke]]:
        """What is to be laid on each layer, for `fdjax.lay`."""
        return self.pattern.strokes(self.controls)


def design(
    part: Any,
    target: Callable[..., Any],
    *,
    limits: Limits,
    pattern: AbstractSettings | None = None,
    window: float = 5.0,
    objective: str = "windows",
    smoothness: float = 1e-4,
    iterations: int | None = None,
    patience: float | None = None,
    span_limit: bool = True,
    terms: Sequence[Term] = (),
    progress: Callable[[Progress], None] | None = None,
) -> Design:
    """Move the controls of a pattern until its roads have the porosity `target(x, y, z)`.

    - `part`: a `Part`, or a region of ten layers of 0.2 mm: what `Part.plate` takes.
    - `target`: porosity (0 to 1) of JAX arrays x, y and z in mm, or of x and y; `limits`: of the
      machine.
    - `pattern`: settings of a pattern; by default `Isolines()`.
    - `window`: side (mm) of the windows in which `objective` "windows" compares porosity,
      turn-arounds included; "cells" compares the pattern's own cells.
    - `smoothness`: weight of roughness; `iterations`: most evaluations in all; `patience`: gain
      of the objective over four improvements below which a stage ends, by default the pattern's;
      see `optimise`.
    - `terms`: residuals of one's own that are made small as well, each a function of the pattern
      and of what `pattern.realise` gives; in units of porosity, as the error is.

    Raises `InputError` for what cannot be designed at all. A result that folds or misses is
    returned, and says so.
    """
    require_float64()
    pattern = Isolines() if pattern is None else pattern
    window = _checked(limits, pattern, window)
    for name, value in (("smoothness", smoothness), ("iterations", iterations or 0)):
        if not 0 <= value < np.inf:
            raise InputError(f"{name}: {value!r} must be 0 or more, and finite")
    if callable(terms) or not all(map(callable, terms)):
        raise InputError(f"terms: {terms!r:.60} is no list of functions (pattern, realised)")
    if objective not in OBJECTIVES:
        raise InputError(f'objective: "{objective}" is not one of {", ".join(OBJECTIVES)}')
    part = part if isinstance(part, Part) else Part.plate(part)
    target = target if isinstance(target, Target) else Target(target)
    limits = limits if span_limit else replace(limits, longest_span=np.inf)
    windows = SoftWindows.over(
        part,
        target.solid,
        window,
        flat=target.is_flat_over(part),
        steps=pattern.window_steps,
    )
    if not (windows.room > LEAST_WINDOW * windows.full).any():
        raise InputError(f"window: none of {window:g} mm is half inside; ask for a smaller one")
    # As arrays, so that other numbers do not compile anew.
    windows = jax.tree.map(lambda value: jax.device_put(np.asarray(value, float)), windows)
    volume = float(windows.total)
    now = pattern.begin(part, target, limits, window)
    patience = now.patience if patience is None else patience
    now = _recounted(now, volume)
    stages = [None, windows] if objective == "windows" and pattern.cells_first else [windows]
    stages = [None] if objective == "cells" else stages
    steps, seconds, outcome, problem = 0, 0.0, None, None
    for stage in stages:
        # A target that is no part of the program needs none of its own.
        cells = target if stage is None else None
        problem = Objective(now, stage, cells, limits, smoothness, terms=tuple(terms))
        budget = iterations
        if len(stages) > 1:
            most = STEPS[False] if iterations is None else iterations
            budget = most - steps if stage is stages[-1] else most // 4
        now, outcome = _in_rounds(problem, budget, patience, progress)
        steps, seconds = steps + outcome.steps, seconds + outcome.seconds
    now = _recounted(now, volume)
    assert outcome is not None
    assert problem is not None
    return _finished(part, problem, now, outcome, steps=steps, seconds=seconds, volume=volume)


def _checked(limits: Any, pattern: Any, window: Any) -> float:
    """The window as a number of mm. Raises `InputError` for what is none that shows porosity, and
    for what is no machine's limits or no settings of a pattern.
    """
    if not isinstance(limits, Limits):
        raise InputError(
            f'limits: {limits!r:.60} is none; give those of a machine, load_machine("...").limits'
        )
    if not isinstance(pattern, AbstractSettings):
        raise InputError(f"pattern: {pattern!r:.60} is no settings of one; give Isolines() or so")
    check_values(pattern)
    try:
        side = float(window)
    except (TypeError, ValueError):
        raise InputError(f"window: {window!r:.60} is no number of mm") from None
    if not pattern.road_width <= side < np.inf:
        raise InputError(
            f"window: {side:g} mm, and roads are {pattern.road_width:g} mm wide; porosity is seen "
            "in windows of a few roads, and none can be narrower than one"
        )
    return side


def _in_rounds(
    problem: Objective,
    steps: int | None,
    patience: float | None,
    progress: Callable[[Progress], None] | None,
) -> tuple[AbstractPattern, Outcome]:
    """Optimise the problem's pattern from its own controls, mend it and go on from there, as long
    as there is something to mend and that gains; in so many steps together.

    Returns the pattern at the best that was found, and the outcome there: mended once more unless
    that loses as much as a round has to gain.
    """
    now, best, spent, seconds = problem.pattern, None, 0, 0.0
    gain = PATIENCE[True] if patience is None else patience

    def round_of(now: AbstractPattern, left: int | None) -> Outcome:
        own = eqx.tree_at(lambda o: o.pattern, problem, now)
        return optimise(own, now.controls(), steps=left, patience=patience, progress=progress)

    while True:
        outcome = round_of(now, None if steps is None else steps - spent)
        spent, seconds = spent + outcome.steps, seconds + outcome.seconds
        now = now.at(outcome.controls)
        least = np.inf if best is None else best[1].objective
        if best is None or outcome.objective < least:
            best = now, outcome
        mended = now.mended()
        if mended is now or spent == steps or not outcome.objective < (1 - gain) * least:
            break
        now = mended
    now, outcome = best
    mended = now.mended()
    if mended is not now:
        seen = round_of(mended, 0)
        if seen.objective <= (1 + gain) * outcome.objective:
            now, outcome = mended, seen._replace(converged=outcome.converged)
    return now, outcome._replace(steps=spent, seconds=seconds)


def _finished(
    part: Part,
    objective: Objective,
    pattern: AbstractPattern,
    outcome: Outcome,
    *,
    steps: int,
    seconds: float,
    volume: float,
) -> Design:
    """The design of a pattern at its own controls, looked at as it is now."""
    made, excess, width = jax.device_get(_survey(pattern, objective.limits))
    return Design(
        part=part,
        objective=objective,
        pattern=pattern,
        controls=outcome.controls,
        outcome=outcome,
        steps=steps,
        seconds=seconds,
        made=bool(made),
        broken={name: float(worst) for name, (worst, _) in excess.items() if worst > 0},
        held={name: float(share) for name, (_, share) in excess.items() if share > 0},
        road_width=(float(width[0]), float(width[1])),
        volume=volume,
        limits=objective.limits,
    )


@program
def _survey(pattern: AbstractPattern, limits: Limits) -> tuple[Any, dict[str, Any], Any]:
    """At its own controls: whether it could be made, by how much limits of each kind are broken
    and at what share of the places they are reached, and least and largest road width (mm).
    """
    realised = pattern.realise(pattern.controls())
    excess = {
        name: (values.max(), (values > -2 * MARGIN).mean())
        for name, values in pattern.penalties(realised, limits).items()
    }
    return realised.made, excess, pattern.widths(realised)


@program
def _volume(pattern: AbstractPattern) -> Any:
    return pattern.deposit(pattern.realise(pattern.controls())).volume.sum()


@program
def _modelled(pattern: AbstractPattern, windows: SoftWindows) -> tuple[Any, Any]:
    """The deposit of a pattern at its own controls, in each window and as a whole, mm^3."""
    deposit = pattern.deposit(pattern.realise(pattern.controls()))
    return windows.sums(deposit), deposit.volume.sum()


def _recounted(pattern: AbstractPattern, asked: float) -> AbstractPattern:
    """The pattern with its count of lines, where it has one, fitted to the volume in the model."""
    return pattern.counted(asked, float(_volume(pattern))) if pattern.mean_by_count else pattern
