"""Where the meshes of a pattern come from: made for the target, given, or drawn in a chart."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import shapely

from fdjax.errors import InputError
from fdjax.grid.algebraic import Cartesian, Transfinite, TwoBoundary
from fdjax.grid.base import AbstractGridMap
from fdjax.keys import FILE, UNIT, Kind, Place, points, show
from fdjax.mesh.files import read_mesh
from fdjax.mesh.given import Given, fringed, lattice, twice_areas
from fdjax.mesh.triangulation import Triangulation
from fdjax.part.part import Part
from fdjax.pattern.map_domain import Domain, domain_of
from fdjax.pattern.mesh_sizes import LENGTH, Stack, mean_solid
from fdjax.precision import require_float64
from fdjax.road.bead import SECTIONS
from fdjax.target.target import Target
from fdjax.units import length

Floats = np.ndarray[Any, np.dtype[np.float64]]

_KNOWN = {"file", "unit", "nodes", "triangles", "quads"}


def _mesh(value: Any, place: Place) -> Given:
    """One mesh as a job says it."""
    if isinstance(value, str):
        return _read(value, "mm", place)
    if not isinstance(value, dict) or set(value) - _KNOWN:
        raise place.error(f"{show(value)} is no mesh; a file, or a table of {', '.join(_KNOWN)}")
    if "file" in value:
        if set(value) - {"file", "unit"}:
            raise place.error("give a file, or nodes and elements, not both")
        return _read(value["file"], UNIT.read(value.get("unit", "mm"), place.at(".unit")), place)
    nodes = points(3).read(value.get("nodes"), place.at(".nodes"))
    return Given.of(nodes, value.get("triangles", ()), value.get("quads", ()), name=place.where)


def _read(value: Any, unit: str, place: Place) -> Given:
    return read_mesh(FILE.read(value, place), unit=length(f"1{unit}", place.where))


def _meshes(value: Any, place: Place) -> tuple[Given, ...]:
    some = value if isinstance(value, list | tuple) else [value]
    if not some:
        raise place.error("is empty; give a file or a list of them")
    # From Python meshes may come as they are.
    return tuple(
        each
        if isinstance(each, Given)
        else _mesh(each, place.at(f"[{k}]" if value is some else ""))
        for k, each in enumerate(some)
    )


MESHES = Kind("mesh file, {file, unit}, {nodes, triangles, quads}, or a list of these", _meshes)


class Begun(NamedTuple):
    """A mesh as a design begins with it, and the size of the cells around each node, mm."""

    mesh: Triangulation
    size: Floats


def of_given(given: tuple[Given, ...], chart: "Chart | None") -> list[Begun]:
    """Meshes that are given, drawn through a chart where there is one.

    Raises `InputError` for nodes beyond the unit square of a chart, and triangles that fold in it.
    """
    return [_begun(each.mesh if chart is None else chart.drawn(each.mesh)) for each in given]


def of_quads(chart: "Chart", counts: tuple[int, int], diagonal: str, phases: int) -> list[Begun]:
    """Split quads of a chart, moved along both axes from phase to phase."""
    return [chart.quads(counts, diagonal, k / phases) for k in range(phases)]


def _begun(mesh: Triangulation) -> Begun:
    return Begun(fringed(mesh), _sizes(fringed(mesh)))


def _sizes(mesh: Triangulation) -> Floats:
    """Mean length of the sides at each node, mm."""
    length = np.hypot(*(mesh.xy[mesh.edges[:, 1]] - mesh.xy[mesh.edges[:, 0]]).T)
    ends = mesh.edges.ravel()
    count = np.bincount(ends, minlength=len(mesh.xy))
    return np.bincount(ends, np.repeat(length, 2), len(mesh.xy)) / np.maximum(count, 1)


@dataclass(frozen=True, eq=False)
class Chart:
    """A map of the unit square into a part.

    - `kind`: its name; `grid`: the map; `domain`: what it is of.
    """

    kind: str
    grid: AbstractGridMap
    domain: Domain

    @classmethod
    def of(cls, kind: str, part: Part, target: Target, width: float) -> "Chart":
        """Raises `InputError` for a part that such a map cannot be of."""
        require_float64()
        domain = domain_of(kind, part, target, width)
        if domain.disc:
            raise InputError('through: "polar" needs a ring; the quads of a disc have no sides')
        return cls(kind, CHARTS[kind](domain), domain)

    def at(self, xy: Floats) -> Floats:
        """Places of the part, (n, 2), mm, of places of the plane of the chart.

        Beyond the square's sides what is inside is turned about the nearest place of the side.
        """
        low, high = np.zeros(2), np.ones(2)
        if self.domain.closed:
            xy = np.stack([xy[:, 0], xy[:, 1] % 1], 1)
        held = np.clip(xy, low, high)
        back = 2 * held - xy
        outside = xy != held

        def along(eta: Floats) -> Floats:
            """The extension along xi, at an eta within."""
            own = np.where(outside[:, 0], back[:, 0], xy[:, 0])
            inner = self._inside(own, eta)
            return np.where(outside[:, :1], 2 * self._inside(held[:, 0], eta) - inner, inner)

        inner = along(np.where(outside[:, 1], back[:, 1], xy[:, 1]))
        return np.where(outside[:, 1:], 2 * along(held[:, 1]) - inner, inner)

    def _inside(self, xi: Floats, eta: Floats) -> Floats:
        return np.asarray(self.grid(jnp.asarray(xi), jnp.asarray(eta)))

    def drawn(self, mesh: Triangulation) -> Triangulation:
        """A mesh of the unit square in the part."""
        beyond = (mesh.xy < -1e-9) | (mesh.xy > 1 + 1e-9)
        if beyond.any():
            x, y = mesh.xy[np.argmax(beyond.any(1))]
            raise InputError(
                f"mesh: its node ({x:.4g}, {y:.4g}) lies beyond the unit square, whose map "
                f'"{self.kind}" is'
            )
        drawn = Triangulation(self.at(np.clip(mesh.xy, 0, 1)), mesh.triangles)
        self._check(drawn, np.ones(len(mesh.triangles), bool))
        return Given.of(drawn.xy, drawn.triangles).mesh if self.domain.closed else drawn

    def quads(self, counts: tuple[int, int], diagonal: str, phase: float) -> Begun:
        """So many quads along xi and eta, split, with more of them beyond the walls."""
        square = lattice(counts, diagonal, beyond=1)
        moved = square.xy + phase / np.array(counts)
        inside = ((moved >= 0) & (moved <= 1))[square.triangles].all((1, 2))
        kept = np.ones(len(square.triangles), bool)
        if self.domain.closed:
            around = square.xy[square.triangles][..., 1].mean(1)
            kept = (around > 0) & (around < 1)
        drawn = Triangulation(self.at(moved), square.triangles)
        self._check(drawn, kept & inside)
        made = drawn.part(kept & (twice_areas(drawn.xy, drawn.triangles) > 0))
        if self.domain.closed:
            # The last row around is the first.
            made = Given.of(made.xy, made.triangles).mesh
        return Begun(made, _sizes(made))

    def _check(self, mesh: Triangulation, looked_at: Any) -> None:
        folded = (twice_areas(mesh.xy, mesh.triangles) <= 0) & looked_at
        if folded.any():
            x, y = mesh.xy[mesh.triangles[np.argmax(folded)]].mean(0)
            raise InputError(
                f'mesh: the map "{self.kind}" folds at ({x:.4g}, {y:.4g}) mm, in '
                f"{folded.sum()} of {folded.size} triangles; take another map"
            )

    def counts(
        self, stacks: list[Stack], target: Target, width: float, count: str
    ) -> tuple[int, int]:
        """Quads along xi and along eta, about square, as fine as the mean of the target asks."""
        section = SECTIONS[count]
        held = asked = 0.0
        for stack in stacks:
            # Two sides and a diagonal a quad; of the duals nodes as many as triangles have.
            asked += mean_solid(target, stack) * stack.height
            held += sum(
                (LENGTH[kind] if kind != "triangles" else 2 + np.sqrt(2))
                * section(width, slab.height)
                for kind, slab in zip(stack.kinds, stack.slabs, strict=True)
            )
        side = held / asked
        ideal = np.array(self.domain.lengths) / side
        # The longer sides tell too much: how much longer the edges are, a first mesh says.
        mesh, _ = self.quads(_whole(ideal), "alternating", 0.0)
        region = stacks[0].region
        lines = shapely.linestrings(mesh.xy[mesh.edges])
        got = shapely.length(shapely.intersection(lines, region.inset(width / 2))).sum()
        return _whole(ideal * (2 + np.sqrt(2)) / side * region.geometry.area / got)


def _whole(counts: Floats) -> tuple[int, int]:
    xi, eta = (int(np.clip(round(count), 2, 2000)) for count in counts)
    return xi, eta


def _cartesian(domain: Domain) -> AbstractGridMap:
    corners = np.concatenate([side.polyline() for side in domain.sides])
    return Cartesian(jnp.asarray(corners.min(0)), jnp.asarray(corners.max(0)))


def _based(domain: Domain) -> AbstractGridMap:
    assert domain.base is not None
    return domain.base


CHARTS: dict[str, Callable[[Domain], AbstractGridMap]] = {
    "uniform": _cartesian,
    "two-boundary": lambda domain: TwoBoundary(domain.sides.bottom, domain.sides.top),
    "transfinite": lambda domain: Transfinite(domain.sides),
    "conformal": _based,
    "polar": _based,
    "o-conformal": _based,
    "o-transfinite": lambda domain: Transfinite(domain.sides),
}
"""Maps that meshes are drawn through, by name."""
