"""Builds for the tests of the formats, and how two builds are compared."""

import numpy as np
from hypothesis import strategies as st
from shapely import MultiPolygon, Polygon

from fdjax.plan.toolpath import Build, Layer, Road

RING = Polygon(
    [(0, 0), (40, 0), (40, 30), (1 / 3, 30.1)], [[(10, 10), (20, 10), (20, 20), (10, 20)]]
)
INNER = Polygon([(0.25, 0.25), (39.75, 0.25), (39.75, 29.75), (0.6, 29.85)])
ISLANDS = MultiPolygon(
    [RING, Polygon([(12, 12), (18, 12), (15 + 1 / 7, 18)]), Polygon([(50, 0), (51, 0), (50, 1e-3)])]
)
"""A ring, an island in its hole and a sliver beside it."""


def small_build(materials: int = 1) -> Build:
    """Two layers with an open, a touching, a closed and a graded road; outlines that differ."""
    open_road = Road([(0.1, 0.2), (20, 0.2), (20, 5)], 0.5, family="xi")
    touching = Road([(20, 5), (0.1, 5)], 0.45, family="eta")
    ring = Road([(2, 8), (12, 8), (12, 18), (2, 18)], 0.6, materials - 1, closed=True)
    x = np.linspace(0, 30, 16)
    graded = Road(np.stack([x, 20 + np.sin(x / 5)], 1), np.linspace(0.4, 0.8, 15), family="xi")
    layers = (
        Layer(0.254, 0.254, (open_road, touching, ring), RING),
        Layer(0.508, 0.254, (graded, ring, open_road), INNER),
    )
    return Build(layers, name="small part", origin=(50.0, 60.5), notes={"target": "0.2 + x/80"})


_coordinate = st.floats(0, 100)


@st.composite
def roads(draw: st.DrawFn, start: tuple[float, float] | None, materials: int) -> Road:
    points = draw(st.lists(st.tuples(_coordinate, _coordinate), min_size=2, max_size=12))
    if start is not None:
        points[0] = start
    closed = draw(st.booleans())
    segments = len(points) - (not closed)
    width = st.floats(0.36, 1.0)
    widths = draw(st.one_of(width, st.lists(width, min_size=segments, max_size=segments)))
    material = draw(st.integers(0, materials - 1))
    family = draw(st.sampled_from(["", "xi", "eta"]))
    return Road(points, widths, material, closed, family)


@st.composite
def builds(draw: st.DrawFn, materials: int = 2) -> Build:
    """One to three layers of random roads, some of which touch end to start."""
    layers, z = [], 0.0
    for _ in range(draw(st.integers(1, 3))):
        height = draw(st.floats(0.11, 0.4))
        z += height
        laid: list[Road] = []
        for _ in range(draw(st.integers(0, 4))):
            touches = laid and draw(st.booleans())
            start = tuple(laid[-1].path[-1].tolist()) if touches else None
            laid.append(draw(roads(start, materials)))
        layers.append(
            Layer(z, height, tuple(laid), draw(st.sampled_from([None, RING, INNER, ISLANDS])))
        )
    origin = draw(st.tuples(_coordinate, _coordinate))
    text = st.text(max_size=200)
    notes = draw(st.dictionaries(st.sampled_from(["target", "a.b", "x_1"]), text, max_size=3))
    return Build(tuple(layers), name=draw(text) or "part", origin=origin, notes=notes)


def pairs(a: Build, b: Build) -> list[tuple[Road, Road, float]]:
    """Roads of the two builds side by side, with the layer's height; all else must be equal."""
    assert (a.name, a.origin, dict(a.notes)) == (b.name, b.origin, dict(b.notes))
    assert [len(layer.roads) for layer in a.layers] == [len(layer.roads) for layer in b.layers]
    result = []
    for p, q in zip(a.layers, b.layers, strict=True):
        assert (p.z, p.height) == (q.z, q.height)
        assert (p.outline is None) == (q.outline is None)
        assert p.outline is None or p.outline.equals_exact(q.outline, 0.0)
        result += [(r, s, p.height) for r, s in zip(p.roads, q.roads, strict=True)]
    for r, s, _ in result:
        assert (r.material, r.closed, r.family) == (s.material, s.closed, s.family)
        np.testing.assert_array_equal(r.xy, s.xy)
    return result
