"""Lines of a map of the unit square: what a user says of them, and how they begin."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import numpy as np

from fdjax.errors import InputError
from fdjax.grid.continuation import Continuation
from fdjax.grid.solvers import SOR, AbstractSolver, Multigrid, Newton
from fdjax.grid.spacing import fit_log_density
from fdjax.keys import FLAG, POINT, choice, choices, key, number, pair, whole
from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.pattern.base import AbstractSettings, mode_key, phases_key, road_width_key
from fdjax.pattern.embedding import EMBEDDED, Wanted, embed
from fdjax.pattern.grid_controls import Controls
from fdjax.pattern.grid_lines import GridLines, comb_of
from fdjax.pattern.line_counts import Start, begin
from fdjax.pattern.map_domain import Domain, domain_of
from fdjax.pattern.maps import CLOSED, MAPS, SLIT, STRETCHINGS, solved_once
from fdjax.pattern.width import free_of
from fdjax.programs import program
from fdjax.road.bead import section_area
from fdjax.road.holes import Holes
from fdjax.road.porosity import KEPT, Samples, equal_edges, whole_lines
from fdjax.road.stacking import Stacking
from fdjax.target.target import Target

SOLVERS: dict[str, AbstractSolver] = {
    "newton": Continuation(Newton()),
    "multigrid": Multigrid(),
    "sor": SOR(),
}
"""The elliptic solvers by name."""

_MAP_CONTROLS = {
    "uniform": ("spacing", "spacing_field"),
    "stretched": ("stretching",),
    "two-boundary": ("spacing",),
    "transfinite": ("spacing", "spacing_field"),
    "elliptic": ("spacing", "spacing_field", "phi", "psi"),
    "polar": ("spacing", "spacing_field"),
    "conformal": ("spacing", "spacing_field"),
    "o-transfinite": ("spacing", "spacing_field"),
    "o-elliptic": ("spacing", "spacing_field", "phi", "psi"),
    "o-conformal": ("spacing", "spacing_field"),
    "c-elliptic": ("spacing", "spacing_field", "phi", "psi"),
}

ALONG_AXES = ("uniform", "conformal", *CLOSED, *SLIT)
"""Maps whose `spacing` is one along each axis, and not one along each side."""

FIELD = (16, 24), (12, 5)
"""Most coefficients of a spacing field along its lines' own axis, and across them: xi lines along
xi at places of eta, eta lines along eta at places of xi."""

PLAY = {"play": 0.45}
"""What `begin` is asked for where lines are spaced by fields: room for both families."""

INSIDE = 0.4
"""Share of the material in the middle of a disc that eta lines bring; the rest xi lines do."""

FEWEST = 17
"""Nodes along eta that a C-grid needs at least, for both sides of its cut and the hole between."""

HALVED = 8
"""The eta lines of a disc are a multiple of this, so that every second one can end three times."""


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
        "stretched: alpha of eq. (1) and of tanh; 0.5 draws lines to both ends, 0 to the last",
        default=[0.5, 0.5],
    )
    stretching: tuple[str, str] = key(
        pair(choice(*STRETCHINGS)),
        "stretched: along x and y: eq. (1), a hyperbolic tangent, or steps that grow by one ratio",
        default=["roberts", "roberts"],
    )
    strength: tuple[float, float] = key(
        pair(number(-20, 20)),
        "stretched: of tanh its delta, over 0; of geometric the logarithm of last to first step",
        default=[1.5, 1.5],
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
        choices(
            "spacing", "spacing_field", "stretching", "phi", "psi", "width", "width_field", least=0
        ),
        "what the design may change; nothing with `[]`", default=["spacing"], table="design",
    )  # fmt: skip
    spiral: bool = key(
        FLAG, "rings: xi lines as one spiral on each layer, and not as circles", default=False
    )
    cut: tuple[float, float] | None = key(
        POINT, "C-grids: where on the outline the cut to the hole begins, mm", default=None,
        shown="nearest to the hole",
    )  # fmt: skip
    embedded: tuple[Wanted, ...] = key(
        EMBEDDED, "zones in which each cell of the lines is divided, in turn; `auto`: where the "
        "target asks for it", default=[],
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name in ("phi", "psi"):
            if getattr(self, name) != 0 and getattr(self, f"{name}_index") is not None:
                raise InputError(f"give {name} or {name}_index, not both")
        if min(self.beta) <= 1:
            raise InputError("beta: both must be more than 1")
        for name, strength in zip(self.stretching, self.strengths, strict=True):
            if not strength > STRETCHINGS[name].least:
                raise InputError(f"strength: of {name} it must be more than 0")
        if not set(self.alpha) <= {0.0, 0.5}:
            raise InputError("alpha: each must be 0 or 0.5")
        if self.map not in MAPS:
            raise InputError(f'map: "{self.map}" is not one of {", ".join(MAPS)}')
        for name in self.controls:
            if not name.startswith("width") and name not in _MAP_CONTROLS[self.map]:
                has = ", ".join((*_MAP_CONTROLS[self.map], "width", "width_field"))
                raise InputError(f'controls: map "{self.map}" has no "{name}"; it has {has}')
        for name in ("width", "spacing"):
            if name in self.controls and f"{name}_field" in self.controls:
                raise InputError(f"controls: {name} and {name}_field exclude each other")
        if self.spiral and self.map not in CLOSED:
            raise InputError(f'spiral: map "{self.map}" has no closed lines')
        if self.map in (*CLOSED, *SLIT) and self.solver != "newton":
            raise InputError(f'solver: map "{self.map}" is solved by "newton" only')
        if self.embedded and self.spiral:
            raise InputError("embedded: a spiral has no cells; leave spiral or embedded out")
        if self.embedded and self.map in SLIT:
            raise InputError(f'embedded: map "{self.map}" is cut open; no zone can cross the cut')
        if self.map in SLIT and self.nodes[1] < FEWEST:
            raise InputError(
                f'nodes: map "{self.map}" needs at least {FEWEST} along eta, not {self.nodes[1]}'
            )
        if self.cut is not None and self.map not in SLIT:
            raise InputError(f'cut: map "{self.map}" has none; {" and ".join(SLIT)} have')

    @property
    def corrections(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Rays of a disc and fine lines end where a plan has them, which a model knows roughly."""
        return 2 if (self.map == "polar" or self.embedded) and self.controls else 0

    @property
    def cells_first(self) -> bool:
        return self.map == "elliptic"

    @property
    def strengths(self) -> tuple[float, float]:
        """Of the stretchings along x and y: beta of eq. (1), `strength` of others."""
        return _pair(
            beta if name == "roberts" else strength
            for name, beta, strength in zip(self.stretching, self.beta, self.strength, strict=True)
        )

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
        domain = domain_of(
            self.map, part, target, self.road_width, cut=self.cut, steps=self.nodes[1] - 1
        )

        def base(asked: Callable[[Any, Any], Any]) -> GridLines:
            return self._begun(domain, part, asked, limits, window)

        if not self.embedded:
            return base(target)
        if domain.disc:
            raise InputError(
                "embedded: a disc has no cells in its middle, where rays end by halves; give the "
                "part a hole, or leave embedded out"
            )
        return embed(self.embedded, base, target, domain.covered, limits, window)

    def _begun(
        self,
        domain: Domain,
        part: Part,
        target: Callable[[Any, Any], Any],
        limits: Limits,
        window: float,
    ) -> GridLines:
        """The pattern without anything embedded, for a porosity `target(x, y)`."""
        height = part.slabs[0].height
        stacking = self.stacking(len(part.slabs))
        play = PLAY if "spacing_field" in self.controls else {}
        apart = self._apart(domain, target, stacking, height) if domain.disc else None
        if apart is not None:
            play = {**play, "densest": KEPT / apart}
        start = begin(
            domain.sides,
            target,
            height=height,
            width=self.road_width,
            stacking=stacking,
            limits=limits,
            lines=self.lines,
            window=window,
            **play,
        )
        if domain.disc and self.lines is None:
            whole = HALVED * stacking.phases
            rays = max(1, round(start.comb[1] / whole)) * whole
            start = replace(start, comb=(start.comb[0], rays))
        if domain.tail is not None:
            # As many xi lines on each layer, so that those of both sides of the cut go together.
            phases = stacking.phases
            start = replace(
                start, comb=(max(1, round(start.comb[0] / phases)) * phases, start.comb[1])
            )
        first = self._first(start, domain, limits, window)
        samples = _samples(first, start, domain.lengths, window)
        phi, psi = self.phi_psi
        pattern = GridLines(
            sides=domain.sides,
            comb=comb_of(start.comb),
            width=start.width,
            width_range=limits.road_width,
            height=height,
            first=first,
            samples=samples,
            holes=Holes.of(domain.cut_out, width=start.width, resolution=window / 8),
            phi=phi,
            psi=psi,
            p=self.p,
            q=self.q,
            stretching=self.stretching,
            strength=self.strengths,
            alpha=self.alpha,
            skew_limit=jax.device_put(np.full([len(each.places) for each in samples], 0.9)),
            counts_fixed=self.lines is not None,
            kind=self.map,
            stacking=stacking,
            nodes=self.nodes,
            solver=self._solver(domain),
            base=domain.base,
            apart=apart,
            tail=domain.tail,
            spiral=self.spiral,
            notes=domain.notes,
        )
        pattern = solved_once(pattern)
        # No more skewed than the grid that the outline itself gives.
        skew = np.maximum(pattern.skew_limit, 1.02 * np.asarray(_skew(pattern)))
        return eqx.tree_at(lambda p: p.skew_limit, pattern, jax.device_put(skew))

    def _solver(self, domain: Domain) -> AbstractSolver:
        if domain.tail is not None:
            return Continuation(Newton(tail=round(domain.tail * (self.nodes[1] - 1))))
        return Continuation(Newton(closed=True)) if domain.closed else SOLVERS[self.solver]

    def _apart(
        self,
        domain: Domain,
        target: Callable[[Any, Any], Any],
        stacking: Stacking,
        height: float,
    ) -> float:
        """How near eta lines come to each other in the middle of a disc, mm.

        So that they bring `INSIDE` of the material that is asked there, or as near as roads can.
        """
        x, y = domain.sides.left.polyline()[:-1].mean(0)
        solid = 1 - float(np.asarray(target(x, y)))
        width = self.road_width
        lines = KEPT * stacking.layer_share("eta") * float(section_area(width, height)) / height
        return max(width, lines / (INSIDE * max(solid, 1e-6)))

    def _first(self, start: Start, domain: Domain, limits: Limits, window: float) -> Controls:
        """The controls to start from; those not asked for are None."""
        controls, knots = self.controls, self.knots
        if knots is None:
            # As many as windows can tell apart and, where a solver has to follow, its nodes.
            knots = int(np.ceil(max(domain.lengths) / (0.75 * window))) + 3
            most = max(8, min(self.nodes) // 2) if self.map == "elliptic" else 32
            knots = int(np.clip(knots, 8, most))
        along = [fit_log_density(d, knots) for d in start.density]
        width = free_of(start.width, *limits.road_width)
        widths = {"width": np.asarray(width), "width_field": np.full(self.field_knots, width)}
        wanted = {name: widths[name] for name in controls if name in widths}
        on_axes = self.map in ALONG_AXES
        on_sides = "spacing" in controls and not on_axes
        in_field = "spacing_field" in controls or ("spacing" in controls and on_axes)
        first: dict[str, Any] = {
            "spacing": np.stack(along * 2) if on_sides else None,
            "crowding": self._crowding(start, domain, window) if in_field else None,
            "stretching": self._free_stretching() if "stretching" in controls else None,
            "phi": np.zeros(self.field_knots) if "phi" in controls else None,
            "psi": np.zeros(self.field_knots) if "psi" in controls else None,
            "width": next(iter(wanted.values()), None),
        }
        # Of one type from the start, so that what an optimiser returns does not compile anew.
        own = jax.tree.map(lambda values: np.asarray(values, float), Controls(**first))
        return jax.device_put(own)

    def _free_stretching(self) -> Any:
        each = zip(self.stretching, self.strengths, strict=True)
        return np.asarray([STRETCHINGS[name].free(strength) for name, strength in each])

    def _crowding(self, start: Start, domain: Domain, window: float) -> tuple[Any, Any]:
        """Log densities of both families: along their own axis, and, as a field, across it."""
        found = []
        for k, (most, rows) in enumerate(zip(*FIELD, strict=True)):
            closed = domain.closed and k == 1
            wanted = int(np.ceil(domain.lengths[k] / (0.75 * window))) + 3
            own = fit_log_density(
                start.density[k], self.knots or int(np.clip(wanted, 8, most)), closed=closed
            )
            rows = rows if "spacing_field" in self.controls else 1
            found.append(np.tile(own - own.mean(), (rows, 1)))
        return found[0], found[1]


@program
def _skew(pattern: GridLines) -> Any:
    return pattern.skew(pattern.realise(pattern.first))


def _pair(values: Iterable[float]) -> tuple[float, float]:
    first, second = values
    return first, second


def _samples(
    first: Controls, start: Start, lengths: tuple[float, float], window: float
) -> tuple[Samples, Samples]:
    """Samples about a fifth of a window apart, where the design starts."""
    spaced = first.spacing is not None or first.crowding is not None
    samples = []
    for length, density, comb in zip(lengths, start.density, start.comb, strict=True):
        count = int(np.clip(np.ceil(5 * length / window), 16, 160))
        lines = np.cumsum(density) - (density + density[0]) / 2
        share = lines / lines[-1] if spaced else np.linspace(0, 1, len(lines))
        edges = whole_lines(equal_edges(partial(_place, share), count), comb)
        # Where lines are further apart than that, samples between them too.
        pieces = 2 * int(count / len(edges) / 2 + 0.25) + 1
        samples.append(Samples.between(edges, pieces))
    return samples[0], samples[1]


def _place(share: Any, t: Any) -> Any:
    """Where along a side the share t of all lines is reached, given it at equal steps."""
    return np.interp(t, share, np.linspace(0, 1, len(share)))
