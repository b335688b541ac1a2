"""Meshes made by an advancing front as roads, and as keys of a job."""

import jax
import pytest
import shapely

from fdjax.app import config
from fdjax.errors import InputError
from fdjax.formats import profile
from fdjax.mesh.given import lattice
from fdjax.part.part import Part
from fdjax.pattern.mesh import Mesh
from fdjax.plan.check import check
from fdjax.plan.trace import lay
from fdjax.target.target import expression

pytestmark = pytest.mark.usefixtures("compiled_once")

LIMITS = profile.load("marlin-0.4").limits
DISC = shapely.Point(20, 20).buffer(20, quad_segs=24).difference(shapely.Point(14, 24).buffer(4))
LINEAR = expression("0.15 + 0.2*x/40", quantity="solid")


@pytest.mark.parametrize("cells", ["triangles", "centre-dual"])
@pytest.mark.parametrize("walls", [False, True])
def test_the_deposit_is_what_a_plan_lays(cells, walls):
    part = Part.plate(DISC, layers=2, height=0.2)
    settings = Mesh(method="front", cells=cells, phases=2, walls=walls)
    pattern = settings.begin(part, LINEAR, LIMITS, 5.0)
    modelled = float(jax.jit(lambda p: p.deposit(p.realise(p.first)).volume.sum())(pattern))
    build = lay(pattern.strokes(pattern.first), part, lift_length=4.0, least_road=1.0)
    assert build.volume + build.thinned == pytest.approx(modelled, rel=0.015)
    asked = shapely.area(DISC) * 0.4 * (0.15 + 0.2 * shapely.centroid(DISC).x / 40)
    assert build.volume == pytest.approx(float(asked), rel=0.12)
    found = check(build.replace(origin=(50, 50)), LIMITS)
    assert [each for each in found if each.severity == "error"] == []
    facts = pattern.facts(pattern.first)
    # The angles that a triangulation for a target keeps to.
    assert facts["least_angle"] > 17
    assert facts["median_angle"] > 45


def parsed(**pattern):
    table = {
        "part": {"shape": "rectangle", "size": [40, 40]},
        "target": {"solid": 0.25},
        "pattern": {"kind": "mesh", **pattern},
    }
    return config.parse(table).pattern


def test_rules_are_keys_of_a_job():
    pattern = parsed(method="front", front_order="shortest", front_height=0.9, front_sweeps=0)
    assert (pattern.front_order, pattern.front_height, pattern.front_reuse) == (
        "shortest",
        0.9,
        0.75,
    )
    for given, said in (
        ({"front_height": 0.9}, 'front_height: it is a rule of method = "front"'),
        ({"method": "front", "front_reuse": 3}, "front_reuse: 3"),
        ({"method": "front", "through": "uniform"}, "give no mesh and no map"),
        ({"method": "fronts"}, '"fronts"'),
    ):
        with pytest.raises(InputError, match=said):
            parsed(**given)
    mesh = lattice((2, 2), "rising")
    with pytest.raises(InputError, match="give no mesh and no map"):
        Mesh(method="front", mesh=(mesh,))
