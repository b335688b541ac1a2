"""Roads as a machine's file holds them: the volume that is asked, as far as sections may change."""

from types import SimpleNamespace

import pytest

from fdjax.app.writing import trimmed_to
from fdjax.formats import profile
from fdjax.plan.toolpath import Build, Layer, Road

MARLIN = profile.load("marlin-0.4")


def trimmed(share, width=0.4, controls=("coefficients",), free=False):
    """What is laid of `share` times the volume of a plan of one road, relative to that."""
    road = Road([[0, 0], [30, 0]], [width], family="xi")
    plan = Build((Layer(0.2, 0.2, (road,)),))
    job = SimpleNamespace(
        pattern=SimpleNamespace(controls=controls, width_is_free=free, count="volume")
    )
    result = SimpleNamespace(volume=share * plan.volume)
    return trimmed_to(job, result, plan, MARLIN).volume / plan.volume


@pytest.mark.parametrize("share", [0.96, 0.995, 1.025, 1.049])
def test_sections_make_up_for_what_a_machine_lays_more_or_less(share):
    assert trimmed(share) == pytest.approx(share)


@pytest.mark.parametrize(
    ("share", "more"),
    [
        (1.06, {}),
        (0.9, {}),
        (1.02, {"controls": ()}),
        (1.03, {"width": 0.8}),
    ],
    ids=["much more", "much less", "nothing designed", "wider than the machine lays"],
)
def test_sections_stay_where_that_takes_too_much(share, more):
    assert trimmed(share, **more) == 1


def test_free_widths_change_as_far_as_it_takes():
    assert trimmed(1.3, free=True) == pytest.approx(1.3)
