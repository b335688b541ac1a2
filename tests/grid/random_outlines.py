"""Seeded random domains and controls, for asking how often the solver succeeds."""

import numpy as np
import shapely

from fdjax.grid.winslow import ControlFunctions
from fdjax.part.patch import from_polygon


def _transfinite(bottom, right, top, left):
    """Transfinite interpolation of four rows of boundary nodes that share their corners."""
    f, g = (
        np.linspace(0, 1, len(bottom))[:, None, None],
        np.linspace(0, 1, len(left))[None, :, None],
    )
    along = (1 - g) * bottom[:, None] + g * top[:, None] + (1 - f) * left + f * right
    corners = (1 - f) * (1 - g) * bottom[0] + f * (1 - g) * bottom[-1]
    return along - corners - (1 - f) * g * top[0] - f * g * top[-1]


def star(rng, shape):
    """A star-shaped outline: five harmonics that change the radius by up to 0.3 of it."""
    size = rng.normal(size=(2, 5))
    theta = np.linspace(0, 2 * np.pi, 721)
    order = np.arange(1, 6)[:, None]

    def swing(theta):
        return size[0] @ np.cos(order * theta) + size[1] @ np.sin(order * theta)

    share = rng.uniform(0.05, 0.3) / np.abs(swing(theta)).max()

    at = theta[:-1:3]
    ring = 50 * (1 + share * swing(at)) * np.stack([np.cos(at), np.sin(at)])
    patch = from_polygon(shapely.Polygon(ring.T), smooth=True)
    ni, nj = (np.linspace(0, 1, count) for count in shape)
    return _transfinite(patch.bottom(ni), patch.right(nj), patch.top(ni), patch.left(nj))


def bent_strip(rng, shape):
    """An L as a strip bent at a random angle: xi runs along it, the inner corner is in a side."""
    ni, nj = shape
    width = rng.uniform(0.3, 1.0) * 30
    legs = rng.uniform(1.0, 3.0, 2) * 30
    bend = np.radians(rng.uniform(20, 100))
    ways = np.array([[1.0, 0.0], [np.cos(bend), np.sin(bend)]])
    normals = np.stack([-ways[:, 1], ways[:, 0]], 1)
    middle = np.linspace(-1, 1, ni)[:, None]

    def side(offset):
        corner = np.array([0.0, 0.0]) + offset * (normals[0] + np.tan(bend / 2) * -ways[0])
        before = offset * normals[0] - legs[0] * ways[0]
        after = offset * normals[1] + legs[1] * ways[1]
        return np.where(
            middle < 0, corner + middle * (corner - before), corner + middle * (after - corner)
        )

    bottom, top = side(0.0), side(width)
    g = np.linspace(0, 1, nj)[:, None]
    return _transfinite(
        bottom, bottom[-1] + g * (top[-1] - bottom[-1]), top, bottom[0] + g * (top[0] - bottom[0])
    )


def smooth_controls(rng, shape, largest=1.5):
    """phi and psi of a few random waves, at most `largest` on the unit square."""
    xi = np.linspace(0, 1, shape[0])[1:-1, None]
    eta = np.linspace(0, 1, shape[1])[None, 1:-1]

    def field(steps):
        waves = rng.normal(size=(3, 3))
        values = sum(
            waves[k, m] * np.cos(np.pi * k * xi) * np.cos(np.pi * m * eta)
            for k in range(3)
            for m in range(3)
        )
        return rng.uniform(0, largest) * values / np.abs(values).max() / steps

    none = np.zeros((shape[0] - 2, shape[1] - 2))
    return ControlFunctions(field(shape[0] - 1), field(shape[1] - 1), none, none)
