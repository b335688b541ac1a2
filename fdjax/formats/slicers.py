"""What slicers write into comments of G-code: layers, kinds of road, heights, widths, settings.

Read are the comments of PrusaSlicer, SuperSlicer, Slic3r, OrcaSlicer, Bambu Studio, CuraEngine,
ideaMaker, Simplify3D, KISSlicer and Craftware.
"""

import re
from dataclasses import dataclass

PART = ("perimeter", "outer perimeter", "overhang", "infill", "solid", "skin", "bridge")
ASIDE = ("support", "skirt", "brim", "wipe tower", "priming", "custom")
ROLES = (*PART, *ASIDE)
"""Kinds of road: those of the part, and those that stand aside and are no part of it."""

_NAMES = {
    "outer perimeter": "external perimeter, outer wall, wall outer, perimeter path",
    "perimeter": "internal perimeter, inner wall, wall inner, inner perimeter, loop path, "
    "thin wall, gap fill, gap infill, single extrusion",
    "overhang": "overhang perimeter, overhang wall",
    "infill": "internal infill, sparse infill, fill, sparse infill path, dense infill, "
    "stacked sparse infill path, floating vertical shell, mixed, multiple",
    "solid": "solid infill, internal solid infill, solid layer, solid path, bottom surface, "
    "bottom solid infill, solid fill",
    "skin": "top solid infill, top surface, ironing, crown path",
    "bridge": "bridge infill, internal bridge infill, internal bridge, over bridge",
    "support": "support material, support material interface, support interface, dense support, "
    "support transition, raft, raft path, support (may stack) path, support interface path",
    "skirt": "skirt/brim, skirt path, ooze shield, draft shield",
    "brim": "brim path",
    "wipe tower": "prime tower, prime pillar, prime pillar path, pillar path, purge tower",
    "priming": "prime, purge, wipe (and de string) path, destring path",
    "custom": "milling",
}
ROLE_OF = {
    name: role
    for role, others in _NAMES.items()
    for name in (role, *(other.strip() for other in others.split(",")))
}
"""Role of each name that a slicer gives to a kind of road, in small letters."""

_LAYER = re.compile(
    r"LAYER_CHANGE$|CHANGE_LAYER$|LAYER:\s*(-?\d+)|Layer #\d|BEGIN_LAYER_|layer \d+, *z *=",
    re.IGNORECASE,
)
_NUMBER = r"(\d+\.?\d*|\.\d+)"
_HEIGHT = re.compile(rf"(?:LAYER_)?HEIGHT: *{_NUMBER}$|tool H{_NUMBER}|.*z_thickness={_NUMBER}")
_WIDTH = re.compile(rf"(?:LINE_)?WIDTH: *{_NUMBER}$|tool H\S+ W{_NUMBER}")
_ROLE = re.compile(r"(?:TYPE:|FEATURE:|segType:|feature )\s*(.+)$|'([^']+)'", re.IGNORECASE)
_NEXT_LAYER = re.compile(r"move to next layer \(\d+\)")
_OBJECT = re.compile(r"printing object[ ,]+(.+)|MESH:(.+)", re.IGNORECASE)


@dataclass(frozen=True)
class Stretch:
    """What comments say of the roads from a line of a file on.

    - `line`: number of the line; `layer`: count of layers begun; `raft`: whether this one lies
      under the part.
    - `role`: one of `ROLES`, "" where none is told, or a slicer's own word that is not known.
    - `height`: the last told; `earlier`: the last that was told of a road and not with the layer.
      `width`: of the road. mm, 0 where none is told.
    - `thing`: the object's name.
    """

    line: int
    layer: int = 0
    raft: bool = False
    role: str = ""
    height: float = 0.0
    earlier: float = 0.0
    width: float = 0.0
    thing: str = ""


class Comments:
    """Takes the comments of a file; `stretches` are what they say, in order."""

    def __init__(self) -> None:
        self.stretches: list[Stretch] = [Stretch(0)]
        self._begun = -9  # last line of a layer's own comments

    def feed(self, line: int, text: str) -> None:
        """Take a comment, semicolon included, of a line of this number."""
        body = text[1:].strip()
        now: dict[str, object] = {}
        if match := _LAYER.match(body):
            self._begun = line
            below = match[1] is not None and int(match[1]) < 0
            now = {"layer": self.stretches[-1].layer + 1, "raft": below}
        elif match := _HEIGHT.match(body):
            height = float(next(filter(None, match.groups())))
            now["height"] = height
            if line != self._begun + 1:
                now["earlier"] = height
            if match := _WIDTH.match(body):
                now["width"] = float(next(filter(None, match.groups())))
        elif match := _WIDTH.match(body):
            now["width"] = float(next(filter(None, match.groups())))
        elif match := _ROLE.match(body):
            name = (match[1] or match[2]).strip()
            now["role"] = ROLE_OF.get(_plain(name), name)
        elif match := _OBJECT.search(body):
            name = (match[1] or match[2]).strip()
            ended = body[:4].lower() == "stop" or name == "NONMESH"
            now["thing"] = "" if ended else name
        elif (role := ROLE_OF.get(_plain(body))) is not None:
            now["role"] = role
        if line == self._begun + 1:
            self._begun = line
        if now:
            self._add(line, now)

    def behind(self, line: int, text: str) -> None:
        """Take a comment, semicolon included, that stands behind a command, as Slic3r's do."""
        body = text[1:].strip()
        role = ROLE_OF.get(_plain(body))
        if _NEXT_LAYER.match(body):
            self._add(line, {"layer": self.stretches[-1].layer + 1})
        elif role is not None and role != self.stretches[-1].role:
            self._add(line, {"role": role})

    def thing(self, line: int, name: str) -> None:
        """The object that a command of this line begins, or "" where it ends one."""
        self._add(line, {"thing": name})

    def _add(self, line: int, changes: dict[str, object]) -> None:
        last = self.stretches[-1]
        fields = {name: getattr(last, name) for name in Stretch.__dataclass_fields__}
        self.stretches.append(Stretch(**{**fields, **changes, "line": line}))

    @property
    def layered(self) -> bool:
        """Whether comments tell the layers."""
        return self.stretches[-1].layer > 0


def _plain(name: str) -> str:
    return name.lower().replace("-", " ").replace("_", " ")


@dataclass(frozen=True)
class Settings:
    """What a slicer says of the file as a whole.

    - `slicer`: its name; `firmware`: of `fdjax.gcode.firmware`, "" where it is not told.
    - `diameters`: of filament, mm, one or one a tool; `volumetric`: whether E is mm^3 throughout.
    - `layer_height`, `first_height`: mm, 0 where they are not told.
    """

    slicer: str = ""
    firmware: str = ""
    diameters: tuple[float, ...] = ()
    volumetric: bool = False
    layer_height: float = 0.0
    first_height: float = 0.0


_SLICER = re.compile(rb"^; ?(?:generated (?:by|with) |BambuStudio|Sliced by )(\S*)", re.I | re.M)
_FIRMWARES = {
    "marlin": "marlin",
    "marlin2": "marlin",
    "marlin(volumetric)": "marlin",
    "klipper": "klipper",
    "reprapfirmware": "rrf",
    "reprap (reprap)": "rrf",
}


def settings_of(data: bytes) -> Settings:
    """What slicers' comments in a file say of it as a whole."""
    slicer = _SLICER.search(data[: 1 << 16])
    name = slicer[1].decode(errors="replace") if slicer else ""
    flavour = (_told(data, rb"gcode_flavor|FLAVOR") or "").lower()
    diameters = _told(data, rb"filament_?diameters?|fiber_dia_mm|material_diameter") or ""
    numbers = [float(text) for text in re.findall(_NUMBER, diameters)]
    if not numbers:
        each = re.findall(rb"^; ?Filament Diameter #\d+: *([\d.]+)", data[: 1 << 16], re.I | re.M)
        numbers = [float(text) for text in each]
    return Settings(
        slicer=name or ("BambuStudio" if slicer else ""),
        firmware=_FIRMWARES.get(flavour, ""),
        diameters=tuple(number for number in numbers if number > 0),
        volumetric=flavour in ("ultigcode", "marlin(volumetric)")
        or _told(data, rb"use_volumetric_e") == "1",
        layer_height=_length(_told(data, rb"layer_?height|layer_thickness_mm")),
        first_height=_length(
            _told(data, rb"first_layer_height|initial_layer_print_height|first_layer_thickness_mm")
        ),
    )


def _told(data: bytes, key: bytes) -> str | None:
    """The value of a setting: in the head or, where slicers put most, near the end."""
    names = key.replace(b"_?", b"[_ ]?")
    pattern = re.compile(rb"^; *(?:" + names + rb") *[=:,] *(.*?)\s*$", re.M | re.I)
    match = pattern.search(data[: 1 << 18]) or pattern.search(data[-(1 << 18) :])
    return match[1].decode(errors="replace") if match else None


def _length(text: str | None) -> float:
    """A length in mm; 0 for none, or for a share of another."""
    return float(text) if text is not None and re.fullmatch(_NUMBER, text) else 0.0
