"""Lines of a unit cell from SVG: a path as text, or the paths of a file. Loads no JAX."""

import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from fontTools.pens.recordingPen import RecordingPen
from fontTools.svgLib.path import parse_path
from numpy.typing import NDArray

from fdjax.errors import InputError

Floats = NDArray[np.float64]

_STEPS = 16
"""Straight pieces of a curve."""

_LARGEST = 1_000_000
"""Bytes of an SVG file that are read."""

_UNSEEN = {"title", "desc", "metadata", "defs"}
"""Elements that a viewer does not draw, nor what is in them."""


def lines_of(path: str) -> list[Floats]:
    """The lines of an SVG path's data, each (points, 2), curves in pieces; y as it stands.

    Raises `InputError` for text that is no path.

    >>> [line.tolist() for line in lines_of("M0 0 H2 V1 Z")]
    [[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 0.0]]]
    """
    pen = RecordingPen()
    shown = path if len(path) <= 40 else path[:37] + "..."
    try:
        parse_path(path, pen)
    except (
        ValueError,
        IndexError,
        AssertionError,
        TypeError,
        KeyError,
        ZeroDivisionError,
    ) as fault:
        raise InputError(f'"{shown}" is no SVG path ({fault or type(fault).__name__})') from None
    found: list[list[Floats]] = []
    for name, points in pen.value:
        xy = [np.asarray(point, float) for point in points]
        if name == "moveTo":
            found.append(xy)
        elif not found:
            raise InputError(f'"{shown}" is no SVG path: it begins with no M')
        elif name == "lineTo":
            found[-1] += xy
        elif name in ("curveTo", "qCurveTo"):
            found[-1] += _curve(np.array([found[-1][-1], *xy]))
        elif name == "closePath" and (found[-1][-1] != found[-1][0]).any():
            found[-1].append(found[-1][0])
    lines = [np.array(line) for line in found if len(line) > 1]
    if not lines:
        raise InputError(f'"{shown}" draws no line')
    return lines


def _curve(corners: Floats) -> list[Floats]:
    """Places along a Bezier curve of these control points, but for the first (de Casteljau)."""
    places = []
    for share in np.arange(1, _STEPS + 1) / _STEPS:
        now = corners
        while len(now) > 1:
            now = now[:-1] + share * (now[1:] - now[:-1])
        places.append(now[0])
    return places


def cell_of(file: Path) -> tuple[list[Floats], tuple[float, float]]:
    """The lines of an SVG file's paths and the size of its view box; y upwards from its lower edge.

    Raises `InputError`, naming the file, for what is no SVG with a view box, for elements that are
    no paths, and for transformations.
    """
    try:
        data = file.read_bytes()
    except OSError as fault:
        raise InputError(f"{file}: cannot be read: {fault.strerror or fault}") from None
    # Entities may blow up, and no drawing needs them.
    if len(data) > _LARGEST or b"<!ENTITY" in data:
        raise InputError(f"{file}: is longer than {_LARGEST} bytes, or defines entities")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as fault:
        raise InputError(f"{file}: is no SVG: {fault}") from None
    box = _numbers(root.get("viewBox", ""))
    if _name(root) != "svg" or len(box) != 4 or not (box[2] > 0 and box[3] > 0):
        raise InputError(f"{file}: is no SVG with a viewBox, which gives the cell's size")
    lines: list[Floats] = []
    for path in _drawn(root, file, group="svg"):
        try:
            lines += lines_of(path)
        except InputError as fault:
            raise InputError(f"{file}: {fault}") from None
    if not lines:
        raise InputError(f"{file}: holds no path")
    low = np.array([box[0], box[1] + box[3]])
    return [(line - low) * [1, -1] for line in lines], (box[2], box[3])


def _drawn(element: ElementTree.Element, file: Path, *, group: str = "g") -> Iterator[str]:
    """The data of all paths that a viewer shows of an element, maybe a `group` of others."""
    name, style = _name(element), element.get("style", "")
    if element.get("display") == "none" or re.search(r"display\s*:\s*none", style):
        return
    if element.get("transform") or "transform" in style:
        raise InputError(f"{file}: a <{name}> is transformed; apply that to its points")
    if name == "path":
        yield element.get("d", "")
    elif name == group:
        for inner in element:
            # What editors note for themselves is of another namespace.
            own = _namespace(inner) == _namespace(element)
            if own and _name(inner) not in _UNSEEN:
                yield from _drawn(inner, file)
    else:
        raise InputError(f"{file}: holds a <{name}>; only paths can be drawn")


def _numbers(text: str) -> list[float]:
    """The numbers of a list with commas or blanks between; none where one is no finite number."""
    try:
        numbers = [float(word) for word in re.split(r"\s*,\s*|\s+", text.strip())]
    except ValueError:
        return []
    return numbers if np.isfinite(numbers).all() else []


def _name(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _namespace(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[0]
