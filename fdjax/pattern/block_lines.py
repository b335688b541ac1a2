"""Lines of several blocks that share sides: what a user says of them, and how they begin."""
# ruff: noqa: RUF009 - `key` gives a dataclass field

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from fdjax.errors import InputError
from fdjax.grid import joined
from fdjax.grid.algebraic import Transfinite
from fdjax.keys import FLAG, Kind, Place, choices, key, pair, points, show, whole
from fdjax.limits import Limits
from fdjax.part import curve
from fdjax.part.blocking import blocks_of
from fdjax.part.blocks import Blocks
from fdjax.part.part import Part
from fdjax.pattern.base import AbstractSettings, mode_key, phases_key, road_width_key
from fdjax.pattern.block_counts import Demand
from fdjax.pattern.block_pattern import BlockControls, BlockLines, Places, Structure
from fdjax.pattern.map_domain import polygon_of
from fdjax.pattern.width import free_of
from fdjax.programs import program
from fdjax.road.porosity import Samples
from fdjax.target.target import Target

CORNERS = points(4, 4)
SHAPES = {"polyline": points(2), "arc": points(3, 3), "spline": points(2)}
MAKE = {"polyline": curve.polyline, "spline": curve.smooth, "arc": lambda xy: curve.arc(*xy)}


def _blocks(value: Any, place: Place) -> Any:
    if not isinstance(value, list) or not value:
        raise place.error(f"{show(value)} must be a list of blocks, each of four corners")
    return tuple(CORNERS.read(four, place.at(f"[{k}]")) for k, four in enumerate(value))


def _curves(value: Any, place: Place) -> Any:
    if not isinstance(value, list):
        raise place.error(f"{show(value)} must be a list in [ ]")
    found = []
    for k, each in enumerate(value):
        if not isinstance(each, dict) or len(each) != 1 or next(iter(each)) not in SHAPES:
            raise place.at(f"[{k}]").error(
                f"{show(each)} is no curve; write {{polyline = [[x, y], ...]}}, {{spline = ...}} "
                "or {arc = [start, through, end]}"
            )
        (shape, xy), *_ = each.items()
        found.append((shape, SHAPES[shape].read(xy, place.at(f"[{k}].{shape}"))))
    return tuple(found)


Corners = tuple[tuple[float, float], ...]

BLOCKS = Kind("list of blocks, each of 4 corners `[x, y]`", _blocks)
CURVES = Kind("list of `{polyline = points}`, `{spline = points}`, `{arc = 3 points}`", _curves)

KNOTS = 14
"""Most coefficients of a band's spacing across it."""

ROWS, MOST_ROWS = 1.5, 16
"""Windows between the places along a band at which its spacing is free, and most of these."""

SAMPLES = 5
"""Places within a window, along either axis, at which design looks."""


@dataclass(frozen=True)
class Multiblock(AbstractSettings):
    """Lines of blocks that share sides, each block with a transfinite map of its own.

    For parts of one region. Lengths in mm; see the job's keys for what each value means.
    """

    blocks: Any = key(
        BLOCKS, "corners of the blocks, mm", default=None, shown="found by themselves"
    )
    curves: Any = key(CURVES, "of sides within the part that are not straight, mm", default=[])
    smooth: bool = key(FLAG, "whether lines run through shared sides without a kink", default=False)
    mode: str = mode_key()
    phases: int = phases_key()
    road_width: float = road_width_key()
    field_knots: tuple[int, int] = key(
        pair(whole(4, 64)), "spline coefficients of the road width along x and y", default=[8, 6],
        table="design",
    )  # fmt: skip
    controls: tuple[str, ...] = key(
        choices("spacing", "spacing_field", "width", "width_field", least=0),
        "what the design may change; nothing with `[]`", default=["spacing_field"], table="design",
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name in ("width", "spacing"):
            if name in self.controls and f"{name}_field" in self.controls:
                raise InputError(f"controls: {name} and {name}_field exclude each other")
        if self.curves and self.blocks is None:
            raise InputError("curves are for blocks that are named")

    @property
    def corrections(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Walls and cuts lay what the model knows in the mean only."""
        return 2 if self.controls else 0

    def begin(self, part: Part, target: Target, limits: Limits, window: float) -> BlockLines:
        """Blocks, their bands, and numbers of lines as the target asks.

        Raises `InputError` for a part of several regions, blocks that do not fit or are not found,
        and a target that varies along z or is beyond what spacing and span allow.
        """
        polygon = polygon_of(part, target, "lines of blocks need one region on all layers")
        if self.blocks is None:
            blocks = blocks_of(polygon, self.road_width)
        else:
            given = [MAKE[shape](xy) for shape, xy in self.curves]
            blocks = Blocks.of(polygon, self.blocks, given)
        if self.smooth:
            # Along lines as the maps have it, so that spacings, too, go on smoothly.
            lengths = blocks.extents[:, ::-1]
            blocks, base = joined.smoothed(blocks)
        else:
            base, lengths = Transfinite(joined.stacked_sides(blocks)), blocks.lengths
        stacking, height = self.stacking(len(part.slabs)), part.slabs[0].height
        demand = Demand.of(
            blocks, base, target, width=self.road_width, height=height, stacking=stacking,
            limits=limits,
        )  # fmt: skip
        if self.controls:
            blocks = demand.cut()
        each, _ = demand.counts(blocks.cuts)
        structure = Structure.of(blocks)
        lines = [each[band.stretches[0].block, band.stretches[0].axis] for band in structure.bands]
        longest = max(side.length for side in blocks.sides.values())
        count = int(np.clip(np.ceil(SAMPLES * longest / window), 16, 56))
        low, high = np.reshape(polygon.bounds, (2, 2))
        pattern = BlockLines(
            base=base,
            places=Places.of(blocks, lengths),
            lines=jnp.asarray(lines) * stacking.phases,
            width=self.road_width,
            width_range=limits.road_width,
            height=height,
            first=self._first(structure, blocks, limits, window),
            samples=Samples.between(_edges(count)),
            box=jnp.asarray(np.stack([low, high])),
            structure=structure,
            stacking=stacking,
            smooth=self.smooth,
        )
        skew = jnp.maximum(0.9, 1.02 * _skew(pattern))
        return eqx.tree_at(lambda p: p.skew_limit, pattern, skew)

    def _first(
        self, structure: Structure, blocks: Blocks, limits: Limits, window: float
    ) -> BlockControls:
        """The controls to start from: even spacing."""
        if not self.controls:
            return BlockControls()
        free = free_of(self.road_width, *limits.road_width)
        widths = {"width": jnp.asarray(free), "width_field": jnp.full(self.field_knots, free)}
        width = next(
            (jnp.asarray(widths[k], jnp.float64) for k in widths if k in self.controls), None
        )
        spacing = None
        if {"spacing", "spacing_field"} & set(self.controls):
            across, along = _sizes(structure, blocks)
            knots = int(np.clip(np.ceil(across / (0.75 * window)) + 3, 5, KNOTS))
            rows = [
                int(np.clip(np.ceil(size / (ROWS * window)), 3, MOST_ROWS)) + 3 * (not band.closed)
                for band, size in zip(structure.bands, along, strict=True)
            ]
            spacing = tuple(
                jnp.zeros((1 if "spacing" in self.controls else own, knots)) for own in rows
            )
        return BlockControls(spacing, jnp.zeros(len(structure.bands)), width)


def _edges(count: int) -> Any:
    """Edges of parts of [0, 1], half as long at its ends: lines are drawn out most along walls."""
    even = np.linspace(0, 1, count + 1)
    return (even + (1 - np.cos(np.pi * even)) / 2) / 2


def _sizes(structure: Structure, blocks: Blocks) -> tuple[float, list[float]]:
    """Largest size of a band across it, and the size of each along it, mm."""
    across, along = [], []
    for band in structure.bands:
        sides = [(s.block, k) for s in band.stretches for k in ((0, 2), (3, 1))[s.axis]]
        beside = [(s.block, k) for s in band.stretches for k in ((3, 1), (0, 2))[s.axis]]
        lengths = [[blocks.side(*each).length for each in some] for some in (sides, beside)]
        across.append(max(lengths[0]))
        along.append(sum(lengths[1]) / 2)
    return max(across), along


@program
def _skew(pattern: BlockLines) -> Any:
    return pattern.realise(pattern.first).lattice.along.skew
