"""Elliptic grids: solved once at nodes, differentiated implicitly, defined everywhere."""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from fdjax.errors import InputError
from fdjax.grid import block_tridiagonal, bspline, multigrid, operators, winslow
from fdjax.grid.algebraic import Spacings, Transfinite, between_walls
from fdjax.grid.base import AbstractGridMap, Sides
from fdjax.grid.seam import OPEN, Seam
from fdjax.grid.solvers import AbstractSolver, Multigrid, Report
from fdjax.grid.transfer import Pair, each, interior, planes, points, walled
from fdjax.grid.winslow import ControlFunctions
from fdjax.part.curve import Curve
from fdjax.precision import require_float64


def solve(
    solver: AbstractSolver,
    start: Float[Array, "ni nj 2"],
    controls: ControlFunctions,
    warm: bool = False,
) -> tuple[Float[Array, "ni nj 2"], Report]:
    """The lattice that satisfies the elliptic equations, and how the solve went.

    - `start`: the boundary nodes, which stay, and a first guess inside. Where the solver is one of
      closed lattices, only the first and the last row are boundaries; see `Seam`.
    - `controls`: control functions per index step.
    - `warm`: whether the guess is near the solution; see `AbstractSolver.solve`.

    Differentiable, forward and reverse and with many tangents at once, with respect to the
    boundary nodes and the controls, by the implicit function theorem at the lattice returned; the
    linearised system is eliminated once whatever the number of tangents. The derivative is that
    of the exact solution, so it is as accurate as the solve is converged.

    Raises `InputError` for what is no such problem, where the values are known: fewer than 3 x 3
    nodes, other numbers than float64, values that are not finite, boundary nodes that repeat.
    """
    _check(start, controls)
    return _solve(solver, warm, start, controls)


def _check(start: Float[Array, "ni nj 2"], controls: ControlFunctions) -> None:
    if start.ndim != 3 or start.shape[2] != 2 or min(start.shape[:2]) < 3:
        raise InputError(f"grid: nodes have shape {start.shape}; (ni, nj, 2) with ni, nj >= 3")
    inside = (start.shape[0] - 2, start.shape[1] - 2)
    for name, values in (("nodes", start), *controls._asdict().items()):
        if values.dtype != jnp.float64:
            raise InputError(f"grid: {name} are {values.dtype}; float64 is needed")
        if name != "nodes" and values.shape not in ((), inside):
            raise InputError(f"grid: {name} has shape {values.shape}; the interior has {inside}")
        if not isinstance(values, Tracer) and not np.isfinite(values).all():
            raise InputError(f"grid: {name} are not all finite")
    if isinstance(start, Tracer):
        return
    nodes = np.asarray(start)
    sides = {"bottom": nodes[:, 0], "right": nodes[-1], "top": nodes[:, -1], "left": nodes[0]}
    for name, side in sides.items():
        repeated = np.flatnonzero((side[1:] == side[:-1]).all(1))
        if len(repeated):
            raise InputError(
                f"grid: nodes {repeated[0]} and {repeated[0] + 1} of the {name} side coincide"
            )


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _solve(
    solver: AbstractSolver,
    warm: bool,
    start: Float[Array, "ni nj 2"],
    controls: ControlFunctions,
) -> tuple[Float[Array, "ni nj 2"], Report]:
    return solver.solve(start, controls, warm)


@_solve.defjvp
def _solve_jvp(solver: AbstractSolver, warm: bool, primals: tuple, tangents: tuple) -> tuple:
    start, controls = primals
    start_dot, controls_dot = tangents
    r, report = _solve(solver, warm, start, controls)
    seam = solver.seam
    boundary_dot = start_dot - points(seam.free(planes(start_dot)))
    if seam.closed:
        boundary_dot = boundary_dot.at[1:-1].set(0.0)
    boundary_dot = seam.whole(boundary_dot)

    def left(nodes: Array, functions: ControlFunctions) -> Pair:
        return seam.free(operators.equations_of(functions).residual(planes(seam.whole(nodes))))

    def apply(change: Pair) -> Pair:
        kept = each(jnp.subtract, each(interior, change), seam.free(change))
        moved = jax.jvp(lambda nodes: left(nodes, controls), (r,), (points(change),))[1]
        return each(jnp.add, moved, kept)

    _, residual_dot = jax.jvp(left, (r, controls), (boundary_dot, controls_dot))
    solve_forward, solve_transposed = _linear_solves(
        r, controls, min(0.1 * solver.tolerance, LINEAR), seam
    )
    inside_dot = jax.lax.custom_linear_solve(
        apply,
        each(jnp.negative, residual_dot),
        solve=lambda _, b: solve_forward(b),
        transpose_solve=lambda _, b: solve_transposed(b),
    )
    r_dot = seam.whole(boundary_dot + points(seam.free(inside_dot)))
    return (r, report), (r_dot, jax.tree.map(_no_tangent, report))


ELIMINATED = 64
"""Lattices with at most so many nodes along each line are linearised by elimination."""

LINEAR = 1e-9
"""Residual that cycles leave of a linearised right side, or a tenth of the solver's tolerance."""

_Solve = Callable[[Pair], Pair]


def _linear_solves(
    r: Float[Array, "ni nj 2"], controls: ControlFunctions, tolerance: float, seam: Seam
) -> tuple[_Solve, _Solve]:
    """Solutions of the linearised equations and of their transpose, for any number of right sides.

    Right sides and solutions are planes with zeros on the walls. Elimination serves many right
    sides at little more than the cost of one, but its own cost grows with the cube of a line's
    nodes; multigrid's grows with the nodes, for each right side. Lattices with a seam are always
    eliminated.
    """
    terms = operators.derivative(planes(r), operators.equations_of(controls))
    if seam != OPEN or r.shape[1] <= ELIMINATED:
        factors = seam.factor(operators.stencil(terms))

        def by_elimination(eliminate: Callable[[Any, Array], Array]) -> _Solve:
            def solve(rhs: Pair) -> Pair:
                inside = eliminate(factors, points(rhs)[1:-1, 1:-1])
                return planes(walled(inside))

            return solve

        return (
            by_elimination(block_tridiagonal.solve),
            by_elimination(block_tridiagonal.solve_transposed),
        )

    def by_cycles(operator: operators.AbstractLinear) -> _Solve:
        levels = multigrid.linear_levels(operator)
        return lambda rhs: multigrid.solve_linear(operator, levels, rhs, tolerance=tolerance)

    return by_cycles(operators.Linearised(terms)), by_cycles(operators.Transposed(terms))


def _no_tangent(value: Array) -> Array:
    if jnp.issubdtype(value.dtype, jnp.floating):
        return jnp.zeros_like(value)
    return jnp.zeros(value.shape, jax.dtypes.float0)  # pyright: ignore[reportReturnType]


class NodeMap(AbstractGridMap):
    """A lattice of nodes made into a map by cubic splines, which keep to the four sides.

    Between the nodes of a side a spline leaves a polyline with corners; that defect, zero at the
    nodes, is added back where it arises and fades out within two nodes. Polylines are so kept
    exactly, with their kinks; smooth curves to fourth order in the node spacing.

    - `kept`: 1 for those of bottom, right, top and left that are kept so, 0 for those that the
      spline has moved.
    """

    coefficients: Float[Array, "K L 2"]
    sides: Sides
    spacings: Spacings
    kept: tuple[Float[Array, ""] | float, ...] = (1.0, 1.0, 1.0, 1.0)

    @classmethod
    def through(
        cls,
        nodes: Float[Array, "ni nj 2"],
        sides: Sides,
        spacings: Spacings,
        *,
        closed: bool = False,
        tail: int = 0,
    ) -> "NodeMap":
        """The map through `nodes` (at least 4 each way) at equally spaced (xi, eta).

        `closed`: along eta the nodes are those of a ring, each once, from eta = 0 on. `tail`: the
        first so many columns, and the last, go on across xi = 0 as each other, turned round.
        """
        ni, nj = nodes.shape[:2]
        along_eta = bspline.closed_interpolation if closed else bspline.interpolation
        of_xi = jnp.einsum("ki,ijc->kjc", bspline.interpolation(ni), nodes)
        if tail:
            across = jnp.concatenate([nodes[:0:-1, ::-1], nodes])
            smooth = jnp.einsum("ki,ijc->kjc", bspline.interpolation(len(across))[ni - 1 :], across)
            cut = np.minimum(np.arange(nj), np.arange(nj)[::-1]) < tail
            of_xi = jnp.where(cut[:, None], smooth, of_xi)
        return cls(jnp.einsum("kjc,lj->klc", of_xi, along_eta(nj)), sides, spacings)

    def __call__(self, xi: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "... 2"]:
        r = bspline.field(self.coefficients, xi, eta)
        ni, nj = (count - 2 for count in self.coefficients.shape[:2])
        sides, spacings = self.sides, self.spacings
        along_xi, along_eta = (
            bspline.basis(np.array([0.0, 1.0]), count) for count in self.coefficients.shape[:2]
        )
        left, right = jnp.einsum("sk,klc->slc", along_xi, self.coefficients)
        bottom, top = jnp.einsum("sl,klc->skc", along_eta, self.coefficients)
        for curve, spacing, kept, t, wall, steps in zip(
            sides,
            (spacings.bottom, spacings.right, spacings.top, spacings.left),
            self.kept,
            (xi, eta, xi, eta),
            (bottom, right, top, left),
            (eta * (nj - 1), (1 - xi) * (ni - 1), (1 - eta) * (nj - 1), xi * (ni - 1)),
            strict=True,
        ):
            if curve.corners and len(curve.breaks) > 2:
                defect = curve(spacing(t)) - bspline.curve(wall, t)
                fade = jnp.maximum(1 - steps / 2, 0.0) ** 3
                r = r + kept * fade[..., None] * defect
        return r


TOUCH = 1e-6
"""Ends of sides closer than this meet, mm."""


_CONTROLS = ("phi", "psi", "p", "q", "phi_index", "psi_index")


class Elliptic(eqx.Module):
    """An elliptic grid to be solved: sides, their spacings, controls and the solver's nodes.

    - `phi`, `psi`: control functions on the unit square, constants or values at the interior
      nodes, shape (ni - 2, nj - 2). Positive phi draws lines of constant xi towards xi = 1.
    - `p`, `q`: those of physical space, lap(xi) = p and lap(eta) = q, 1/mm^2; P = phi A / J^2.
    - `nodes`: (ni, nj), at least 5 each; accuracy, not roads: the map is defined everywhere.
    - `follow_sides`: whether the sides' spacing is carried into the interior by
      `winslow.boundary_controls`, to which phi and psi then add.
    - `phi_index`, `psi_index`: controls per index step, the form of the paper's numbers; they add
      to phi and psi. 0.03 on 51 nodes is 1.5 on the unit square.

    With a solver of closed lattices the grid is a ring, an O-grid: `left` and `right` are closed
    curves, `bottom` and `top` are both the straight cut between their beginnings, which leaves no
    trace in the result. nj is then the number of nodes around, each counted once, and controls at
    nodes have shape (ni - 2, nj), at eta = 0, 1/nj, ... It keeps to uniform spacings of its walls.

    With a solver of C-grids, whose `tail` is more than 0, `left` is a cut to a hole, the hole's
    wall and the cut again, as `fdjax.part.slit` has them; of the cut only the ends stay, and the
    grid is smooth across it. Controls at nodes have shape (ni - 1, nj - 2), from xi = 0 on; there
    those of one side of the cut must be the other's, turned round and of the other sign.

    Raises `InputError` for too few nodes, controls that are not finite and sides that do not meet.
    """

    sides: Sides
    spacings: Spacings = Spacings()
    phi: Float[Array, "..."] | float = 0.0
    psi: Float[Array, "..."] | float = 0.0
    p: Float[Array, "..."] | float = 0.0
    q: Float[Array, "..."] | float = 0.0
    nodes: tuple[int, int] = eqx.field(static=True, default=(41, 41))
    follow_sides: bool = eqx.field(static=True, default=False)
    solver: AbstractSolver = eqx.field(static=True, default=Multigrid())
    phi_index: Float[Array, "..."] | float = 0.0
    psi_index: Float[Array, "..."] | float = 0.0

    def __check_init__(self) -> None:
        if min(self.nodes) < 5:
            raise InputError(f"Elliptic: nodes are {self.nodes}; at least 5 each way are needed")
        named = {name: getattr(self, name) for name in _CONTROLS}
        arrays = jax.tree.leaves((self.sides, named))
        if any(isinstance(values, Tracer) for values in arrays):
            return
        for name, values in named.items():
            if not np.isfinite(values).all():
                raise InputError(f"Elliptic: {name} is not finite everywhere")
        sides = self.sides
        for one, other, meet in (
            ("bottom", "left", (sides.bottom.start, sides.left.start)),
            ("bottom", "right", (sides.bottom.end, sides.right.start)),
            ("top", "left", (sides.top.start, sides.left.end)),
            ("top", "right", (sides.top.end, sides.right.end)),
        ):
            gap = float(np.hypot(*(np.asarray(meet[0]) - np.asarray(meet[1]))))
            if not gap <= TOUCH:
                raise InputError(
                    f"Elliptic: {one} and {other} do not meet: they are {gap:g} mm apart"
                )

    def problem(self) -> tuple[Float[Array, "ni nj 2"], ControlFunctions]:
        """The transfinite lattice to start from and the controls per index step: for a solver."""
        require_float64()
        ni, nj = self.nodes
        seam = self.solver.seam
        if seam.closed:
            nj += 1
            around = np.arange(-1, nj) % (nj - 1) / (nj - 1)
        else:
            around = np.linspace(0, 1, nj)
        xi, eta = jnp.linspace(0, 1, ni)[:, None], jnp.asarray(around)[None]
        start = Transfinite(self.sides, self.spacings)(xi, eta)
        if seam.tail:
            start = seam.whole(jnp.concatenate([start[:1], start]))
        controls = ControlFunctions(
            jnp.asarray(self.phi / (ni - 1) + self.phi_index),
            jnp.asarray(self.psi / (nj - 1) + self.psi_index),
            jnp.asarray(self.p * float(ni - 1)),
            jnp.asarray(self.q * float(nj - 1)),
        )
        if self.follow_sides:
            side_phi, side_psi = winslow.boundary_controls(start)
            controls = controls._replace(phi=controls.phi + side_phi, psi=controls.psi + side_psi)
        return start, controls

    def solve(
        self, start: Float[Array, "ni nj 2"] | None = None
    ) -> tuple[Float[Array, "ni nj 2"], Report]:
        """Nodes of the solved grid, shape (ni, nj, 2), mm, and the solver's report.

        `start`: the solved nodes of a grid much like this one, as of a neighbouring layer, to begin
        with; they are moved as the sides have moved. The result and its derivative are those of a
        cold start, to the solver's tolerance. Near starts save most of Newton's steps, and few of
        multigrid's cycles, whose cold start is good already. Raises `InputError` for a start of
        another shape.
        """
        cold, controls = self.problem()
        if start is None:
            return solve(self.solver, cold, controls)
        if self.solver.seam.tail:
            raise InputError("grid: a C-grid is solved from its transfinite lattice only")
        if start.shape != cold.shape:
            raise InputError(f"grid: start has shape {start.shape}; the nodes have {cold.shape}")
        moved = start + between_walls(cold - start)
        inside = cold.at[1:-1, 1:-1].set(moved[1:-1, 1:-1])
        return solve(self.solver, inside, controls, warm=True)

    def map(self, start: Float[Array, "ni nj 2"] | None = None) -> tuple[NodeMap, Report]:
        """The solved grid as a map of the unit square, and the solver's report.

        `start`: as for `solve`.
        """
        nodes, report = self.solve(start)
        seam, sides = self.solver.seam, self.sides
        if seam.closed:
            nodes = nodes[:, 1:-1]
        if seam.tail:
            nodes = nodes[1:]
            sides = sides._replace(left=_with_cut(sides.left, nodes[0], seam.tail))
        made = NodeMap.through(nodes, sides, self.spacings, closed=seam.closed, tail=seam.tail)
        return made, report


def _with_cut(left: Curve, nodes: Float[Array, "nj 2"], tail: int) -> Curve:
    """The side xi = 0 of a C-grid, its cut smooth through the nodes."""
    run = np.linspace(0, 1, len(nodes))
    ends = nodes[: tail + 1], nodes[len(nodes) - tail - 1 :]
    before, after = (bspline.pieces(each, run[1]) for each in ends)
    breaks: Any = jnp.concatenate([run[:tail], jnp.asarray(left.breaks)[1:-1], run[-tail:]])
    pieces: Any = jnp.concatenate([before, jnp.asarray(left.coefficients)[1:-1], after])
    return Curve(breaks, pieces, corners=True)
