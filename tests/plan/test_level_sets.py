"""Isolines of many fields over regions of every sort: nothing outside, nothing crosses."""

import numpy as np
import pytest
import shapely
from isolines import (
    bump,
    conformal,
    graded,
    isolines,
    random_field,
    random_region,
    straight,
)
from outlines import OUTLINES

from fdjax.plan.check import check
from fdjax.plan.lines import lay_lines
from fdjax.plan.room import Room
from fdjax.plan.toolpath import Build, Layer

FIELDS = {
    "level": straight(0.01, 3.0),
    "slanting": straight(8, 0.9),
    "diagonal": straight(45, 1.3),
    "graded": graded(77, 0.8, 4.0),
    "bump": bump(5, 1.3),
    "conformal": conformal(1.1),
}


def layer(roads, region):
    return Layer(0.2, 0.2, tuple(roads), region)


def errors(roads, region):
    build = Build((layer(roads, region),), origin=(100.0, 100.0))
    return [finding for finding in check(build) if finding.severity == "error"]


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize("field", FIELDS)
def test_few_roads_and_no_errors_on_every_outline(outline, field):
    region = OUTLINES[outline]()
    lines = isolines(FIELDS[field], region.bounds)
    roads = lay_lines(lines, region, lift_length=4, tolerance=2e-3).roads
    assert errors(roads, region) == []
    assert len(roads) <= 5 + len(region.interiors)
    joins = sum(road.length for road in roads) - cut_length(lines, region)
    assert joins < 0.2 * cut_length(lines, region)


def cut_length(lines, region):
    free = region.buffer(-0.2, join_style="mitre")
    return sum(shapely.LineString(xy).intersection(free).length for xy in lines.xy)


@pytest.mark.parametrize("seed", range(60))
def test_random_fields_over_random_regions(seed):
    rng = np.random.default_rng(1000 + seed)
    region = random_region(rng, 30)
    lines = isolines(random_field(rng, 30), region.bounds, parity=int(rng.integers(2)))
    laid = lay_lines(lines, region, lift_length=4, tolerance=2e-3)
    assert errors(laid.roads, region) == []
    again = lay_lines(lines, region, lift_length=4, tolerance=2e-3)
    assert [road.xy.tolist() for road in again.roads] == [road.xy.tolist() for road in laid.roads]


def test_half_of_each_wall_is_covered_over_two_parities():
    region = OUTLINES["square"]()
    covered = [
        sum(road.length for road in lay_lines(lines, region, lift_length=4).roads)
        - cut_length(lines, region)
        for parity in (0, 1)
        for lines in [isolines(straight(30, 1.3), region.bounds, parity=parity)]
    ]
    walls = 4 * 79.6
    assert sum(covered) / 2 == pytest.approx(walls / 2, rel=0.04)


def test_a_line_that_closes_is_a_closed_road():
    region = OUTLINES["square"]()
    lines = isolines(lambda x, y: np.hypot(x - 40, y - 40) / 9 + 0.5, region.bounds)
    roads = lay_lines(lines, region, lift_length=4, tolerance=2e-3).roads
    closed = sorted(road.length for road in roads if road.closed)
    assert closed == pytest.approx([2 * np.pi * 9 * (k + 0.5) for k in range(4)], rel=2e-3)


def test_a_closed_line_cut_at_a_wall_is_no_shorter_for_where_it_began():
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = np.stack([10 + 8 * np.cos(angle), 10 + 8 * np.sin(angle)], 1)
    circle[-1] = circle[0]
    region = shapely.box(0, 0, 20, 14)
    lines = isolines(straight(0, 1), (0, 0, 1, 1))
    lines = type(lines)("xi", 0, np.zeros(1, int), [circle], [np.full(180, 0.4)])
    (road,) = lay_lines(lines, region, lift_length=0).roads
    assert not road.closed
    assert road.xy[[0, -1], 1] == pytest.approx(13.8)


@pytest.mark.parametrize("vertices", [5_000, 100_000])
def test_an_outline_of_many_vertices(vertices):
    t = np.linspace(0, 2 * np.pi, vertices, endpoint=False)
    radius = 39 + 0.4 * np.sin(41 * t)
    wavy = shapely.Polygon(np.stack([40 + radius * np.cos(t), 40 + radius * np.sin(t)], 1))
    room = Room.of(wavy, tolerance=1e-3)
    roads = lay_lines(isolines(bump(20, 1.3), wavy.bounds), room, lift_length=4).roads
    assert errors(roads, wavy) == []
    assert len(roads) <= 10
