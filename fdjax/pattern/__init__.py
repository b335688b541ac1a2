"""Patterns by name. Loads no JAX before a pattern is asked for."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fdjax.pattern.base import AbstractSettings

PATTERNS = {
    "isolines": "isolines:Isolines",
    "texture": "textures:Textures",
    "curve": "curves:Curves",
    "grid-lines": "map_lines:MapLines",
    "blocks": "block_lines:Multiblock",
    "mesh": "mesh:Mesh",
    "rasters": "rasters:Rasters",
    "auto": "auto:Auto",
}
"""Each kind of pattern: the file here and the settings in it. A new one is a line here."""


def settings_of(kind: str) -> "type[AbstractSettings]":
    """The settings of a kind of pattern, a frozen dataclass; its file is loaded on first use."""
    module, _, name = PATTERNS[kind].partition(":")
    return getattr(import_module(f"fdjax.pattern.{module}"), name)
