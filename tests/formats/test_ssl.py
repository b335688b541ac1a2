import re

import numpy as np
import pytest
from format_samples import ISLANDS, RING, small_build
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point, Polygon

from fdjax.errors import InputError
from fdjax.formats import ssl
from fdjax.plan.toolpath import Build, Layer

SQUARE = "Slice V0\nFILE(a)\nUNITS(INCH)\nSLICES()\nZ 0.01 0.01\n0 0\n1 0\n1 1\n0 1\nC\nEND\n"


def test_the_text_is_the_public_form():
    square = Polygon([(0, 0), (0, 25.4), (25.4, 25.4), (25.4, 0)])
    text = ssl.write(Build((Layer(0.254, 0.254, (), square),), name="a"))
    lines = text.splitlines()
    assert lines[:5] == [
        "Slice V0",
        "FILE(a)",
        "UNITS(INCH)",
        "SLICES()",
        "Z 0.01000000 0.01000000",
    ]
    assert lines[-2:] == ["C", "END"]
    assert len(lines) == 11  # the first point is not repeated


@settings(max_examples=25, deadline=None)
@given(
    centre=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    radii=st.lists(st.floats(2, 30), min_size=1, max_size=3),
    holes=st.integers(0, 3),
)
def test_outlines_come_back(centre, radii, holes):
    layers = []
    for k, radius in enumerate(radii):
        disc = Point(centre).buffer(radius)
        for j in range(holes):
            disc = disc.difference(Point(centre[0] + radius * (j - 1) / 2, centre[1]).buffer(0.3))
        layers.append(Layer(0.2 * (k + 1), 0.2, (), disc))
    build = Build(tuple(layers), name="a part (2)")
    again = ssl.read(ssl.write(build))
    assert again.name == build.name
    for a, b in zip(build.layers, again.layers, strict=True):
        assert (b.z, b.height) == pytest.approx((a.z, a.height), abs=2e-7)
        assert b.roads == ()
        assert b.outline.symmetric_difference(a.outline).area < 1e-4
        assert len(b.outline.interiors) == len(a.outline.interiors)


def test_holes_are_told_by_nesting_not_by_order_or_turn():
    rings = [np.asarray(RING.interiors[0].coords)[::-1], np.asarray(RING.exterior.coords)]
    body = "".join(
        "".join(f"{x!r} {y!r}\n" for x, y in ring[:-1].tolist()) + "C\n" for ring in rings
    )
    text = f"Slice V0\nFILE()\nSLICES()\nZ .01 .01\n{body}END\n"
    assert ssl.read(text).layers[0].outline.area == pytest.approx(RING.area * 25.4**2)


def test_a_layer_may_be_empty():
    assert ssl.read("Slice V0\nSLICES()\nZ 1 1\nEND\n").layers[0].outline is None


def test_a_layer_without_outline_cannot_be_written():
    with pytest.raises(InputError, match="layer 1 has no outline"):
        ssl.write(Build((Layer(0.2, 0.2, ()),)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not SSL"),
        ("G1 X1\n", "not SSL"),
        (SQUARE.replace("END\n", ""), "line 10: the file is truncated"),
        (SQUARE[:60], "truncated|two numbers"),
        (SQUARE.replace("INCH", "MM"), "line 3: .*only UNITS"),
        (SQUARE.replace("1 1\n", "1 x\n"), "line 8: '1 x'; two numbers"),
        (SQUARE.replace("1 1\n", "1 nan\n"), "line 8: .*two numbers"),
        (SQUARE.replace("1 1\n", "1\n"), "line 8: .*two numbers"),
        (SQUARE.replace("C\n", "O\n"), "line 10: an open curve"),
        (SQUARE.replace("C\n", ""), "line 10: END inside a contour"),
        (SQUARE.replace("1 0\n1 1\n", "1 1\n1 0\n"), "line 10: the contour .* crosses itself"),
        (SQUARE.replace("1 1\n0 1\n", ""), "line 8: .* flat"),
        (SQUARE.replace("Z 0.01 0.01\n", ""), "line 9: a contour before the first layer"),
        (SQUARE.replace("END", "Z 2 1\nZ"), "line 12: ''; two numbers"),
        (SQUARE.replace("C\n", "C\n.5 .5\n6 .5\n6 .6\nC\n"), "line 5: .*cross or touch"),
        (SQUARE.replace("C\n", "C\n1 0\n2 0\n2 1\n1 1\nC\n"), "line 5: .*cross or touch"),
    ],
)
def test_what_cannot_be_read(text, message):
    with pytest.raises(InputError, match=message):
        ssl.read(text)


def test_small_build():
    again = ssl.read(ssl.write(small_build()))
    assert again.layers[0].outline.area == pytest.approx(RING.area)


@pytest.mark.parametrize("seed", range(5))
def test_several_outlines_come_back_whatever_the_order_of_contours(seed):
    build = Build((Layer(0.2, 0.2, (), ISLANDS), Layer(0.4, 0.2, (), RING)), name="a")
    text = ssl.write(build)
    head, body = text.split("\n", 5)[:5], text.split("\n", 5)[5]
    first, rest = body.split("\nZ ", 1)
    contours = [ring.strip() for ring in re.split(r"^C$", first, flags=re.MULTILINE)[:-1]]
    assert len(contours) == 4
    order = np.random.default_rng(seed).permutation(4)
    shuffled = "".join(contours[k] + "\nC\n" for k in order)
    again = ssl.read("\n".join(head) + "\n" + shuffled + "Z " + rest)
    outline = again.layers[0].outline
    assert sorted(len(part.interiors) for part in outline.geoms) == [0, 0, 1]
    assert outline.symmetric_difference(ISLANDS).area < 1e-4
    assert again.layers[1].outline.geom_type == "Polygon"
