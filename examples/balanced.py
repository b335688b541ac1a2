"""A disc with a budget of material and a centre of mass, besides a porosity.

    python examples/balanced.py

Losses of one's own are residuals: functions of a pattern and of what its controls amount to, in
units of porosity, so that 0.01 of one weighs as much as 0.01 of porosity everywhere. They are
differentiated with everything else.
"""

import jax
import jax.numpy as jnp
import shapely

import fdjax

jax.config.update("jax_enable_x64", True)
disc = fdjax.Part.plate(shapely.Point(30, 30).buffer(30), layers=10, height=0.2)
target = fdjax.expression("0.7 - 0.1*exp(-((x-30)**2 + (y-30)**2)/15**2)")
machine = fdjax.load_machine("marlin-0.4")
BUDGET, CENTRE = 1750.0, 31.0  # mm^3 of material; x of its centre of mass, mm


def budget(pattern, realised):
    """Material over or under the budget, in twentieths of the part's volume."""
    return 20 * (pattern.deposit(realised).volume.sum() - BUDGET) / disc.volume


def balance(pattern, realised):
    """How far the centre of mass lies from where it shall, in centimetres."""
    x, _, _, volume = pattern.deposit(realised)
    return (jnp.einsum("i,ijk->", x, volume) / volume.sum() - CENTRE) / 10


for terms in ((), (budget, balance)):
    design = fdjax.design(disc, target, limits=machine.limits, terms=terms)
    build = fdjax.lay(design.strokes(), disc, lift_length=machine.lift_length)
    places, volumes = build.deposits(0.5)
    centre = (places[:, 0] * volumes).sum() / volumes.sum()
    error = fdjax.compare(fdjax.measure(build, window=5), target).rms
    print(
        f"{len(terms)} losses: {build.volume:.0f} mm^3 laid, centre of mass at x = {centre:.2f} mm,"
        f" RMS porosity error {error:.4f}"
    )
