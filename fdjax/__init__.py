"""Porosity-optimised toolpaths for fused deposition.

Public names are loaded on first use, so that what needs no JAX does not load it.
"""

from importlib import import_module
from typing import Any

_HOMES = {
    "rectangle": "part.patch",
    "cosine_top": "part.patch",
    "from_curves": "part.patch",
    "from_polygon": "part.patch",
    "contour": "part.contour",
    "Region": "part.region",
    "Part": "part.part",
    "Target": "target.target",
    "expression": "target.target",
    "design": "optimise.design",
    "Isolines": "pattern.isolines",
    "Textures": "pattern.textures",
    "Curves": "pattern.curves",
    "MapLines": "pattern.map_lines",
    "Multiblock": "pattern.block_lines",
    "Mesh": "pattern.mesh",
    "GivenMesh": "mesh.given:Given",
    "read_mesh": "mesh.files",
    "lay": "plan.trace",
    "trim": "plan.trace",
    "cut_corners": "plan.corners",
    "check": "plan.check",
    "measure": "plan.measure",
    "compare": "plan.compare",
    "coverage": "plan.coverage",
    "load_machine": "formats.profile:load",
    "read_file": "formats",
    "write_file": "formats",
    "Stream": "machine.stream",
    "FdjaxError": "errors",
    "InputError": "errors",
    "DesignError": "errors",
    "StreamError": "errors",
}
"""Module of each public name, and its name there where that is another."""

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fdjax' has no attribute {name!r}")
    home, _, own = _HOMES[name].partition(":")
    value = getattr(import_module(f"fdjax.{home}"), own or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
