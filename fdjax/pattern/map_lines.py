"""Lines of a map of the unit square: what a user says of them, and how they begin."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from fdjax.errors import InputError
from fdjax.grid.base import Sides
from fdjax.grid.continuation import Continuation
from fdjax.grid.solvers import SOR, AbstractSolver, Multigrid, Newton
from fdjax.grid.spacing import fit_log_density
from fdjax.keys import choice, choices, key, number, pair, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.part.patch import Patch, from_polygon
from fdjax.pattern.base import AbstractSettings, mode_key, phases_key, road_width_key
from fdjax.pattern.grid_lines import Controls, GridLines, comb_of
from fdjax.pattern.line_counts import Start, begin
from fdjax.pattern.maps import MAPS
from fdjax.pattern.width import free_of
from fdjax.road.holes import Holes
from fdjax.road.porosity import Samples, equal_edges, whole_lines
from fdjax.target.target import Target

SOLVERS: dict[str, AbstractSolver] = {
    "newton": Continuation(Newton()),
    "multigrid": Multigrid(),
    "sor": SOR(),
}
"""The elliptic solvers by name."""

_MAP_CONTROLS = {
    "uniform": (),
    "stretched": ("stretching",),
    "two-boundary": ("spacing",),
    "transfinite": ("spacing",),
    "elliptic": ("spacing", "phi", "psi"),
}


@dataclass(frozen=True)
class MapLines(AbstractSettings):
    """Lines of constant xi and of constant eta of a map of the unit square, side to side.

    For parts that have four sides and one region. Lengths in mm; see the job's keys for what each
    value means. Raises `InputError` for controls that the map has not.
    """

    map: str = key(choice(*MAPS), "map of the unit square into the outline", default="transfinite")
    mode: str = mode_key()
    phases: int = phases_key()
    road_width: float = road_width_key()
    lines: tuple[int, int] | None = key(
        pair(whole(1, 10000)), "number of xi lines and of eta lines", default=None, shown="chosen"
    )
    nodes: tuple[int, int] = key(
        pair(whole(5, 1025)), "nodes of the elliptic solver along xi and eta", default=[33, 33]
    )
    beta: tuple[float, float] = key(
        pair(number(1)),
        "stretched: beta of eq. (1) along x and y, over 1; the nearer to 1, the stronger",
        default=[1.1, 1.1],
    )
    alpha: tuple[float, float] = key(
        pair(number(0, 0.5)),
        "stretched: alpha of eq. (1); 0.5 draws lines to both ends, 0 to the last",
        default=[0.5, 0.5],
    )
    phi: float = key(number(-1000, 1000), "elliptic: control along xi, unit square", default=0.0)
    psi: float = key(number(-1000, 1000), "elliptic: control along eta, unit square", default=0.0)
    phi_index: float | None = key(
        number(-10, 10), "phi per index step of `nodes`, as in the paper", default=None, shown="-"
    )
    psi_index: float | None = key(
        number(-10, 10), "psi per index step of `nodes`, as in the paper", default=None, shown="-"
    )
    p: float = key(
        number(-np.inf), "elliptic: P of eq. (5), lap(xi), unit square, 1/mm^2", default=0.0
    )
    q: float = key(
        number(-np.inf), "elliptic: Q of eq. (5), lap(eta), unit square, 1/mm^2", default=0.0
    )
    solver: str = key(
        choice(*SOLVERS),
        "elliptic: multigrid from about 100 nodes a side; `sor` is the paper's, at w = 1.8",
        default="newton",
    )
    knots: int | None = key(
        whole(4, 64), "spline coefficients of each side's spacing", default=None,
        shown="by window", table="design",
    )  # fmt: skip
    field_knots: tuple[int, int] = key(
        pair(whole(4, 64)), "spline coefficients of a field along xi and eta", default=[8, 6],
        table="design",
    )  # fmt: skip
    controls: tuple[str, ...] = key(
        choices("spacing", "stretching", "phi", "psi", "width", "width_field", least=0),
        "what the design may change; nothing with `[]`", default=["spacing"], table="design",
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name in ("phi", "psi"):
            if getattr(self, name) != 0 and getattr(self, f"{name}_index") is not None:
                raise InputError(f"give {name} or {name}_index, not both")
        if min(self.beta) <= 1:
            raise InputError("beta: both must be more than 1")
        if not set(self.alpha) <= {0.0, 0.5}:
            raise InputError("alpha: each must be 0 or 0.5")
        if self.map not in MAPS:
            raise InputError(f'map: "{self.map}" is not one of {", ".join(MAPS)}')
        for name in self.controls:
            if not name.startswith("width") and name not in _MAP_CONTROLS[self.map]:
                has = ", ".join((*_MAP_CONTROLS[self.map], "width", "width_field"))
                raise InputError(f'controls: map "{self.map}" has no "{name}"; it has {has}')
        if "width" in self.controls and "width_field" in self.controls:
            raise InputError("controls: width and width_field exclude each other")

    @property
    def cells_first(self) -> bool:
        return self.map == "elliptic"

    @property
    def phi_psi(self) -> tuple[float, float]:
        """phi and psi of the unit square, however they were given."""
        phi = self.phi if self.phi_index is None else self.phi_index * (self.nodes[0] - 1)
        psi = self.psi if self.psi_index is None else self.psi_index * (self.nodes[1] - 1)
        return phi, psi

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> GridLines:
        """Line counts, road width and spacings of the sides as the target asks.

        Raises `InputError` for a part of several regions, a target that varies along z, and one
        beyond what spacing and span allow.
        """
        patch = _patch_of(part, target)
        height = part.slabs[0].height
        stacking = self.stacking(len(part.slabs))
        sides = Sides.of(patch)
        start = begin(
            sides,
            target,
            height=height,
            width=self.road_width,
            stacking=stacking,
            limits=limits,
            lines=self.lines,
            window=window,
        )
        first = self._first(start, patch, limits, window)
        samples = _samples(first, start, patch, window)
        phi, psi = self.phi_psi
        pattern = GridLines(
            sides=sides,
            comb=comb_of(start.comb),
            width=start.width,
            width_range=limits.road_width,
            height=height,
            first=first,
            samples=samples,
            holes=Holes.of(patch.outline, width=start.width, resolution=window / 8),
            phi=phi,
            psi=psi,
            p=self.p,
            q=self.q,
            beta=self.beta,
            alpha=self.alpha,
            skew_limit=jnp.full([len(each.places) for each in samples], 0.9, jnp.float64),
            counts_fixed=self.lines is not None,
            kind=self.map,
            stacking=stacking,
            nodes=self.nodes,
            solver=SOLVERS[self.solver],
        )
        # No more skewed than the grid that the outline itself gives.
        skew = jnp.maximum(pattern.skew_limit, 1.02 * _skew(pattern))
        return eqx.tree_at(lambda p: p.skew_limit, pattern, skew)

    def _first(self, start: Start, patch: Patch, limits: Limits, window: float) -> Controls:
        """The controls to start from; those not asked for are None."""
        controls, knots = self.controls, self.knots
        if knots is None:
            # As many as windows can tell apart and, where a solver has to follow, its nodes.
            knots = int(np.ceil(max(_lengths(patch)) / (0.75 * window))) + 3
            most = max(8, min(self.nodes) // 2) if self.map == "elliptic" else 32
            knots = int(np.clip(knots, 8, most))
        along_xi, along_eta = (jnp.asarray(fit_log_density(d, knots)) for d in start.density)
        width = free_of(start.width, *limits.road_width)
        widths = {"width": jnp.asarray(width), "width_field": jnp.full(self.field_knots, width)}
        wanted = {name: widths[name] for name in controls if name in widths}
        return Controls(
            spacing=jnp.stack([along_xi, along_eta] * 2) if "spacing" in controls else None,
            stretching=(jnp.log(jnp.asarray(self.beta) - 1) if "stretching" in controls else None),
            phi=jnp.zeros(self.field_knots) if "phi" in controls else None,
            psi=jnp.zeros(self.field_knots) if "psi" in controls else None,
            width=next(iter(wanted.values()), None),
        )


@eqx.filter_jit
def _skew(pattern: GridLines) -> Any:
    return pattern.skew(pattern.realise(pattern.first))


def _patch_of(part: Part, target: Target) -> Patch:
    """The four sides of the part's one region."""
    need = 'lines of a map need four sides on all layers; use pattern kind "isolines"'
    if target.varies_in_z:
        raise InputError(f"target: varies along z; {need}")
    heights = {slab.height for slab in part.slabs}
    polygon, *more = part.slabs[0].region.polygons
    if len(part.regions) > 1 or len(heights) > 1 or more:
        raise InputError(f"part: its layers differ, or hold several polygons; {need}")
    return part.patch or from_polygon(polygon)


def _lengths(patch: Patch) -> tuple[float, float]:
    """Length of the longer of bottom and top, and of left and right, mm."""

    def length(side: Any) -> float:
        return float(np.hypot(*np.diff(side.polyline(), axis=0).T).sum())

    return max(map(length, (patch.bottom, patch.top))), max(map(length, (patch.left, patch.right)))


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
