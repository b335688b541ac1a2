"""Where a design begins: line counts, width and first spacings from the target alone."""

import numpy as np
import pytest

from fdjax.errors import InputError
from fdjax.grid.base import Sides
from fdjax.limits import Limits
from fdjax.part.patch import cosine_top, rectangle
from fdjax.pattern.line_counts import begin
from fdjax.road.bead import section_area
from fdjax.road.stacking import Stacking

LIMITS = Limits(road_width=(0.3, 0.8), longest_span=10.0)
AREA = section_area(0.4, 0.2)
STACK = Stacking("alternate-staggered", 5, 10)


def start(target, patch=None, **more):
    options = {
        "height": 0.2, "width": 0.4, "stacking": STACK, "limits": LIMITS, "window": 5.0, **more
    }  # fmt: skip
    return begin(Sides.of(patch or rectangle(40, 30)), target, **options)


def constant(value):
    return lambda x, y: value + 0 * x


def plate_solid(lines, stacking=STACK, width=0.4):
    """Solid share of a plate 40 x 30 with so many lines of each family, turn-arounds included."""
    volume = 0.0
    for n, along, across, family in zip(lines, (30, 40), (40, 30), ("xi", "eta"), strict=True):
        length = n * (along - width) + (n - 1) / n * (across - width)
        volume += stacking.layer_share(family) * section_area(width, 0.2) * length
    return volume / (40 * 30 * 0.2)


@pytest.mark.parametrize("porosity", [0.4, 0.65, 0.8])
@pytest.mark.parametrize(
    "stacking", [STACK, Stacking("both", 1, 3), Stacking("both-staggered", 2, 4)]
)
def test_a_constant_target_has_square_cells_and_its_mean(porosity, stacking):
    found = start(constant(porosity), stacking=stacking)
    lines = np.array(found.comb) / stacking.phases
    assert 40 / lines[0] == pytest.approx(30 / lines[1], rel=0.3)
    assert plate_solid(lines, stacking) == pytest.approx(1 - porosity, rel=0.05)
    assert found.width == 0.4


def test_the_first_densities_are_those_of_the_lines():
    found = start(constant(0.65))
    for k, across in enumerate((40, 30)):
        middle = found.density[k][20:-20]
        assert np.ptp(middle) < 1e-9
        assert middle[0] == pytest.approx(found.comb[k] / 5 / across, rel=0.1)
        # Near the walls where the other family turns there are fewer.
        assert found.density[k][[0, -1]].max() < middle[0]


def test_the_turn_arounds_are_spread_over_half_a_window():
    narrow, wide = (start(constant(0.65), window=window).density[0] for window in (3.0, 12.0))
    fewer = [np.count_nonzero(density < density[32] - 1e-9) / 2 for density in (narrow, wide)]
    # 65 places over 40 mm.
    np.testing.assert_allclose(np.array(fewer) * 40 / 64, [1.5, 6.0], atol=1.0)


def test_the_graded_plate_keeps_room_for_its_turn_arounds():
    """The plate of `examples/graded_plate.toml`: solid share 0.1 to 0.5 over 80 mm."""
    solid = lambda x: 0.1 + 0.4 * x / 80  # noqa: E731
    found = start(lambda x, y: 1 - solid(x), rectangle(80, 80))
    xi, eta = found.density
    assert (np.diff(xi[8:-8]) > 0).all()
    assert np.ptp(eta[8:-8]) < 1e-6
    # All within what the machine can lay: 0.4 to 10 mm apart, with play at the dense end.
    for density in (xi, eta):
        assert density.min() >= 1 / 10
        assert density.max() <= 0.98 / 0.4
    # In the middle the two families are what is asked. Beside the walls there are fewer xi lines,
    # for what the eta lines bring there with their turns, as far as that goes.
    x = np.linspace(0, 80, 65)
    asked = solid(x) * 0.2 / AREA
    lines = (xi + eta[32]) / 2
    np.testing.assert_allclose(lines[8:-8], asked[8:-8], rtol=0.02)
    assert lines[-1] < asked[-1]
    assert xi[0] == xi.min()


def test_given_lines_are_kept_and_the_width_follows_from_the_mean():
    found = start(constant(0.65), lines=(30, 20), width=None)
    assert found.comb == (150, 100)
    # The lines alone, without turn-arounds, have the mean asked for.
    density = (30 / 40 + 20 / 30) / 2
    assert section_area(found.width, 0.2) / 0.2 * density == pytest.approx(0.35, rel=1e-6)
    assert start(constant(0.65), lines=(3, 2), width=None, limits=LIMITS).width == 0.8


def test_without_lines_or_width_the_width_is_in_the_middle_of_the_range():
    assert start(constant(0.65), width=None).width == pytest.approx(np.sqrt(0.3 * 0.8))


def test_lines_of_a_curved_domain_have_its_mean():
    patch = cosine_top()
    limits = Limits(road_width=(0.3, 1.0))
    found = start(constant(0.65), patch, limits=limits, width=0.5, height=0.25)
    # Lines of constant xi are upright, those of constant eta the top at a smaller scale.
    s, eta = np.linspace(0, 1, 201), np.linspace(0, 1, 101)[:, None]
    slope = 25.4 * np.sin(2 * np.pi * s) * 2 * np.pi / 76.2
    run, height = 76.2 * np.hypot(1, eta * slope).mean(), patch.outline.area / 76.2
    lines = np.array(found.comb) / 5
    length = lines @ [height, run] / 2
    flat = section_area(0.5, 0.25) / 0.25
    assert flat * length / patch.outline.area == pytest.approx(0.35, rel=0.05)
    assert (76.2 / lines[0]) / (height / lines[1]) == pytest.approx(1, abs=0.3)


@pytest.mark.parametrize(
    ("target", "more", "words"),
    [
        # The section of such roads is 0.357 mm^2 per mm of layer height.
        (constant(0.05), {}, r"porosity 0\.050 is asked at \(.*\) mm, but .* 0\.4 mm wide"),
        (constant(0.99), {}, r"porosity 0\.990 is asked at .*, but .* can give 0\.107 to 0\.964"),
        (constant(1.0), {}, r"porosity 1\.000 is asked at .*, but .* can give 0\.107 to 0\.964"),
        (lambda x, y: 0.05 + 0.02 * x, {}, r"can give 0\.107 to 0\.964"),
        (constant(0.05), {"stacking": Stacking("both")}, None),
        (constant(0.99), {"limits": Limits()}, None),
        (constant(0.4), {"limits": Limits(least_spacing=0.8)}, r"can give 0\.554 to 1\.000"),
    ],
)
def test_a_porosity_out_of_reach_says_what_can_be(target, more, words):
    if words is None:
        start(target, **more)
    else:
        with pytest.raises(InputError, match=words) as caught:
            start(target, **more)
        assert "\n" not in str(caught.value)
