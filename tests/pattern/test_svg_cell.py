"""Unit cells from SVG: what paths draw, and files that cannot be read."""

import numpy as np
import pytest

from fdjax.app import config
from fdjax.errors import InputError
from fdjax.pattern.drawings import drawing
from fdjax.pattern.svg_cell import cell_of, lines_of

SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 2 1"><g>{}</g></svg>'


def test_curves_and_arcs_are_drawn_as_they_are():
    (arc,) = lines_of("M 0.5 0 A 0.5 0.5 0 0 1 0 0.5")
    assert np.hypot(*arc.T) == pytest.approx(np.full(len(arc), 0.5), abs=1e-3)
    (cubic,) = lines_of("M0 0 C 0 1 1 1 1 0")
    assert cubic[len(cubic) // 2] == pytest.approx([0.5, 0.75])
    (quadratic,) = lines_of("m0 0 q 1 2 2 0")
    assert quadratic[len(quadratic) // 2] == pytest.approx([1, 1])
    assert len(lines_of("M0 0 L1 0 M0 1 L1 1")) == 2


def parsed(cell, folder):
    table = {
        "part": {"shape": "cosine_top"},
        "target": {"porosity": 0.7},
        "pattern": {"kind": "texture", "cell": cell},
    }
    return config.parse(table, folder=folder).pattern.cell


def test_arcs_as_a_path_are_the_cell_of_that_name(tmp_path):
    path = "M0.5 0 A0.5 0.5 0 0 1 0 0.5 M0.5 1 A0.5 0.5 0 0 1 1 0.5"
    cell = parsed({"size": [1, 1], "path": path}, tmp_path)
    assert cell.density == pytest.approx(drawing("truchet").density, rel=3e-3)
    twice = parsed({"size": [1, 1], "path": path, "rule": "mirror"}, tmp_path)
    assert twice.size == (2, 2)


def test_a_file_stands_as_a_viewer_shows_it(tmp_path):
    path = tmp_path / "cell.svg"
    path.write_text(SVG.format('<path d="M0 0.25 H2"/>'))
    (line,), size = cell_of(path)
    assert size == (2, 1)
    assert line.tolist() == [[0, 0.75], [2, 0.75]]
    assert parsed({"svg": "cell.svg"}, tmp_path).density == pytest.approx(1)


def test_what_a_viewer_does_not_show_is_not_drawn(tmp_path):
    # As Inkscape keeps notes, a grid among them, and hides layers.
    path = tmp_path / "cell.svg"
    path.write_text(
        "<svg xmlns='http://www.w3.org/2000/svg' xmlns:s='http://sodipodi.sourceforge.net/DTD/"
        "sodipodi-0.dtd' xmlns:i='http://www.inkscape.org/namespaces/inkscape' "
        "xmlns:r='http://www.w3.org/1999/02/22-rdf-syntax-ns#' viewBox='0,0 2 , 1'>"
        "<s:namedview><i:grid/></s:namedview><metadata><r:RDF/></metadata>"
        "<defs><path d='M0 0.5 H2'/></defs>"
        "<g style='fill:none;display: none'><rect/><path d='M0 0.5 H2'/></g>"
        "<g><path display='none' d='M0 0.5 H2'/><path d='M0 0.25 H2'/></g></svg>"
    )
    (line,), size = cell_of(path)
    assert size == (2, 1)
    assert line.tolist() == [[0, 0.75], [2, 0.75]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SVG.format("<svg><path d='M0 0 H1'/></svg>"), "holds a <svg>"),
        (SVG.format("<path style='transform:scale(2)' d='M0 0 H1'/>"), "transformed"),
        (SVG.format("<circle r='1'/>"), "holds a <circle>"),
        (SVG.format("<path transform='scale(2)' d='M0 0 H1'/>"), "transformed"),
        (SVG.format("<path d='M0 x'/>"), "no SVG path"),
        (SVG.format(""), "holds no path"),
        ("<svg><path d='M0 0 H1'/></svg>", "viewBox"),
        ("<svg viewBox='0 0 1.2.3 1'><path d='M0 0 H1'/></svg>", "viewBox"),
        ("<svg viewBox='0 0 1e999 1'><path d='M0 0 H1'/></svg>", "viewBox"),
        ("<svg", "is no SVG"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><svg/>", "entities"),
    ],
)
def test_a_file_that_is_no_drawing_of_paths_is_refused(tmp_path, text, words):
    path = tmp_path / "cell.svg"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        cell_of(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("hello", "no SVG path"),
        ("M0 0", "draws no line"),
        ("M0 0.3 H0.9 L1 0.4", r"none goes on at \(1, 0.3\)"),
        ("M0 0 L1 1 M0 1 L1 0", r"cross at \(0.5, 0.5\)"),
    ],
)
def test_paths_that_cannot_repeat_are_refused(tmp_path, path, words):
    with pytest.raises(InputError, match=words):
        parsed({"size": [1, 1], "path": path}, tmp_path)
