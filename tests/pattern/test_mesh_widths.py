"""Edges of meshes with widths of their own, from the design to the file."""

import json

import jax
import numpy as np
import pytest
import shapely
from slopes import assert_slopes

from fdjax.app import config
from fdjax.app.run import design
from fdjax.errors import InputError
from fdjax.formats import profile, read_file
from fdjax.limits import Limits
from fdjax.optimise.objective import Objective
from fdjax.part.part import Part
from fdjax.pattern.mesh import Mesh
from fdjax.plan.trace import lay
from fdjax.road.window import SoftWindows
from fdjax.target.target import expression

pytestmark = pytest.mark.usefixtures("compiled_once")

LIMITS = profile.load("marlin-0.4").limits
DISC = shapely.Point(20, 20).buffer(20, quad_segs=24).difference(shapely.Point(14, 24).buffer(4))
LINEAR = expression("0.15 + 0.2*x/40", quantity="solid")


def begun(part, **settings):
    settings = {"controls": ("nodes", "width"), **settings}
    pattern = Mesh(**settings).begin(part, LINEAR, LIMITS, 5.0)
    free = np.random.default_rng(3).normal(size=len(pattern.free))
    return pattern.at(pattern.controls()._replace(width=jax.numpy.asarray(free)))


@pytest.mark.parametrize("walls", [False, True])
def test_the_deposit_is_what_a_plan_lays_edge_by_edge(walls):
    part = Part.plate(DISC, layers=2, height=0.2)
    pattern = begun(part, phases=2, walls=walls)
    volume = jax.jit(lambda p: p.deposit(p.realise(p.controls())).volume.sum())(pattern)
    build = lay(pattern.strokes(pattern.controls()), part, lift_length=4.0, least_road=1.0)
    assert build.volume + build.thinned == pytest.approx(float(volume), rel=0.01)
    widths = np.concatenate([road.width for road in build.layers[0].roads])
    assert widths.min() > 0.303
    assert widths.max() < 0.792
    assert np.ptp(widths) > 0.3


def test_gradients_agree_with_central_differences():
    part = Part.plate(DISC, layers=2, height=0.2)
    pattern = begun(part, phases=1, cells="centre-dual", count="coverage")
    windows = SoftWindows.over(part, LINEAR.solid, 5.0, flat=True)
    assert_slopes(Objective(pattern, windows, LINEAR, LIMITS), scaled=False)


def test_widths_alone_leave_the_nodes_where_they_are():
    part = Part.plate(DISC, layers=2, height=0.2)
    pattern = begun(part, phases=1, controls=("width",))
    moved = pattern.controls()._replace(nodes=pattern.first + 1.0)
    first, then = (pattern.realise(each).xy for each in (pattern.controls(), moved))
    assert np.asarray(first) == pytest.approx(np.asarray(then))
    assert pattern.penalties(pattern.realise(moved), LIMITS) == {}


def test_widths_of_edges_reach_the_file(tmp_path):
    tables = {
        "files": ["gcode"],
        "part": {"shape": "rectangle", "size": [30, 30], "layers": 2},
        "target": {"solid": "0.22 + 0.2*x/30", "tolerance": 0.2},
        "pattern": {"kind": "mesh", "through": "uniform", "phases": 2},
        "design": {"controls": ["width"], "iterations": 12, "corrections": 0},
    }
    design(config.parse(tables, name="job"), tmp_path, progress=lambda text: None)
    report = json.loads((tmp_path / "report.json").read_text())
    low, _, high = report["design"]["pattern"]["edge_width"]
    build = read_file(tmp_path / "job.gcode", machine=profile.load("marlin-0.4"))
    roads = build.layers[0].roads
    widths = np.concatenate([road.width for road in roads])
    middle = np.concatenate([(road.path[1:] + road.path[:-1])[:, 0] / 2 for road in roads])
    assert widths.min() == pytest.approx(low, rel=0.03)
    assert widths.max() == pytest.approx(high, rel=0.03)
    assert widths[middle > 20].mean() > widths[middle < 10].mean() + 0.03
    facts = report["files"]["job.gcode"]
    assert facts["mean_got"] == pytest.approx(facts["mean_asked"], abs=1e-3)


def test_what_has_no_widths_of_its_own_is_refused():
    with pytest.raises(InputError, match='"width" is of edges; polygons have one width'):
        Mesh(controls=("width",), laid="polygons")
    with pytest.raises(InputError, match='"width" needs a machine with a range of road widths'):
        Mesh(controls=("width",)).begin(Part.plate(DISC), LINEAR, Limits(), 5.0)
