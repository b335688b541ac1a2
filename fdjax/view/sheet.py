"""The drawing sheet of the figures: panels placed in inches, and one quiet style for all."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter, MaxNLocator
from shapely.geometry.polygon import orient

from fdjax.plan.toolpath import Outline

INK, GREY, PAPER = "#22272e", "#6b737c", "#f6f4ef"
SMALL, NORMAL, LARGE = 7.0, 8.5, 10.0
BAR_ROOM = 0.5
"""Width of a colour bar's numbers, inches."""

_LEFT, _RIGHT, _BOTTOM, _TOP, _PANEL_TITLE = 0.55, 0.15, 0.45, 0.55, 0.24
_NARROWEST = 2.2
_FIRST_LINE, _SECOND_LINE = 0.12, 0.32


@dataclass(frozen=True)
class Box:
    """A place on the sheet, inches from the lower left corner of the drawing area."""

    left: float
    bottom: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.left + self.width

    @property
    def top(self) -> float:
        return self.bottom + self.height


class Sheet:
    """Sizes and style for panels that show one outline, equal in scale along both axes.

    - `largest`: width and height that a panel may have, inches.
    - `bounds`: least x and y, largest x and y to show, mm; by default the outline's.
    """

    def __init__(
        self,
        outline: Outline,
        *,
        largest: tuple[float, float],
        bounds: tuple[float, float, float, float] | None = None,
    ) -> None:
        x0, y0, x1, y1 = bounds or outline.bounds
        self.limits = (x0, x1), (y0, y1)
        self.inches_per_mm = min(largest[0] / (x1 - x0), largest[1] / (y1 - y0))
        self.width = self.inches_per_mm * (x1 - x0)
        self.height = self.inches_per_mm * (y1 - y0)
        self.path = compound_path(outline)

    def figure(
        self, width: float, height: float, title: str, note: str = "", *, titled: bool = False
    ) -> Figure:
        """An empty figure around a drawing area of this size, with title and a note below it.

        `titled` leaves room for the panels' own titles.
        """
        full_width = max(width, _NARROWEST) + _LEFT + _RIGHT
        full_height = height + _BOTTOM + _TOP + _PANEL_TITLE * titled
        figure = Figure(figsize=(full_width, full_height))
        lines = ((title, _FIRST_LINE, LARGE, INK), (note, _SECOND_LINE, NORMAL, GREY))
        for text, down, size, colour in lines:
            x, y = _LEFT / full_width, 1 - down / full_height
            figure.text(x, y, text, size=size, color=colour, va="top")
        return figure

    def panel(
        self,
        figure: Figure,
        box: Box,
        title: str = "",
        *,
        x_labels: bool = True,
        y_labels: bool = True,
        filled: bool = True,
    ) -> Axes:
        """Axes in mm at this box with the outline drawn."""
        axes = self._axes(figure, box)
        axes.set_xlim(*self.limits[0])
        axes.set_ylim(*self.limits[1])
        axes.set_title(title, loc="left", size=NORMAL, color=INK, pad=4)
        for side in axes.spines.values():
            side.set_visible(False)
        axes.tick_params(color=GREY, labelcolor=GREY, labelsize=SMALL, width=0.5, length=2.5)
        axes.tick_params(bottom=x_labels, labelbottom=x_labels, left=y_labels, labelleft=y_labels)
        for axis, inches in ((axes.xaxis, box.width), (axes.yaxis, box.height)):
            axis.set_major_locator(
                MaxNLocator(int(np.clip(2.2 * inches, 2, 8)), steps=[1, 2, 5, 10])
            )
        if x_labels:
            axes.set_xlabel("x, mm", size=SMALL, color=GREY, labelpad=2)
        if y_labels:
            axes.set_ylabel("y, mm", size=SMALL, color=GREY, labelpad=2)
        if filled:
            axes.add_patch(PathPatch(self.path, facecolor=PAPER, edgecolor="none", zorder=0))
        axes.add_patch(
            PathPatch(self.path, facecolor="none", edgecolor=INK, lw=0.8, zorder=4, clip_on=False)
        )
        return axes

    def hatch(self, axes: Axes) -> None:
        """Hatch the outline, below what is drawn there: what stays bare is known to be nothing."""
        axes.add_patch(
            PathPatch(self.path, facecolor="none", edgecolor=GREY, hatch="/////", lw=0, zorder=0.5)
        )

    def colour_bar(
        self,
        figure: Figure,
        box: Box,
        shown: ScalarMappable,
        *,
        signed: bool = False,
        extend: str = "neither",
    ) -> None:
        """The colour scale of `shown` at this box; `extend` as in Matplotlib."""
        bar = figure.colorbar(shown, cax=self._axes(figure, box), extend=extend)
        bar.outline.set_visible(False)
        bar.ax.tick_params(color=GREY, labelcolor=GREY, labelsize=SMALL, width=0.5, length=2.5)
        bar.locator = MaxNLocator(int(np.clip(2 * box.height, 3, 7)), steps=[1, 2, 2.5, 5, 10])
        if signed:
            bar.formatter = FuncFormatter(lambda v, _: f"{v:+.3g}".replace("-", "−") if v else "0")
        bar.update_ticks()

    def legend(self, figure: Figure, handles: Sequence[Artist]) -> None:
        """Names of what is drawn, in one line below the title."""
        width, height = figure.get_size_inches()
        figure.legend(
            handles=list(handles), ncols=len(handles), loc="upper left", frameon=False,
            fontsize=NORMAL, labelcolor=GREY, handlelength=1.4, columnspacing=1.6, borderpad=0,
            borderaxespad=0, bbox_to_anchor=(_LEFT / width, 1 - _SECOND_LINE / height),
        )  # fmt: skip

    @staticmethod
    def _axes(figure: Figure, box: Box) -> Axes:
        width, height = figure.get_size_inches()
        place = (_LEFT + box.left) / width, (_BOTTOM + box.bottom) / height
        return figure.add_axes((*place, box.width / width, box.height / height))


def compound_path(outline: Outline) -> Path:
    """The outline with its holes as one path: shells counter-clockwise, holes clockwise."""
    rings = []
    for part in shapely.get_parts(outline):
        turned = orient(part)
        rings += [turned.exterior, *turned.interiors]
    return Path.make_compound_path(*(Path(np.asarray(ring.coords), closed=True) for ring in rings))
