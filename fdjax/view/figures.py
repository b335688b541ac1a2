"""Pictures of a design: its lines over the outline, and the porosity asked, got and missed.

Matplotlib's object interface only: nothing global is touched and no window is ever opened.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

from fdjax.errors import InputError
from fdjax.plan.toolpath import Outline
from fdjax.view.sheet import BAR_ROOM, Box, Sheet

Floats = NDArray[np.float64]

XI_COLOUR, ETA_COLOUR = "#1b5e9e", "#d1603d"
SHARE_COLOURS, ERROR_COLOURS = "viridis", "RdBu_r"
_SMALLEST_SCALE = 0.05
"""Span of the colour scale at least: an even porosity shall look even."""


def grid_figure(
    outline: Outline,
    xi_lines: Iterable[ArrayLike],
    eta_lines: Iterable[ArrayLike],
    *,
    title: str = "",
) -> Figure:
    """Roads or grid lines of a xi layer and of an eta layer over the outline and its holes.

    `xi_lines` and `eta_lines` are polylines, each of shape (points, 2), in mm; `title` stands
    above.
    """
    sheet = Sheet(outline, largest=(5.6, 6.4))
    box = Box(0, 0, sheet.width, sheet.height)
    figure = sheet.figure(box.width, box.height, title)
    axes = sheet.panel(figure, box)
    names = []
    families = (("ξ lines", xi_lines, XI_COLOUR), ("η lines", eta_lines, ETA_COLOUR))
    for name, lines, colour in families:
        lines = [np.asarray(line, dtype=float) for line in lines]
        stroke = _stroke(outline, lines, 72 * sheet.inches_per_mm)
        axes.add_collection(
            LineCollection(lines, colors=colour, linewidths=stroke, capstyle="round", zorder=2)
        )
        names.append(Line2D([], [], color=colour, linewidth=1.4, label=name))
    sheet.legend(figure, names)
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
) -> Figure:
    """Windows in three panels: asked and got on one colour scale, and got less asked.

    - `x_edges`, `y_edges`: of the windows, shapes (nx + 1,), (ny + 1,), mm.
    - `asked`, `got`: shape (nx, ny); NaN in a window that is left out, which stays blank.
    - `outline`: drawn, and windows are shown inside it only.
    - `weights`: area of each window, for the RMS error in the heading; alike if not given.

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
    summary = f"RMS error {rms:.4f}, largest {largest:+.4f}".replace("-", "−")
    figure = sheet.figure(width, height, title or quantity.capitalize(), summary, titled=True)
    share = _share_scale(np.stack([asked[counted], got[counted]]))
    half = max(abs(largest), 1e-6)
    drawings = (
        (f"{quantity} asked", asked, share, SHARE_COLOURS),
        (f"{quantity} got", got, share, SHARE_COLOURS),
        ("got less asked", error, Normalize(-half, half), ERROR_COLOURS),
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
        mesh = axes.pcolormesh(
            np.asarray(x_edges), np.asarray(y_edges), shown, norm=scale, cmap=colours,
            rasterized=True, zorder=1,
        )  # fmt: skip
        mesh.set_clip_path(sheet.path, axes.transData)
        meshes.append(mesh)
    sheet.colour_bar(figure, shared, meshes[1])
    sheet.colour_bar(figure, own, meshes[2], signed=True)
    return figure


def save(figure: Figure, path: str | Path, *, dpi: int = 200) -> None:
    """Write the figure to a file of the format that its suffix names: png, pdf or svg.

    Raises `InputError` for another suffix and for a place that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise InputError(f"{path}: a picture is written as .png, .pdf or .svg")
    try:
        figure.savefig(path, dpi=dpi, facecolor="white")
    except OSError as fault:
        raise InputError(f"{path}: cannot be written: {fault.strerror or fault}") from None


def _stroke(outline: Outline, lines: list[Floats], points_per_mm: float) -> float:
    """Line width in points: a quarter of the mean gap between the lines, within reason."""
    total = sum(float(np.hypot(*np.diff(line, axis=0).T).sum()) for line in lines)
    gap = outline.area / total if total > 0 else outline.length
    return float(np.clip(0.25 * gap * points_per_mm, 0.2, 0.8))


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
