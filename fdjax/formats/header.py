"""Facts in a machine file's comments, as lines `<comment> fdjax <key> = <value>`.

A value that is too long for one line goes on in lines `<comment> fdjax <key> + <more>`. Values
are written in ASCII with Python's backslash escapes for everything else, so that they survive
exactly; a space where a line begins or ends is written as `\\x20`. Lines `<comment> fdjax <word>
...` without the sign are marks (`layer`, `road`, `prime`, `end`) that the formats define.
"""

import math
import re
from collections.abc import Mapping

import numpy as np
from shapely import MultiPolygon, Polygon, from_wkt, get_parts
from shapely.errors import ShapelyError

from fdjax.errors import InputError
from fdjax.plan.toolpath import Build, Outline

VERSION = "1"
"""Of this layout of facts; the first fact of a header."""

_LONGEST_LINE = 90
_FACT = re.compile(r"\W*fdjax (\S+) ([=+])(?: (.*))?")
_MARK = re.compile(r"\W*fdjax (\w+)(.*)")


def lines(comment: str, facts: Mapping[str, str]) -> list[str]:
    """The facts as comment lines of at most 90 characters.

    >>> lines(";", {"name": "plate"})
    ['; fdjax name = plate']

    Raises `InputError` for a key that is not made of letters, digits, `_`, `-` and `.`, or is
    longer than 40.
    """
    result = []
    for key, value in facts.items():
        if not re.fullmatch(r"[\w.-]{1,40}", key, re.ASCII):
            raise InputError(
                f"note {key!r}: a key has 1 to 40 letters, digits, underscores, dashes or dots"
            )
        text = value.encode("unicode_escape").decode("ascii")
        room = _LONGEST_LINE - len(f"{comment} fdjax {key} = ") - 6  # two escaped spaces grow by 6
        pieces = [text[k : k + room] for k in range(0, len(text), room)] or [""]
        for sign, piece in zip("=" + "+" * len(pieces), pieces, strict=False):
            result.append(f"{comment} fdjax {key} {sign} {_keep_spaces(piece)}".rstrip())
    return result


def of_build(build: Build, machine: str, **more: str) -> dict[str, str]:
    """The facts that head every file: version, name, machine, layer height, origin, notes."""
    facts = {"version": VERSION, "name": build.name, "machine": machine}
    if build.layers:
        facts["layer_height"] = repr(float(build.layers[0].height))
    facts |= more
    facts["origin"] = " ".join(repr(float(value)) for value in build.origin)
    return facts | {f"note.{key}": value for key, value in build.notes.items()}


def outline_text(outline: Outline | None) -> str:
    """The outline as WKT whose numbers read back exactly; empty for None.

    Shapely's own writer rounds with some versions of GEOS.
    """
    if outline is None:
        return ""
    if isinstance(outline, Polygon):
        return f"POLYGON {_rings_text(outline)}"
    return f"MULTIPOLYGON ({', '.join(map(_rings_text, get_parts(outline)))})"


def _rings_text(polygon: Polygon) -> str:
    rings = (
        ", ".join(f"{x!r} {y!r}" for x, y in np.asarray(ring.coords)[:, :2].tolist())
        for ring in (polygon.exterior, *polygon.interiors)
    )
    return f"({', '.join(f'({ring})' for ring in rings)})"


def mark(line: str) -> tuple[str, dict[str, str]] | None:
    """Word and settings of a mark such as `; fdjax road family=xi closed=1`; None if it is none."""
    match = _MARK.match(line)
    if match is None or _FACT.match(line):
        return None
    settings = (item.partition("=") for item in match[2].split())
    return match[1], {name: value for name, _, value in settings}


class Facts:
    """Collects the facts of a file, line by line; the last value of a key counts."""

    def __init__(self) -> None:
        self._texts: dict[str, str] = {}
        self._outlines: dict[str, Outline | None] = {"": None}

    def feed(self, line: str) -> bool:
        """Take one comment line; False if it states no fact."""
        match = _FACT.match(line.rstrip("\r\n"))
        if match is None:
            return False
        key, sign, piece = match[1], match[2], match[3] or ""
        self._texts[key] = piece if sign == "=" else self._texts.get(key, "") + piece
        return True

    def get(self, key: str) -> str | None:
        """The value of a fact, or None where the file does not state it."""
        text = self._texts.get(key)
        if text is None:
            return None
        try:
            return text.encode("ascii").decode("unicode_escape")
        except ValueError:
            raise InputError(f"header: {key}: {text!r} is damaged") from None

    def numbers(self, key: str, count: int) -> tuple[float, ...] | None:
        """The value of a fact that is `count` finite numbers, or None."""
        text = self.get(key)
        if text is None:
            return None
        try:
            values = tuple(float(item) for item in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)):
            raise InputError(f"header: {key}: {text!r}; {count} finite numbers are needed")
        return values

    def positive(self, key: str) -> float | None:
        """The value of a fact that is one positive number, or None."""
        values = self.numbers(key, 1)
        if values is None:
            return None
        if values[0] <= 0:
            raise InputError(f"header: {key}: {values[0]:g} is not positive")
        return values[0]

    def outline(self) -> Outline | None:
        """The outline that was stated last, or None."""
        text = self.get("outline") or ""
        if text not in self._outlines:
            try:
                outline = from_wkt(text)
            except ShapelyError:
                outline = None
            if not isinstance(outline, Polygon | MultiPolygon):
                raise InputError(f"header: outline: {text[:40]!r} is no WKT polygon")
            self._outlines[text] = outline
        return self._outlines[text]

    @property
    def written_by_fdjax(self) -> bool:
        """Whether the file has a header of fdjax. Raises `InputError` if it is of a later one."""
        version = self.get("version")
        if version not in (None, VERSION):
            raise InputError(f"header: version {version!r} is not known here, only {VERSION}")
        return version is not None

    @property
    def notes(self) -> dict[str, str]:
        """The build's notes."""
        keys = (key for key in self._texts if key.startswith("note."))
        return {key.removeprefix("note."): self.get(key) or "" for key in keys}


def _keep_spaces(piece: str) -> str:
    if piece.startswith(" "):
        piece = "\\x20" + piece[1:]
    return piece[:-1] + "\\x20" if piece.endswith(" ") else piece
