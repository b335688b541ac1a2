"""Porosity-optimised toolpaths for fused deposition.

Public names are loaded on first use, so that what needs no JAX does not load it.
"""

from importlib import import_module
from typing import Any

_HOMES = {
    "rectangle": "domain.patch",
    "cosine_top": "domain.patch",
    "from_curves": "domain.patch",
    "from_polygon": "domain.patch",
    "contour": "domain.contour",
    "Target": "design.target",
    "expression": "design.target",
    "design": "design.design",
    "lay": "plan.trace",
    "check": "plan.check",
    "measure": "plan.measure",
    "compare": "plan.measure",
    "coverage": "plan.coverage",
    "load_machine": "formats.profile",
    "read_file": "formats",
    "write_file": "formats",
    "FdjaxError": "errors",
    "InputError": "errors",
    "DesignError": "errors",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fdjax' has no attribute {name!r}")
    value = getattr(import_module(f"fdjax.{_HOMES[name]}"), name)
    globals()[name] = value
    return value
