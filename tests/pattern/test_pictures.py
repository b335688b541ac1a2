"""What patterns give to be drawn."""

import jax.numpy as jnp
import numpy as np
import pytest

from fdjax.limits import Limits
from fdjax.part.part import Part
from fdjax.part.patch import rectangle
from fdjax.pattern.isolines import Isolines
from fdjax.pattern.map_lines import MapLines
from fdjax.target.target import expression

PLATE = Part.plate(rectangle(40, 30), layers=4)
TARGET = expression("0.25 + 0.1*x/40", quantity="solid")


@pytest.mark.parametrize(
    "settings", [Isolines(), MapLines(map="stretched", controls=("stretching",))], ids=str
)
def test_both_laplacians_cover_the_part(settings):
    pattern = settings.begin(PLATE, TARGET, Limits(road_width=(0.3, 0.8)), 5.0)
    panels = pattern.pictures(pattern.controls())["laplacians"]
    assert [panel.name for panel in panels] == ["P = lap(ξ)", "Q = lap(η)"]
    for panel in panels:
        assert (float(panel.x.min()), float(panel.x.max())) == pytest.approx((0, 40))
        assert (float(panel.y.min()), float(panel.y.max())) == pytest.approx((0, 30))
        assert np.isfinite(panel.values).all()


def test_straight_isolines_have_the_laplacians_of_their_spacing():
    pattern = Isolines(twist=0.0).begin(PLATE, TARGET, Limits(road_width=(0.3, 0.8)), 5.0)
    p, q = pattern.pictures(pattern.controls())["laplacians"]
    # The lines of one family crowd along x, those of the other along y as the mean asks.
    assert float(jnp.ptp(p.values, axis=1).max()) < 1e-9
    assert float(jnp.ptp(q.values, axis=0).max()) < 1e-9
    assert float(jnp.mean(p.values)) > 0
