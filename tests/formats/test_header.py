import numpy as np
import pytest
from format_samples import ISLANDS, RING
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point

from fdjax.errors import InputError
from fdjax.formats import header


def facts_of(lines):
    facts = header.Facts()
    for line in lines:
        assert facts.feed(line)
    return facts


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=300), st.sampled_from([";", "#", "//"]))
def test_any_text_survives_in_short_ascii_lines(value, comment):
    lines = header.lines(comment, {"note.target": value})
    assert all(len(line) <= 90 and line.isascii() and line == line.strip() for line in lines)
    assert facts_of(lines).get("note.target") == value


def test_spaces_at_the_breaks_survive():
    value = " " * 500
    assert facts_of(header.lines(";", {"name": value})).get("name") == value


def test_outlines_survive_exactly():
    circle = Point(1 / 3, np.pi).buffer(np.e * 1e-3).difference(Point(1 / 3, np.pi).buffer(1e-4))
    for polygon in (RING, circle, ISLANDS):
        facts = facts_of(header.lines(";", {"outline": header.outline_text(polygon)}))
        assert facts.outline().equals_exact(polygon, 0.0)
    assert facts_of(header.lines(";", {"outline": header.outline_text(None)})).outline() is None


def test_a_mark_is_no_fact():
    assert header.mark("; fdjax road family=xi closed") == ("road", {"family": "xi", "closed": ""})
    assert header.mark("; fdjax name = road") is None
    assert header.mark("; perimeter") is None
    assert not header.Facts().feed("; fdjax road family=xi")


@pytest.mark.parametrize(
    ("line", "ask"),
    [
        ("; fdjax outline = POLYGON ((0 0, 1", lambda facts: facts.outline()),
        ("; fdjax outline = MULTIPOLYGON (((0 0, 1", lambda facts: facts.outline()),
        ("; fdjax outline = POINT (0 0)", lambda facts: facts.outline()),
        ("; fdjax origin = 1 nan", lambda facts: facts.numbers("origin", 2)),
        ("; fdjax origin = 1", lambda facts: facts.numbers("origin", 2)),
        ("; fdjax filament = -1", lambda facts: facts.positive("filament")),
        ("; fdjax name = \\x2", lambda facts: facts.get("name")),
        ("; fdjax version = 99", lambda facts: facts.written_by_fdjax),
    ],
)
def test_damaged_facts_are_input_errors(line, ask):
    with pytest.raises(InputError, match=r"^header: "):
        ask(facts_of([line]))


def test_a_note_needs_a_plain_key():
    with pytest.raises(InputError, match="letters"):
        header.lines(";", {"a b": "1"})
