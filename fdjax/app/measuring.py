"""What `fdjax measure` does: the porosity that a machine file will have, against a target."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fdjax.beside import Beside
from fdjax.errors import InputError
from fdjax.formats import read_file
from fdjax.formats.footprint import outlined, with_outlines_of
from fdjax.formats.gcode_layers import Choice
from fdjax.part.part import Part, Slab
from fdjax.part.region import Region
from fdjax.plan.compare import Comparison, compare
from fdjax.plan.coverage import coverage
from fdjax.plan.measure import Measurement, measure
from fdjax.plan.toolpath import Build, Outline
from fdjax.target.read import read as read_target
from fdjax.view import DRAW


@dataclass(frozen=True)
class Question:
    """What is asked about a file; None where the file itself says it.

    - `target`: an expression, or a picture's or `.npy` array's file; `quantity`: what it gives,
      "porosity" or "solid"; `unit`: of x, y and z in the expression; `low`, `high`: what black and
      white, or 0 and 1, stand for.
    - `window`: side of the windows, mm; `shifted`: by half a window in both directions.
    - `count`: "volume", or "coverage" for what roads cover, seen from above.
    - `outline`: WKT, or a file that holds WKT or GeoJSON, of one or more polygons;
      where there is none, that of the outermost perimeters or the footprint of the roads.
    - `layer_height`: mm; `filament`: mm, one or one a tool; `machine`: a profile's name or file;
      `firmware`: whose reading of G-code holds.
    - `choice`: which roads of the file; `tolerance`: error at which the picture's scale ends.
    """

    target: str
    quantity: str = "porosity"
    unit: str = "mm"
    low: float = 0.0
    high: float = 1.0
    window: float = 5.0
    shifted: bool = False
    count: str = "volume"
    outline: str | None = None
    layer_height: float | None = None
    filament: float | Sequence[float] | None = None
    machine: str | None = None
    firmware: str | None = None
    choice: Choice | None = None
    tolerance: float = 0.02


@dataclass(frozen=True, eq=False)
class Answer:
    """A measured file."""

    path: Path
    question: Question
    build: Build
    measurement: Measurement
    comparison: Comparison

    @cached_property
    def coverage(self) -> float:
        """Share of the outlines that roads cover, seen from above."""
        return coverage(self.build)

    @property
    def outline(self) -> Outline:
        """What all layers' outlines cover together."""
        union = shapely.union_all(self.measurement.outlines)
        assert isinstance(union, Outline)
        return union

    @property
    def worst(self) -> tuple[float, float, float]:
        """Largest error with its sign, and the middle of its window, mm."""
        error = self.comparison.error
        i, j = np.unravel_index(np.nanargmax(np.abs(error)), error.shape)
        x, y = self.measurement.x, self.measurement.y
        return float(error[i, j]), float(x[i] + x[i + 1]) / 2, float(y[j] + y[j + 1]) / 2

    @property
    def materials(self) -> dict[str, float]:
        """Volume of each material or tool, by its number, mm^3."""
        layers = self.build.layers
        number = np.concatenate([layer.materials for layer in layers])
        volume = np.concatenate([layer.road_volumes for layer in layers])
        return {str(each): float(volume[number == each].sum()) for each in np.unique(number)}

    def facts(self) -> dict[str, Any]:
        """All that was measured, as plain data for JSON; windows left out are None."""
        largest, x, y = self.worst
        layers = self.build.layers
        return {
            "file": self.path.name,
            "target": self.question.target,
            "quantity": self.question.quantity,
            "window": self.question.window,
            "shifted": self.question.shifted,
            "count": self.question.count,
            "windows": int(self.measurement.kept.sum()),
            "mean_asked": self.comparison.mean_asked,
            "mean_got": self.comparison.mean_got,
            "rms": self.comparison.rms,
            "largest": largest,
            "largest_at": [x, y],
            "coverage": self.coverage,
            "volume": self.build.volume,
            "travel": sum(layer.travel for layer in layers),
            "layers": len(layers),
            "roads": sum(len(layer.roads) for layer in layers),
            "materials": self.materials,
            "reading": dict(self.build.reading),
            "x": self.measurement.x.tolist(),
            "y": self.measurement.y.tolist(),
            "asked": _plain(self.comparison.asked),
            "got": _plain(self.comparison.got),
        }

    def table(self) -> str:
        """The measured numbers in a few lines."""
        fact = self.facts()
        x, y = fact["largest_at"]
        where = f"{fact['window']:g} mm windows{', shifted by half' * fact['shifted']}"
        counted = ", of what is covered from above" if fact["count"] == "coverage" else ""
        materials = fact["materials"] if len(fact["materials"]) > 1 else {}
        return "\n".join(
            [
                f"{fact['file']}: {fact['layers']} layers, {fact['roads']} roads",
                f"porosity asked    {fact['mean_asked']:8.4f}  mean of the part{counted}",
                f"porosity got      {fact['mean_got']:8.4f}",
                f"RMS error         {fact['rms']:8.4f}  in {fact['windows']} {where}",
                f"largest error     {fact['largest']:+8.4f}  at ({x:.4g}, {y:.4g}) mm",
                f"coverage          {fact['coverage']:8.4f}  of the outline, seen from above",
                f"volume            {fact['volume']:8.1f}  mm^3",
                *(
                    f"material {number:<9}{volume:8.1f}  mm^3, {volume / fact['volume']:.4f} of it"
                    for number, volume in materials.items()
                ),
                f"travel            {fact['travel']:8.1f}  mm inside layers",
                *(f"{what:<17} {said}" for what, said in fact["reading"].items()),
            ]
        )

    def picture(self, path: Path, beside: Beside) -> None:
        """Have the figure of asked, got and difference drawn."""
        beside.ask(
            DRAW,
            path,
            "porosity_figure",
            self.measurement.x,
            self.measurement.y,
            self.comparison.asked,
            self.comparison.got,
            outline=self.outline,
            title=self.path.name,
            weights=self.measurement.area,
            tolerance=self.question.tolerance,
        )

    def write_json(self, path: Path) -> None:
        """Write `facts` as JSON."""
        try:
            path.write_text(json.dumps(self.facts(), indent=1, allow_nan=False) + "\n")
        except OSError as fault:
            raise InputError(f"{path}: cannot be written: {fault.strerror}") from None


def answer(path: str | Path, question: Question) -> Answer:
    """Read a machine file and measure it; the plan it came from plays no part.

    Raises `InputError` for what cannot be read, a file without roads, a target that is not a
    porosity inside the outline, and a window that is too large.
    """
    path = Path(path)
    outline = None if question.outline is None else Region.of(question.outline).geometry
    options = {
        "machine": question.machine,
        "filament": question.filament,
        "layer_height": question.layer_height,
        "outline": outline,
        "firmware": question.firmware,
    }
    build = read_file(path, choice=question.choice, **options)
    if not any(layer.roads for layer in build.layers):
        raise InputError(f"{path}: holds no roads, so there is no porosity to measure")
    if any(layer.outline is None for layer in build.layers):
        choice = question.choice
        try:
            # Chosen roads lie in the outline of the whole part.
            whole = read_file(path, **options) if choice and choice.roles else build
            whole, said = outlined(whole)
        except InputError as fault:
            raise InputError(f"{path}: {fault}") from None
        build = with_outlines_of(whole, build)
        build = build.replace(reading={**build.reading, "outline": said})
    half = 0.5 if question.shifted else 0.0
    try:
        measurement = measure(
            build, window=question.window, shift=(half, half), count=question.count
        )
    except InputError as fault:
        said = build.reading.get("outline")
        more = f"; the outline is {said}, without --outline" if said else ""
        raise InputError(f"{fault}{more}") from None
    part = _part(build)
    target = read_target(
        question.target,
        extent=part.bounds,
        quantity=question.quantity,
        unit=question.unit,
        low=question.low,
        high=question.high,
    )
    target.check(part)
    return Answer(path, question, build, measurement, compare(measurement, target))


def _part(build: Build) -> Part:
    """What the build's layers fill, each outline one region."""
    regions: dict[Outline, Region] = {}
    slabs = []
    for layer in build.layers:
        assert layer.outline is not None
        parts = tuple(shapely.get_parts(layer.outline))
        region = regions.setdefault(layer.outline, Region(parts))
        slabs.append(Slab(layer.z, layer.height, region))
    return Part(tuple(slabs))


def _plain(values: np.ndarray) -> list[list[float | None]]:
    return [[None if np.isnan(v) else float(v) for v in row] for row in values]
