"""Patterns whose deposit is compared with the roads that a plan lays of them."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from fdjax.grid.base import Sides
from fdjax.part.part import Part
from fdjax.pattern.grid_controls import Controls
from fdjax.pattern.grid_lines import GridLines
from fdjax.plan.trace import lay
from fdjax.road.bead import section_area
from fdjax.road.porosity import Samples
from fdjax.road.stacking import FAMILIES, Stacking

WIDTH, HEIGHT = 0.4, 0.2
AREA = section_area(WIDTH, HEIGHT)


def pattern(patch, lines, phases=1, *, both=False, kind="uniform", samples=400, **more):
    """The pattern with `lines` of each family a layer, and as many layers as make it whole."""
    mode = ("both" if both else "alternate") + ("-staggered" if phases > 1 else "")
    places = Samples.between(np.linspace(0, 1, samples + 1))
    return GridLines(
        sides=Sides.of(patch),
        comb=tuple(jnp.asarray(float(n * phases)) for n in lines),
        width=WIDTH,
        width_range=(0.3, 0.8),
        height=HEIGHT,
        first=Controls(),
        samples=(places, places),
        kind=kind,
        stacking=Stacking(mode, phases, phases if both else 2 * phases),
        **more,
    )


@eqx.filter_jit
def _deposit(pattern):
    return pattern.deposit(pattern.realise(pattern.first))


def deposit(pattern):
    """Points and volumes of the mean layer as NumPy arrays."""
    xyz, volume = map(np.asarray, _deposit(pattern))
    return xyz[:, :2], volume / pattern.stacking.layers


def laid(pattern, outline):
    """The build of the pattern's roads."""
    part = Part.plate(outline, layers=pattern.stacking.layers, height=HEIGHT)
    return lay(pattern.strokes(pattern.first), part, lift_length=4.0)


def line_volume(pattern, length):
    """Volume on the mean layer of one line of each family, of this length."""
    return AREA * length * sum(pattern.stacking.layer_share(family) for family in FAMILIES)


def in_windows(points, volume, measurement):
    """Volume at points in the windows of a measurement."""
    edges = measurement.x, measurement.y
    return np.histogram2d(*points.T, bins=edges, weights=volume)[0]
