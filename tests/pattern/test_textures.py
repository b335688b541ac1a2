"""Textures: their closed form against what is drawn and laid, and designs of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from outlines import OUTLINES
from slopes import assert_slopes

from fdjax.app import config
from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.optimise.design import design
from fdjax.optimise.objective import Objective
from fdjax.part.part import Part
from fdjax.pattern.chart import Controls
from fdjax.pattern.drawings import NAMES, drawing
from fdjax.pattern.textures import Textures
from fdjax.plan.check import check
from fdjax.plan.compare import compare
from fdjax.plan.measure import measure
from fdjax.plan.trace import lay
from fdjax.road.window import SoftWindows
from fdjax.target.target import expression

pytestmark = pytest.mark.usefixtures("compiled_once")

MARLIN = profile.load("marlin-0.4")
DISC = shapely.Point(20, 20).buffer(20, quad_segs=24)
SMALL = expression("0.2 + 0.2*x/40", quantity="solid")
LARGE = expression("0.2 + 0.15*x/40", quantity="solid")


def begun(part, target=SMALL, cell="hexagonal", **settings):
    settings = Textures(cell=drawing(cell), **settings)
    return settings.begin(part, target, MARLIN.limits, 5.0)


def bent(pattern, by=0.6):
    """The pattern with waves in both functions, controls that no design found."""

    def waves(values, turn):
        k, m = np.meshgrid(*map(np.arange, values.shape[:2]), indexing="ij")
        return values + by * jnp.asarray(np.sin(0.9 * k + turn) * np.cos(0.8 * m))[..., None]

    first = pattern.first
    return pattern.at(Controls(waves(first.xi, 0.0), waves(first.eta, 1.0), first.width))


def modelled(pattern):
    return float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))


@pytest.mark.parametrize("name", NAMES)
def test_drawn_lines_of_all_phases_are_as_long_as_the_closed_form_says(name):
    region = OUTLINES["ring"]()
    part = Part.plate(region, layers=13, height=0.2)
    pattern = bent(begun(part, LARGE, cell=name, angle=20.0, phases=13))
    free = part.regions[0].inset(0.2)
    length = 0.0
    for (graph,) in pattern.strokes(pattern.first):
        edges = shapely.linestrings(graph.xy[graph.edges])
        length += shapely.length(shapely.intersection(edges, free)).sum() / 13
    realised = jax.jit(lambda p: p.realise(p.first))(pattern)
    density = pattern.density(realised)
    assert density.max() > 1.1 * density[pattern.room.area[0] > 0].min()
    assert length == pytest.approx(float((density * pattern.room.area[0]).sum()), rel=3e-3)


@pytest.mark.parametrize("name", NAMES)
def test_the_deposit_is_what_a_plan_lays(name):
    part = Part.plate(OUTLINES["disc"](), layers=5, height=0.2)
    pattern = begun(part, LARGE, cell=name, angle=10.0)
    build = lay(pattern.strokes(pattern.first), part, lift_length=4.0, least_road=1.0)
    assert build.volume + build.thinned == pytest.approx(modelled(pattern), rel=3e-3)
    assert build.thinned < 0.01 * build.volume
    found = check(build.replace(origin=(50, 50)), MARLIN.limits)
    assert [each for each in found if each.severity == "error"] == []


CONTROLS = [("coefficients",), ("p", "q"), ("coefficients", "width"), ("q", "width_field")]


@pytest.mark.parametrize("controls", CONTROLS, ids="-".join)
def test_gradients_of_every_control_agree_with_central_differences(controls):
    part = Part.plate(DISC.difference(DISC.buffer(-14)), layers=10, height=0.2)
    pattern = begun(part, controls=controls, knots=(8, 9), field_knots=(4, 5))
    windows = SoftWindows.over(part, SMALL.solid, 5.0, flat=True)
    assert_slopes(Objective(pattern, windows, SMALL, MARLIN.limits))


@pytest.mark.parametrize("name", ["hexagonal", "triangular"])
def test_a_disc_meets_its_target_in_the_roads(name):
    part = Part.plate(DISC, layers=10, height=0.2)
    found = design(part, SMALL, limits=MARLIN.limits, pattern=Textures(cell=drawing(name)))
    assert found.made
    assert found.broken == {}
    build = lay(found.strokes(), part, lift_length=4.0)
    for _ in range(2):
        found = found.corrected(*build.deposits(1.25))
        build = lay(found.strokes(), part, lift_length=4.0)
    seen = compare(measure(build, window=5.0), SMALL)
    assert seen.rms < 0.015
    assert 1 - seen.mean_got == pytest.approx(1 - seen.mean_asked, rel=3e-3)


def test_layers_may_differ_and_a_target_may_rise():
    regions = [DISC] * 20 + [DISC.difference(shapely.Point(20, 20).buffer(6))] * 20
    part = Part.stack(regions, 0.2)

    def rising(x, y, z):
        return 0.65 + 0.05 * jnp.sin(x / 9) + 0.02 * z / 8

    found = design(part, rising, limits=MARLIN.limits, pattern=Textures(), iterations=40)
    assert found.pattern.axes[2].count > 1
    assert found.outcome.error < 0.01
    build = lay(found.strokes(), part, lift_length=4.0)
    assert build.volume == pytest.approx(found.volume, rel=0.02)


def test_a_fold_is_a_broken_limit():
    part = Part.plate(DISC)
    pattern = begun(part)
    folded = bent(pattern, by=8.0)
    for each, broken in ((pattern, False), (folded, True)):
        realised = each.realise(each.first)
        worst = float(each.penalties(realised, MARLIN.limits)["distortion"].max())
        assert (worst > 0) == broken


def test_a_target_beyond_the_drawing_is_refused_at_once():
    part = Part.plate(DISC)
    with pytest.raises(InputError, match=r"porosity 0\.970 is asked.*can give"):
        begun(part, expression("0.03", quantity="solid"))


def job(**pattern):
    part = {"shape": "rectangle", "size": [40, 40]}
    return config.parse({"part": part, "target": {"solid": "0.3"}, "pattern": pattern})


def test_a_cell_of_ones_own_is_read_from_a_job():
    lines = [[[0, 0.5], [0.5, 0], [1, 0.5]], [[0, 0.5], [0.5, 1], [1, 0.5]]]
    cell = job(kind="texture", cell={"size": [1, 1], "lines": lines}).pattern.cell
    assert cell.density == pytest.approx(2 * 2**0.5)
    assert len(cell.edges) == 4


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("hexagon", r'"hexagon" is not one of .* \(did you mean "hexagonal"\?\)'),
        ({"size": [1, 1]}, "needs lines and size.*here it has size"),
        ({"size": [1, 1], "lines": [[[0, 0.3], [1, 0.4]]]}, r"cell: .*ends at \(0, 0.3\)"),
        ({"size": [1, 1], "lines": [[[0, 0.3]]]}, r"cell.lines\[0\]: has 1 points"),
        ({"size": [0, 1], "lines": [[[0, 0], [1, 0]]]}, "must be positive"),
    ],
)
def test_cells_that_cannot_be_are_one_clear_line(cell, words):
    with pytest.raises(InputError, match=words) as caught:
        job(kind="texture", cell=cell)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("job: [pattern] cell")
