"""Files as others write them, after the nature of public reports, with their right answers.

The mat: 20 x 20 mm at (40, 40), two layers of 0.2 mm, ten roads of 1.6 mm^3: 16 mm^3 in 160 mm^3,
porosity .900.

    python tests/app/others_files.py

prints what is right and what is seen, side by side.
"""

import contextlib
import io
import json
import math
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fdjax.app.cli import main as fdjax

SQUARE = "POLYGON((40 40,60 40,60 60,40 60,40 40))"
AREA = math.pi / 4 * 1.75**2
E = 1.6 / AREA
"""mm of filament in a road of the mat."""

HEAT = "M140 S60\nM104 S210\nG21\nG90\nG28\nM190 S60\nM109 S210\n"
END = "M104 S0\nM140 S0\nM84\n"


def road(layer: int, number: int, push: Callable[[int], str], *, line: str = "G1") -> str:
    """One road of the mat; `push` gives its word of filament from its number in the file."""
    at = 42 + 4 * number
    from_, to = (f"X40 Y{at}", f"X60 Y{at}") if layer % 2 == 0 else (f"X{at} Y40", f"X{at} Y60")
    return f"G0 {from_} F6000\n{line} {to} {push(5 * layer + number)} F1200\n"


def relative(number: int) -> str:
    return f"E{E:.5f}"


def absolute(number: int) -> str:
    return f"E{E * (number + 1):.5f}"


def mat(
    *,
    heights: tuple[float, ...] = (0.2, 0.4),
    start: str = HEAT,
    mode: str = "M83\n",
    push: Callable[[int], str] = relative,
    before: Callable[[int], str] = lambda layer: "",
    after: Callable[[int], str] = lambda layer: "",
    line: str = "G1",
    end: str = END,
) -> str:
    """The mat; `before` and `after` give what stands round each layer, from its number."""
    text = start + mode
    for layer, z in enumerate(heights):
        text += before(layer) + f"G1 Z{z:g} F600\n"
        text += "".join(road(layer, number, push, line=line) for number in range(5))
        text += after(layer)
    return text + end


PRIME = "G1 Z0.3 F600\nG0 X5 Y20 F6000\nG1 X5 Y180 E15 F1200\nG0 X5.4 Y180 F6000\nG1 X5.4 Y20 E15\n"


@dataclass(frozen=True)
class Case:
    """A file, what is asked of it, and the right answer.

    - `right`: the porosity, or words of the message that refuses it.
    - `options`: of `fdjax measure` besides target, outline and filament.
    """

    name: str
    text: str
    right: float | str
    options: tuple[str, ...] = ()
    filament: str | None = "1.75"
    encoding: str = "utf-8"


def spline(layer_roads: int, ends: str) -> str:
    text = HEAT + "M83\nG1 Z0.2 F600\n"
    for number in range(layer_roads):
        y = 42 + 4 * number
        text += f"G0 X40 Y{y} F6000\nG1 X50 Y{y} E{E / 2:.5f} F1200\n"
        text += f"G5 X60 Y{y} {ends} E{E / 2:.5f}\n"
    return text + END


def layered(*comments: str) -> Callable[[int], str]:
    """Comments of a layer, with its number and the Z and height of the mat's."""
    return lambda layer: "".join(
        f"{each.format(layer, layer + 1, z=0.2 * (layer + 1))}\n" for each in comments
    )


BOARD = (1.2, 1.4)

CASES = [
    # Settings that scale.
    Case("flow_none", mat(), 0.9),
    Case("flow_m221", mat(mode="M83\nM221 S95\n"), 0.905),
    Case("flow_m221_second_layer", mat(before=lambda n: "M221 S50\n" * n), 0.925),
    Case("flow_m221_of_a_tool", mat(mode="M83\nM221 T0 S95\nM221 T1 S5\n"), 0.905),
    Case("flow_m221_back", mat(after=lambda n: f"M221 S{(50, 100)[n]}\n"), 0.925),
    Case("flow_m200", mat(mode="M83\nM200 D1.75\n", push=lambda n: "E1.6"), 0.9),
    Case("flow_m200_off", mat(mode="M83\nM200 D1.75\nM200 D0\n"), 0.9),
    # Offsets and modes.
    Case("g92_1", mat(mode="M83\nG92 X10 Y10\nG92.1\n"), "line 10: G92.1 ends the shift"),
    Case("g92_1_of_nothing", mat(mode="M83\nG92.1\n"), 0.9),
    Case("g92_z", mat(mode="G92 Z12\nG91\nG1 Z-2\nG90\nM83\nG92 Z0\n"), 0.9),
    Case("g92_z_kisslicer", mat(mode="G92 Z12\nG91\nG0 X2\nG0 X-2\nG90\nM83\n"), 0.9),
    Case("g92_z_board", mat(heights=BOARD, mode="M83\nG92 Z1\n"), 0.9),
    Case("m83_g90", mat(mode="M83\nG90\n", push=absolute), 0.9),
    Case("m83_g90_relative", mat(mode="M83\nG90\n"), 0.9),
    Case("m83_g90_klipper", mat(mode="M83\nG90\n"), 0.9, ("--firmware", "klipper")),
    Case("m83_g90_marlin", mat(mode="M83\nG90\n"), 0.98, ("--firmware", "marlin")),
    Case("tools_shared_e", mat(mode="M82\n", push=absolute, before=lambda n: f"T{n}\n"), 0.9),
    Case("tools_reset_e", mat(mode="M82\n", push=lambda n: f"E{E * (n % 5 + 1):.5f}",
                              before=lambda n: f"T{n}\nG92 E0\n"), 0.9),
    # Lines of another shape.
    Case("modal_lines", mat(line="G1 F1200\n"), 0.9),
    Case("modal_lower_case", mat(line="g1 f1200\n").replace("X60", "x60"), 0.9),
    Case("modal_compact", mat().replace(" Y", "Y").replace(" E", "E"), 0.9),
    Case("numbered", "".join(f"N{k} {each}*0\n" for k, each in enumerate(mat().splitlines())), 0.9),
    Case("spline_g5", spline(5, "I3 J0 P-3 Q0"), 0.9),
    Case("spline_g5_without_handles", spline(5, "I0 J0 P0 Q0"), 0.9),
    Case("spline_g5_klipper", spline(5, "I3 J0 P-3 Q0"), "line 12: G5 is a spline",
         ("--firmware", "klipper")),
    Case("loop_repeat", mat(mode="M83\no100 repeat [5]\n"), "line 9: O100"),
    Case("loop_while", mat(mode="M83\nwhile iterations < 5\n"), "line 9: WHILE"),
    Case("loop_m808", mat(mode="M83\nM808 L5\n"), "line 9: M808"),
    Case("params", mat(mode="M83\n#1=40\n"), "line 9: '#1=40'"),
    Case("params_in_words", mat().replace("X40 Y42", "X#1 Y42"), "'X#1 Y42"),
    Case("params_braces", mat().replace("X40 Y42", "X{a} Y42"), "'X{a} Y42"),
    Case("blocks_modes", mat(start=HEAT.replace("G21\nG90", "G21 G90")), "G90 stands behind G21"),
    Case("blocks_modes_rrf", mat(start="G21 G90 M83\nG28\n", mode=""), 0.9, ("--firmware", "rrf")),
    Case("blocks_motion", mat(line="G90 G1"), "G1 stands behind G90"),
    Case("blocks_motion_rrf", mat(line="G90 G1"), 0.9, ("--firmware", "rrf")),
    Case("blocks_motion_grbl", mat(start="G21\nG90\n$H\n", mode="", line="G90 G1", end=""),
         "grbl has no E", ("--firmware", "grbl")),
    Case("loop_of_a_template", mat(mode="M83\n{% for i in range(3) %}\n"), "'{% for i in range"),
    Case("place_of_the_machine", mat(line="G53 G1"), "G53 moves"),
    Case("zero_elsewhere", mat(mode="M83\nG10 L2 P1 X5\n"), "line 9: G10 with L2"),
    Case("exponent", mat(push=lambda n: f"E{E:.4e}"), "has an exponent"),
    Case("exponent_of_x", mat().replace("X60 Y46", "X6e1 Y46"), "has an exponent"),
    Case("axis_a", mat(push=lambda n: f"A{E:.5f}"), "moves an axis that is not known"),
    Case("axis_u", mat(push=lambda n: f"U{E:.5f}"), "moves an axis that is not known"),
    Case("cut_inside_a_line", mat(end="G1 X40 E"), "'E' is no letter with a number"),
    Case("two_points", mat().replace("X60 Y46", "X60 Y4.6.1"), "line 13:"),
    Case("utf16", mat(), 0.9, encoding="utf-16"),
    Case("utf8_mark", mat(), 0.9, encoding="utf-8-sig"),
    Case("carriage_returns", mat().replace("\n", "\r\n"), 0.9),
    Case("old_carriage_returns", mat().replace("\n", "\r"), 0.9),
    Case("arc_of_no_radius", mat(end="G2 X5 Y5 R0 E1\n"), "no arc of radius 0"),
    # Layers and heights.
    Case("raised_board", mat(heights=BOARD), 0.9),
    Case("lowered", mat(heights=(0.15, 0.35)), 0.9),
    Case("raised_far", mat(heights=(5.2, 5.4)), 0.9),
    Case("raised_alone", mat(heights=(5.2,)), "give the layer height"),
    Case("raised_alone_told", mat(heights=(5.2,)), 0.9, ("--layer-height", "0.2")),
    Case("first_layer_higher", mat(heights=(0.3, 0.5)), 1 - 16 / 200),
    Case("prime_s3d", mat(mode="M83\n" + PRIME, before=layered("; layer {1}, Z = {z:.3f}")), 0.9),
    Case("prime_bambu", mat(mode="M83\n" + PRIME, before=layered(
        "; CHANGE_LAYER", "; Z_HEIGHT: {z:.1f}", "; LAYER_HEIGHT: 0.2")), 0.9),
    Case("prime_cura", mat(mode="M83\n" + PRIME, before=layered(";LAYER:{}")), 0.9),
    Case("prime_none", mat(mode="M83\n" + PRIME), 0.9),
    Case("prime_same_height", mat(mode="M83\n" + PRIME.replace("Z0.3", "Z0.2")), 0.9),
    Case("prime_prusa", mat(mode="M83\n" + PRIME, before=layered(
        ";LAYER_CHANGE", ";Z:{z:.1f}", ";HEIGHT:0.2")), 0.9),
    Case("prime_kisslicer", mat(mode="M83\n" + PRIME, before=layered(
        "; BEGIN_LAYER_OBJECT z={z:.3f} z_thickness=0.200")), 0.9),
    Case("prime_craftware", mat(mode="M83\n" + PRIME, before=layered("; Layer #{}")), 0.9),
    Case("raft_order", mat(heights=(1.15, 1.13), before=layered(";LAYER:{}"),
                           start=";Layer height: 0.2\n" + HEAT), 0.9),
    Case("vase", mat(after=lambda n: "G1 X70 Y70 Z0.9 E1\n"), "the pitch of a vase"),
    # Filament.
    Case("filament_comment", mat(end=END + "; filament_diameter = 1.75,1.75\n"), 0.9, (), None),
    Case("filament_of_3", mat(push=lambda n: f"E{1.6 / (math.pi / 4 * 9):.5f}",
                              end=END + "; filament_diameter = 3\n"), 0.9, (), None),
    Case("filament_s3d", mat(start=";   filamentDiameters,1.75|1.75\n" + HEAT), 0.9, (), None),
    Case("filament_kisslicer", mat(start="; fiber_dia_mm = 1.75\n" + HEAT), 0.9, (), None),
    Case("filament_of_two", mat(before=lambda n: f"T{n}\n"), 1 - (8 + 8 * (2.85 / 1.75) ** 2) / 160,
         (), "1.75,2.85"),
    Case("filament_of_a_third", mat(before=lambda n: f"T{2 * n}\n"),
         "tool 2 deposits, and 2 filament diameters", (), "1.75,2.85"),
    Case("filament_unknown", mat(), "does not say the filament's diameter", (), None),
    # Pauses and messages.
    Case("pause_m0", mat(after=lambda n: "M0 Insert the nuts\n"), 0.9),
    Case("pause_m600", mat(after=lambda n: "M600\n"), 0.9),
    Case("message", mat(after=lambda n: "M117 E5 of T1 T2\n"), 0.9),
    # What is not the part.
    Case("skirt", mat(before=lambda n: f";LAYER:{n}\n;TYPE:SKIRT\nG0 X30 Y30\nG1 X70 E3\n"
                      ";TYPE:FILL\n"), 0.9),
    Case("brim_orca", mat(before=lambda n: ";LAYER_CHANGE\n;TYPE:Brim\nG0 X30 Y41\nG1 X70 E3\n"
                          ";TYPE:Sparse infill\n"), 0.9),
    Case("supports_bambu", mat(before=lambda n: "; CHANGE_LAYER\n; FEATURE: Support\nG0 X50 Y41\n"
                               "G1 X55 E3\n; FEATURE: Inner wall\n"), 0.9),
    Case("wipe_tower", mat(before=lambda n: ";LAYER_CHANGE\n;TYPE:Wipe tower\nG0 X50 Y41\n"
                           "G1 X55 E3\n;TYPE:Internal infill\n"), 0.9),
    Case("supports_asked_for", mat(before=lambda n: ";LAYER_CHANGE\n;TYPE:Support material\n"
                                   f"G0 X50 Y41\nG1 X55 E{E:.5f}\n;TYPE:Internal infill\n"),
         0.98, ("--role", "support")),
    Case("object", mat(before=lambda n: ";LAYER_CHANGE\n"
                       f"; printing object {'ab'[n]} id:0 copy 0\n"), 0.9, ("--object", "b*")),
    Case("layers", mat(before=lambda n: "M221 S50\n" * n), 0.95, ("--layers", "2:2")),
    Case("nothing", "G28\nG1 X50 Y50\n", "nothing is deposited"),
]  # fmt: skip


def seen(case: Case, folder: Path) -> float | str:
    """Porosity by `fdjax measure`, or the message that refuses the file."""
    path = folder / f"{case.name}.gcode"
    path.write_bytes(case.text.encode(case.encoding))
    numbers = folder / "numbers.json"
    arguments = ["--target", "0.9", "--outline", SQUARE, "--json", str(numbers), *case.options]
    if case.filament is not None:
        arguments += ["--filament", case.filament]
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
        code = fdjax(["measure", str(path), *arguments])
    if code == 0:
        return json.loads(numbers.read_text())["mean_got"]
    return f"exit {code}: {errors.getvalue()}"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for case in CASES:
            found = seen(case, Path(folder))
            if isinstance(found, float) and isinstance(case.right, float):
                good, found = math.isclose(found, case.right, abs_tol=1e-4), f"{found:.4f}"
            else:
                good = str(case.right) in str(found)
                found = str(found).strip().rpartition(f"{case.name}.gcode: ")[2]
            right = f"{case.right:.4f}" if isinstance(case.right, float) else case.right
            print(f"{'' if good else 'WRONG':6}{case.name:26} {right:40} {found}")


if __name__ == "__main__":
    main()
