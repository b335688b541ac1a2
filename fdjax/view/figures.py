"""Pictures of a design: roads as wide as they are, porosity, functions.

Matplotlib's object interface only: nothing global is touched and no window is ever opened.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

from fdjax.errors import InputError
from fdjax.plan.toolpath import Layer, Outline, Road
from fdjax.view.sheet import BAR_ROOM, INK, Box, Sheet
from fdjax.view.strips import strips

Floats = NDArray[np.float64]

XI_COLOUR, ETA_COLOUR = "#1b5e9e", "#d1603d"
FAMILIES = {
    "xi": ("ξ roads", XI_COLOUR, "#a9c8e6"),
    "eta": ("η roads", ETA_COLOUR, "#f2bfa9"),
    "": ("roads", "#3d7a4e", "#b5d6bd"),
}
"""Name of a family's roads in a legend, colour of their centre lines, colour of their beads."""

MATERIALS = (
    ("material {}", "#3d7a4e", "#b5d6bd"),
    ("material {}", "#a8572c", "#efb98f"),
    ("material {}", "#44509e", "#b9c0e6"),
    ("material {}", "#7d6b14", "#e4d78a"),
)
"""The same of roads where there are several materials, in turn."""

SHARE_COLOURS, ERROR_COLOURS = "viridis", "RdBu_r"
FAR_UNDER, FAR_OVER = "#12071f", "#ffd500"
"""Of errors beyond the tolerance: no colour of the scale."""
_LETTERS = 15.0
"""Letters of a heading that fit in an inch."""
_SMALLEST_SCALE = 0.05
"""Span of the colour scale at least: an even porosity shall look even."""


def roads_figure(
    layers: Sequence[Layer], *, outline: Outline | None = None, title: str = ""
) -> Figure:
    """The roads of some layers side by side, each as wide as it is.

    Beads are filled strips, centre lines run in the middle; travel is a thin dashed line, and a dot
    is where a layer starts. `outline` is drawn where a layer has none of its own; without either,
    the box around the roads. Raises `InputError` when there are no roads at all.
    """
    layers = [layer for layer in layers if layer.roads]
    if not layers:
        raise InputError("roads figure: there are no roads")
    outlines = [layer.outline or outline or _box_of(layer) for layer in layers]
    whole = shapely.box(*shapely.total_bounds(outlines))
    wide = _is_wide(whole)
    largest = (8.4, 7.0 / len(layers)) if wide else (8.8 / len(layers), 6.0)
    kinds = _kinds(layers)
    sheets = [Sheet(own, largest=largest, bounds=whole.bounds) for own in outlines]
    w, h = sheets[0].width, sheets[0].height
    names = [
        f"z {layer.z:.4g} mm: {_counted(len(layer.roads), 'road')}"
        + (f", {layer.travel:,.0f} mm travel" if layer.travel > 0 else "")
        for layer in layers
    ]
    named = (max(map(len, names)) + 1) / _LETTERS
    gap = max(0.22, named - w)
    boxes = [
        Box(0, (len(layers) - 1 - k) * (h + 0.42), w, h) if wide else Box(k * (w + gap), 0, w, h)
        for k in range(len(layers))
    ]
    width = max(boxes[-1].right, boxes[-1].left + named)
    figure = sheets[0].figure(width, boxes[0].top, title, titled=True)
    for k, (layer, sheet, box) in enumerate(zip(layers, sheets, boxes, strict=True)):
        bottom, left = not wide or k == len(layers) - 1, wide or k == 0
        axes = sheet.panel(figure, box, names[k], x_labels=bottom, y_labels=left)
        fine = min(0.4, 12 * sheet.inches_per_mm * min(float(r.width.min()) for r in layer.roads))
        for road in layer.roads:
            _, line, bead = kinds[_kind(road, kinds)]
            axes.add_collection(PathCollection(strips(road), facecolor=bead, lw=0, zorder=1.5))
            axes.plot(*road.path.T, color=line, lw=fine, solid_joinstyle="round", zorder=2)
        travels = [
            np.stack([first.path[-1], second.path[0]])
            for first, second in zip(layer.roads[:-1], layer.roads[1:], strict=True)
        ]
        axes.add_collection(
            LineCollection(travels, colors=INK, linewidths=0.5, linestyles="--", zorder=5)
        )
        axes.plot(*layer.roads[0].path[0], "o", color=INK, ms=4, zorder=6, clip_on=False)
    found = {_kind(road, kinds) for each in layers for road in each.roads}
    shown = [
        Line2D([], [], color=bead, linewidth=5, label=name)
        for kind, (name, _, bead) in kinds.items()
        if kind in found
    ]
    shown.append(Line2D([], [], color=INK, linewidth=0.7, linestyle="--", label="travel"))
    shown.append(Line2D([], [], color=INK, lw=0, marker="o", ms=4, label="start"))
    sheets[0].legend(figure, shown)
    return figure


def _kinds(layers: Sequence[Layer]) -> dict[str, tuple[str, str, str]]:
    """Names and colours of roads: by material where there are several, else by family."""
    found = sorted({road.material for layer in layers for road in layer.roads})
    if len(found) < 2:
        return FAMILIES
    looks = [MATERIALS[k % len(MATERIALS)] for k in range(len(found))]
    return {
        str(number): (name.format(number), line, bead)
        for number, (name, line, bead) in zip(found, looks, strict=True)
    }


def _kind(road: Road, kinds: dict[str, tuple[str, str, str]]) -> str:
    if kinds is not FAMILIES:
        return str(road.material)
    return road.family if road.family in FAMILIES else ""


def functions_figure(
    panels: Sequence[tuple[str, ArrayLike, ArrayLike, ArrayLike]],
    *,
    outline: Outline,
    title: str = "",
    unit: str = "",
) -> Figure:
    """Functions of the place side by side inside the outline, on one scale about zero.

    `panels`: of each its name, x and y of a lattice (mm), shapes (n,) and (m,) or both (n, m), and
    values (n, m). The scale ends where all but one in a hundred of the values inside do, so that
    one corner does not pale the rest; what is beyond has the colour of its end.
    """
    wide = _is_wide(outline)
    sheet = Sheet(outline, largest=(6.4, 2.6) if wide else (3.9, 4.4))
    w, h = sheet.width, sheet.height
    count = len(panels)
    gap = max(0.22, 1.3 - w)
    boxes = [
        Box(0, (count - 1 - k) * (h + 0.42), w, h) if wide else Box(k * (w + gap), 0, w, h)
        for k in range(count)
    ]
    drawn = [(name, *_lattice(x, y, values)) for name, x, y, values in panels]
    inside = [
        values[shapely.contains_xy(outline, x, y) & np.isfinite(values)]
        for _, x, y, values in drawn
    ]
    sizes = np.abs(np.concatenate(inside))
    half = max(float(np.quantile(sizes, 0.99)) if sizes.size else 0.0, 1e-12)
    beyond = "both" if sizes.size and sizes.max() > 1.01 * half else "neither"
    note = "; ".join(
        f"{name.split()[0]} from {each.min():.3g} to {each.max():.3g}".replace("-", "−")
        for (name, *_), each in zip(drawn, inside, strict=True)
        if each.size
    )
    bar = Box(w + 0.1, 0, 0.11, boxes[0].top) if wide else Box(boxes[-1].right + 0.1, 0, 0.11, h)
    note = f"{note} {unit}".strip()
    figure = sheet.figure(bar.right + BAR_ROOM + 0.1, boxes[0].top, title, note, titled=True)
    mesh = None
    for k, (box, (name, x, y, values)) in enumerate(zip(boxes, drawn, strict=True)):
        bottom, left = not wide or k == count - 1, wide or k == 0
        axes = sheet.panel(figure, box, name, x_labels=bottom, y_labels=left, filled=False)
        mesh = axes.pcolormesh(
            x, y, np.ma.masked_invalid(values), norm=Normalize(-half, half), cmap=ERROR_COLOURS,
            shading="gouraud" if np.isfinite(values).all() else "nearest", rasterized=True,
            zorder=1,
        )  # fmt: skip
        mesh.set_clip_path(sheet.path, axes.transData)
    if mesh is not None:
        sheet.colour_bar(figure, bar, mesh, signed=True, extend=beyond)
    return figure


def porosity_figure(
    x_edges: ArrayLike,
    y_edges: ArrayLike,
    asked: ArrayLike,
    got: ArrayLike,
    *,
    outline: Outline,
    title: str = "",
    quantity: str = "porosity",
    weights: ArrayLike | None = None,
    tolerance: float | None = None,
) -> Figure:
    """Windows in three panels: asked and got on one colour scale, and got less asked.

    - `x_edges`, `y_edges`: of the windows, shapes (nx + 1,), (ny + 1,), mm.
    - `asked`, `got`: shape (nx, ny); NaN in a window that is left out, which is hatched.
    - `outline`: drawn, and windows are shown inside it only.
    - `weights`: area of each window, for the RMS error in the heading; alike if not given.
    - `tolerance`: where the error's scale ends, so that pictures can be compared; what is beyond
      is marked in colours of its own. By default it ends at the largest error.

    A ring is drawn where the error is largest; the heading says where, and how large windows are,
    if there is room.

    Raises `InputError` when every window is left out.
    """
    asked, got = np.asarray(asked, dtype=float), np.asarray(got, dtype=float)
    error = got - asked
    counted = np.isfinite(error)
    if not counted.any():
        raise InputError("porosity figure: no window is half inside the outline; take smaller ones")
    missed = error[counted]
    area = None if weights is None else np.asarray(weights, dtype=float)[counted]
    rms = float(np.sqrt(np.average(missed**2, weights=area)))
    largest = float(missed[np.argmax(np.abs(missed))])

    stacked = _is_wide(outline)
    sheet = Sheet(outline, largest=(6.4, 2.4) if stacked else (2.9, 3.6))
    boxes, shared, own = _rows(sheet) if stacked else _columns(sheet)
    width, height = own.right + BAR_ROOM, boxes[0].top
    x, y = np.asarray(x_edges, dtype=float), np.asarray(y_edges, dtype=float)
    i, j = np.argwhere(counted)[np.argmax(np.abs(missed))]
    place = float(x[i] + x[i + 1]) / 2, float(y[j] + y[j + 1]) / 2
    summary = f"RMS error {rms:.4f}, largest {largest:+.4f}"
    more = f" at ({place[0]:.4g}, {place[1]:.4g}) mm, windows of {x[1] - x[0]:.4g} mm"
    if tolerance is not None and len(summary + more) < _LETTERS * width:
        summary += more
    summary = summary.replace("-", "−")
    figure = sheet.figure(width, height, title or quantity.capitalize(), summary, titled=True)
    share = _share_scale(np.stack([asked[counted], got[counted]]))
    half = tolerance or max(abs(largest), 1e-6)
    extremes = colormaps[ERROR_COLOURS].with_extremes(under=FAR_UNDER, over=FAR_OVER)
    drawings = (
        (f"{quantity} asked", asked, share, colormaps[SHARE_COLOURS]),
        (f"{quantity} got", got, share, colormaps[SHARE_COLOURS]),
        ("got less asked", error, Normalize(-half, half), extremes),
    )
    meshes = []
    for k, (box, (name, values, scale, colours)) in enumerate(zip(boxes, drawings, strict=True)):
        axes = sheet.panel(
            figure,
            box,
            name,
            x_labels=not stacked or k == 2,
            y_labels=stacked or k == 0,
            filled=False,
        )
        shown = np.ma.masked_array(values, ~counted).T
        sheet.hatch(axes)
        mesh = axes.pcolormesh(
            x, y, shown, norm=scale, cmap=colours, rasterized=True, zorder=1,
        )  # fmt: skip
        mesh.set_clip_path(sheet.path, axes.transData)
        meshes.append(mesh)
    sheet.colour_bar(figure, shared, meshes[1])
    meshes[2].axes.plot(*place, "o", mfc="none", mec=INK, ms=6, mew=0.8, zorder=5)
    beyond = bool(tolerance) and abs(largest) > half
    sheet.colour_bar(figure, own, meshes[2], signed=True, extend="both" if beyond else "neither")
    return figure


def draw(path: str | Path, kind: str, *arguments: Any, **options: Any) -> None:
    """Save the figure that the function `kind` of this module makes of the rest; see `save`."""
    save(globals()[kind](*arguments, **options), path)


def save(figure: Figure, path: str | Path, *, dpi: int = 200) -> None:
    """Write the figure to a file of the format that its suffix names: png, pdf or svg.

    Raises `InputError` for another suffix and for a place that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise InputError(f"{path}: a picture is written as .png, .pdf or .svg")
    # Less time than by the usual compression, for files of about the same size.
    less: dict[str, Any] = (
        {"pil_kwargs": {"compress_level": 3}} if path.suffix.lower() == ".png" else {}
    )
    try:
        figure.savefig(path, dpi=dpi, facecolor="white", **less)
    except OSError as fault:
        raise InputError(f"{path}: cannot be written: {fault.strerror or fault}") from None


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _box_of(layer: Layer) -> Outline:
    """The box around what the layer's roads cover."""
    ends = [
        shapely.box(
            *(road.xy.min(0) - road.width.max() / 2), *(road.xy.max(0) + road.width.max() / 2)
        )
        for road in layer.roads
    ]
    return shapely.box(*shapely.union_all(ends).bounds)


def _lattice(x: ArrayLike, y: ArrayLike, values: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """x, y and values of a lattice as arrays of one shape."""
    x, y, values = (np.asarray(each, dtype=float) for each in (x, y, values))
    if x.ndim == 1:
        x, y = np.meshgrid(x, y, indexing="ij")
    return x, y, values


def _is_wide(outline: Outline) -> bool:
    x0, y0, x1, y1 = outline.bounds
    return x1 - x0 > 2.2 * (y1 - y0)


def _columns(sheet: Sheet) -> tuple[list[Box], Box, Box]:
    """Three panels side by side, the shared bar after the second, the error's own at the end."""
    w, h, bar = sheet.width, sheet.height, 0.11
    gap = max(0.22, 1.05 - w)  # room for the panels' titles
    first, second = Box(0, 0, w, h), Box(w + gap, 0, w, h)
    shared = Box(second.right + 0.1, 0, bar, h)
    third = Box(shared.right + BAR_ROOM + gap, 0, w, h)
    return [first, second, third], shared, Box(third.right + 0.1, 0, bar, h)


def _rows(sheet: Sheet) -> tuple[list[Box], Box, Box]:
    """Three panels one above the other, the shared bar along the first two."""
    w, h, gap, bar = sheet.width, sheet.height, 0.42, 0.11
    third, second, first = (Box(0, k * (h + gap), w, h) for k in range(3))
    shared = Box(w + 0.1, second.bottom, bar, first.top - second.bottom)
    return [first, second, third], shared, Box(w + 0.1, 0, bar, h)


def _share_scale(values: Floats) -> Normalize:
    low, high = float(values.min()), float(values.max())
    room = max(0.0, _SMALLEST_SCALE - (high - low)) / 2
    return Normalize(low - room, high + room)
