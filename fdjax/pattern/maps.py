"""The grid maps by name: what of the unit square a pattern's controls make of its four sides."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from fdjax.grid import bspline
from fdjax.grid.algebraic import Cartesian, Spacings, Transfinite, TwoBoundary
from fdjax.grid.base import AbstractGridMap, Sides
from fdjax.grid.elliptic import Elliptic
from fdjax.grid.respaced import Respaced, SpacingField
from fdjax.grid.solvers import Report
from fdjax.grid.spacing import (
    AbstractSpacing,
    DensitySpacing,
    GeometricSpacing,
    RobertsSpacing,
    tanh_spacing,
)
from fdjax.programs import program

if TYPE_CHECKING:
    from fdjax.pattern.grid_controls import Controls
    from fdjax.pattern.grid_lines import GridLines


def _spacings(controls: Controls) -> Spacings:
    if controls.spacing is None:
        return Spacings()
    sides = jax.vmap(DensitySpacing.of)(controls.spacing)
    return Spacings(*(jax.tree.map(lambda part, k=k: part[k], sides) for k in range(4)))


def _box(sides: Sides) -> tuple[Array, Array]:
    """Lower left and upper right corner of the box around the sides: lines are cut at these."""
    run = jnp.linspace(0, 1, 257)
    points = jnp.concatenate([side(run) for side in sides])
    return points.min(0), points.max(0)


_MADE = jnp.asarray(True)
_Map = tuple[AbstractGridMap, Bool[Array, ""]]


class Stretching(NamedTuple):
    """A spacing with one number, its strength.

    - `of`: from the strength and alpha; `free`: a strength as any real number, an optimiser's;
      `strength`: back again, on JAX arrays. `least`: strengths lie above.
    """

    of: Callable[[Any, float], AbstractSpacing]
    free: Callable[[float], float]
    strength: Callable[[Any], Any]
    least: float


STRETCHINGS = {
    "roberts": Stretching(
        RobertsSpacing, lambda beta: math.log(beta - 1), lambda free: 1 + jnp.exp(free), 1.0
    ),
    "tanh": Stretching(tanh_spacing, math.log, jnp.exp, 0.0),
    "geometric": Stretching(
        lambda growth, _: GeometricSpacing(growth),
        lambda growth: growth,
        lambda free: free,
        -math.inf,
    ),
}
"""Stretchings by name: eq. (1), and others of the same interface."""


def _uniform(pattern: GridLines, controls: Controls) -> _Map:
    return _respaced(pattern, controls, Cartesian(*_box(pattern.sides))), _MADE


def _stretched(pattern: GridLines, controls: Controls) -> _Map:
    along = []
    for k, name in enumerate(pattern.stretching):
        kind, strength = STRETCHINGS[name], jnp.asarray(pattern.strength[k])
        if controls.stretching is not None:
            strength = kind.strength(controls.stretching[k])
        along.append(kind.of(strength, pattern.alpha[k]))
    return Cartesian(*_box(pattern.sides), *along), _MADE


def _two_boundary(pattern: GridLines, controls: Controls) -> _Map:
    spacings = _spacings(controls)
    sides = pattern.sides
    return TwoBoundary(sides.bottom, sides.top, spacings.bottom, spacings.top, spacings.left), _MADE


def elliptic(pattern: GridLines, controls: Controls) -> Elliptic:
    """The elliptic grid of a pattern at these controls, not solved yet."""
    ni, nj = pattern.nodes
    seam = pattern.solver.seam
    xi, eta = jnp.linspace(0, 1, ni)[1:-1, None], jnp.linspace(0, 1, nj)[None, 1:-1]
    if seam.closed:
        eta = jnp.linspace(0, 1, nj + 1)[None, :-1]
    if seam.tail:
        xi = jnp.linspace(0, 1, ni)[:-1, None]

    def control(constant: float, spline: Array | None = None) -> Array | float:
        given: Any = constant
        if seam.tail:
            # Across the cut xi and eta point the other way.
            given = jnp.full((ni - 1, nj - 2), constant).at[0].set(0.0)
        if spline is None:
            return given
        spline = bspline.closed(spline, 1) if seam.closed else spline
        spline = bspline.folded(spline, -1.0) if seam.tail else spline
        return given + bspline.field(spline, xi, eta)

    return Elliptic(
        pattern.sides,
        _spacings(controls),
        control(pattern.phi, controls.phi),
        control(pattern.psi, controls.psi),
        control(pattern.p),
        control(pattern.q),
        pattern.nodes,
        controls.spacing is not None,
        pattern.solver,
    )


def _elliptic(pattern: GridLines, controls: Controls) -> _Map:
    if pattern.base is not None:
        return _of_base(pattern, controls)
    grid, report = elliptic(pattern, controls).map()
    return _respaced(pattern, controls, grid), report.converged & ~report.folded


def _respaced(pattern: GridLines, controls: Controls, base: AbstractGridMap) -> AbstractGridMap:
    """A map with its lines as dense as the controls have them."""
    if controls.crowding is None:
        whole = pattern.closed or pattern.tail is not None
        return Respaced(base, closed=pattern.closed) if whole else base
    of_xi, of_eta = controls.crowding
    of_eta = bspline.closed(of_eta, 1) if pattern.closed else of_eta
    of_eta = of_eta if pattern.tail is None else bspline.folded(of_eta)
    rows_xi, rows_eta = (jax.vmap(DensitySpacing.of)(each) for each in (of_xi, of_eta))
    return Respaced(
        base,
        SpacingField(rows_xi, closed_across=pattern.closed),
        SpacingField(rows_eta, closed_along=pattern.closed),
        pattern.closed,
    )


def _transfinite(pattern: GridLines, controls: Controls) -> _Map:
    grid = Transfinite(pattern.sides, _spacings(controls))
    return _respaced(pattern, controls, grid), _MADE


def _of_base(pattern: GridLines, controls: Controls) -> _Map:
    assert pattern.base is not None
    return _respaced(pattern, controls, pattern.base), jnp.asarray(pattern.base_made)


def _o_transfinite(pattern: GridLines, controls: Controls) -> _Map:
    # Between a straight cut and itself it is interpolation between the two other sides.
    return _respaced(pattern, controls, Transfinite(pattern.sides)), _MADE


MAPS: dict[str, Callable[[GridLines, Controls], _Map]] = {
    "uniform": _uniform,
    "stretched": _stretched,
    "two-boundary": _two_boundary,
    "transfinite": _transfinite,
    "elliptic": _elliptic,
    "polar": _of_base,
    "conformal": _of_base,
    "o-transfinite": _o_transfinite,
    "o-elliptic": _elliptic,
    "o-conformal": _of_base,
    "c-elliptic": _elliptic,
}
"""The grid maps by name: a new one is one function here."""

NEED_BASE = ("polar", "conformal", "o-conformal")
"""Those that are given, and do not follow from four sides."""


def solved_once(pattern: GridLines) -> GridLines:
    """The pattern with its elliptic map solved for good, where no control moves its nodes."""
    first = pattern.first
    moved = (first.phi, first.psi, first.spacing)
    if MAPS[pattern.kind] is not _elliptic or any(each is not None for each in moved):
        return pattern
    base, report = _solved(pattern)
    made = report.converged & ~report.folded
    return eqx.tree_at(
        lambda p: (p.base, p.base_made), pattern, (base, made), is_leaf=lambda leaf: leaf is None
    )


@program
def _solved(pattern: GridLines) -> tuple[AbstractGridMap, Report]:
    return elliptic(pattern, pattern.first).map()


CLOSED = ("polar", "o-transfinite", "o-elliptic", "o-conformal")
"""Those that are rings along eta: lines of constant xi are closed, and go around a hole."""

SLIT = ("c-elliptic",)
"""Those that are cut open from the outline to a hole: lines of constant xi go around it as a C."""
