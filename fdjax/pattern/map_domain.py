"""What a map of the unit square is of: four sides, a ring or a disc."""

from dataclasses import dataclass
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from shapely import LinearRing, Point, Polygon

from fdjax.errors import InputError
from fdjax.grid import conformal, ring_chart
from fdjax.grid.base import AbstractGridMap, Sides
from fdjax.grid.polar import Polar
from fdjax.part.annulus import ROUND, Annulus, Circle, between_circles
from fdjax.part.part import Part
from fdjax.part.patch import Patch, from_polygon
from fdjax.part.slit import Slit
from fdjax.pattern.maps import CLOSED, SLIT
from fdjax.target.target import Target

VERTICES = 64
"""Most vertices of an outline that is mapped conformally, those of a hole with them."""

CONFORMAL = 1e-6
"""By what share of its size a conformal map may miss its vertices."""


@dataclass(frozen=True, eq=False)
class Domain:
    """What a map is of.

    - `sides`: on a ring `left` and `right` are closed, `bottom` and `top` both the cut.
    - `cut_out`: a polygon whose holes are cut out of the lines.
    - `closed`, `disc`, `base`, `tail`, `notes`: as of `GridLines`.
    """

    sides: Sides
    cut_out: Polygon
    closed: bool = False
    disc: bool = False
    base: AbstractGridMap | None = None
    tail: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def covered(self) -> Polygon:
        """What the map covers, less what is cut out."""
        if not self.closed or self.disc:
            return self.cut_out
        hole = LinearRing(self.sides.left.polyline())
        return Polygon(self.cut_out.exterior, [*self.cut_out.interiors, hole])

    @cached_property
    def lengths(self) -> tuple[float, float]:
        """Length of the longer of bottom and top, and of left and right, mm."""
        bottom, right, top, left = (side.length for side in self.sides)
        return max(bottom, top), max(left, right)


def domain_of(
    kind: str,
    part: Part,
    target: Target,
    road_width: float,
    *,
    cut: tuple[float, float] | None = None,
    steps: int = 64,
) -> Domain:
    """What a map of this kind is of. Raises `InputError` for a part that it cannot be of.

    `cut`, `steps`: of maps that are cut open, as of `Slit.of`.
    """
    polygon = polygon_of(part, target, "lines of a map need four sides on all layers")
    if kind == "conformal":
        return _conformal(part.patch or from_polygon(polygon))
    if kind in SLIT:
        slit = Slit.of(polygon, f'map "{kind}"', cut, steps=steps)
        sides = Sides(slit.bottom, slit.right, slit.top, slit.left)
        return Domain(sides, Polygon(polygon.exterior), tail=slit.tail)
    if kind not in CLOSED:
        patch = part.patch or from_polygon(polygon)
        return Domain(Sides.of(patch), patch.outline)
    if kind == "polar":
        return _polar(polygon, road_width)
    annulus = Annulus.of(polygon, f'map "{kind}"')
    if kind == "o-conformal":
        return _conformal_ring(polygon)
    return Domain(_sides_of(annulus), Polygon(polygon.exterior), closed=True)


def polygon_of(part: Part, target: Target, what: str) -> Polygon:
    """The part's one region; `what` says in an error what needs it."""
    need = f'{what}; use pattern kind "isolines"'
    if target.varies_in_z:
        raise InputError(f"target: varies along z; {need}")
    heights = {slab.height for slab in part.slabs}
    polygon, *more = part.slabs[0].region.polygons
    if len(part.regions) > 1 or len(heights) > 1 or more:
        raise InputError(f"part: its layers differ, or hold several polygons; {need}")
    return polygon


def _sides_of(annulus: Annulus) -> Sides:
    return Sides(annulus.cut, annulus.outline, annulus.cut, annulus.hole)


def _conformal(patch: Patch) -> Domain:
    """The conformal map of a polygon, its parameter problem solved."""
    sides = (patch.bottom, patch.right, patch.top.reversed(), patch.left.reversed())
    runs = [side.polyline()[:-1] for side in sides]
    vertices = np.concatenate(runs)
    if len(vertices) > VERTICES:
        raise InputError(
            f'part: its outline has {len(vertices)} vertices; map "conformal" takes at most '
            f'{VERTICES}: give fewer, or use map "elliptic"'
        )
    first = np.cumsum([0, *map(len, runs)]).tolist()
    base, error = conformal.chart(vertices, (first[0], first[1], first[2], first[3]))
    if not error < CONFORMAL:
        raise InputError(
            f"part: the conformal map of its outline is wrong by {error:.1g} of its size: it is "
            'too long or too thin for one; use map "elliptic" or pattern kind "isolines"'
        )
    return Domain(base.sides, patch.outline, base=base)


def _conformal_ring(polygon: Polygon) -> Domain:
    """The conformal map of a polygon with one hole, its parameter problem solved."""
    outer, inner = (
        np.asarray((ring if ring.is_ccw else ring.reverse()).coords)[:-1, :2]
        for ring in (polygon.exterior, polygon.interiors[0])
    )
    base, error, off = ring_chart.chart(outer, inner, VERTICES)
    if not error < CONFORMAL:
        raise InputError(
            f"part: the conformal map of its ring is wrong by {error:.1g} of its size: it is "
            'too thin or too long for one; use map "o-elliptic" or pattern kind "isolines"'
        )
    notes = ()
    if off > 0:
        count = len(outer) + len(inner)
        notes = (
            f"conformal is the map of polygons with {VERTICES} of the {count} vertices, at most, "
            f"up to {off:.2g} mm off the walls; it is bent to these",
        )
    return Domain(base.sides, Polygon(polygon.exterior), closed=True, base=base, notes=notes)


def _polar(polygon: Polygon, width: float) -> Domain:
    """A disc or a ring between two circles; other holes of a disc are cut out."""
    need = 'map "polar" needs a disc, or a ring between two circles about one centre'
    outer = Circle.of(polygon.exterior)
    if outer is None:
        raise InputError(f'part: its outline is no circle; {need}; "o-elliptic" takes any ring')
    holes = list(polygon.interiors)
    about = [k for k, hole in enumerate(holes) if Polygon(hole).contains(Point(outer.centre))]
    inner = Circle(outer.centre, width / 2)
    if about:
        (k,) = about
        found = Circle.of(holes.pop(k))
        if found is None or np.hypot(*(found.centre - outer.centre)) > ROUND * outer.radius:
            raise InputError(f"part: its hole is no circle about its centre; {need}")
        inner = Circle(outer.centre, found.radius)
    base = Polar(jnp.asarray(outer.centre), inner.radius, outer.radius)
    sides = _sides_of(between_circles(inner, outer))
    cut_out = Polygon(polygon.exterior, holes)
    return Domain(sides, cut_out, closed=True, disc=not about, base=base)
