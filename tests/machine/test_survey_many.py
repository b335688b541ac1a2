"""A file that is looked through many lines at a time: nothing but what line by line finds."""

import dataclasses
import random
import sys
from pathlib import Path

import pytest

from fdjax.formats import motion_many, profile
from fdjax.formats.motion_many import ManyMotions
from fdjax.gcode.motion import MotionTime
from fdjax.machine import program as programs
from fdjax.machine import survey as surveys
from fdjax.machine import survey_many
from fdjax.machine.program import Program
from fdjax.moves import Move

sys.path.append(str(Path(__file__).parents[1] / "formats"))
from gcode_grammar import program as valid_gcode

MARLIN = profile.load("marlin-0.4")
SPOKEN = (
    ";LAYER:3", "; LAYER_CHANGE", "; fdjax prime begin", "; fdjax prime end", ";TYPE:Skin", "",
    "M204 P500 T900", "M204 S1500", "G4 P200", "M400", "M106 S127", "M220 S80", "M221 S95", "T0",
    "M104 S0", "M104 S215", "G28", "G91", "G90", "M82", "M83", "G92 E0", "G92 X0 Y0", "G92 E3.5",
    "G2 X60 Y60 I5 J5 E1", "G1 X10 Y10 E1 ; aside", "SET_FAN A=1", "M30", "G1 X1..2", "% stop",
    "G1 X50 Y50 E1 ; " + 90 * "c", "(aside)", " G1 X3", "G1 X5. Y.5",
)  # fmt: skip


def mixture(seed):
    """Stretches of plain motion, of each kind, between all that may stand there."""
    chance = random.Random(seed)
    lines = ["G21", "G90", chance.choice(["M82", "M83"])]
    lines += chance.choice([[], ["G28"]]) + chance.choice([[], ["M109 S210"]])
    z, e = 0.2, 0.0
    for _ in range(chance.randint(1, 12)):
        z += chance.choice([0, 0, 0.2, 0.05])
        lines += [f"G1 Z{z:.2f} F600"] * chance.randint(0, 1)
        far = chance.choice([0.05, 2, 100, 400])
        for _ in range(chance.choice([3, 30, 300, 1200])):
            words = [f"{a}{100 + chance.uniform(-far, far):.3f}" for a in "XY"]
            words += [f"Z{z + chance.choice([0, 0.3]):.2f}"] * (chance.random() < 0.02)
            e += chance.choice([0, 0.02, 0.02, 0.02, 1, -0.8, 70 * (chance.random() < 0.01)])
            words += [f"E{e if lines[2] == 'M82' else e / 100:.4f}"] * chance.choice([0, 1, 1, 1])
            words = words[2 * (chance.random() < 0.03) :]
            words += [f"F{chance.choice([300, 1800, 9000])}"] * (chance.random() < 0.1)
            if words:
                lines.append(" ".join([chance.choice(["G0", "G1", "G1"]), *words]))
        lines += chance.choices(SPOKEN, k=chance.randint(0, 4))
    return "\n".join(lines) + "\n"


def both(tmp_path, monkeypatch, text, machine):
    path = tmp_path / "part.gcode"
    path.write_bytes(text.encode())
    found = []
    for large in (10**9, 0):
        monkeypatch.setattr(surveys, "_LARGE", large)
        found.append(surveys.survey(Program(path, machine)))
    return found


def alike(one, other):
    for name in ("seconds", "volume", "filament", "grams"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-9), name
    for first, second in zip(one.layers, other.layers, strict=True):
        assert (first.line, first.z) == (second.line, second.z)
        assert first.seconds == pytest.approx(second.seconds, rel=1e-9, abs=1e-9)
    left = {"seconds": 0.0, "volume": 0.0, "filament": 0.0, "grams": 0.0, "layers": ()}
    assert dataclasses.replace(one, **left) == dataclasses.replace(other, **left)


@pytest.mark.parametrize("firmware", ["marlin", "klipper", "rrf", "grbl", "auto"])
def test_many_at_a_time_finds_what_line_by_line_does(tmp_path, monkeypatch, firmware):
    stream = dataclasses.replace(MARLIN.stream, firmware=firmware)
    machine = dataclasses.replace(MARLIN, stream=stream)
    for seed in range(14):
        chance = random.Random(seed)
        monkeypatch.setattr(survey_many, "_FEW", chance.choice([0, 8]))
        monkeypatch.setattr(motion_many, "_MANY", chance.choice([1, 700, 1 << 16]))
        monkeypatch.setattr(programs, "_CHUNK", chance.choice([1000, 1 << 18]))
        text = mixture(seed)
        if seed % 3 == 1:
            text = "G28\nM109 S210\n" + valid_gcode(seed, "marlin") + text
        if seed % 4 == 2:
            text = "\ufeff" + text.replace("\n", chance.choice(["\r\n", "\r"]))
        alike(*both(tmp_path, monkeypatch, text, machine))


@pytest.mark.parametrize("many", [1, 100, 10**9])
def test_times_are_those_of_one_move_after_the_other(monkeypatch, many):
    monkeypatch.setattr(motion_many, "_MANY", many)
    chance = random.Random(5)
    one, other = MotionTime(1000.0, 8.0), ManyMotions(1000.0, 8.0)
    place = (0.0, 0.0, 0.0)
    for _ in range(20_000):
        step = chance.choice([0.01, 0.01, 0.3, 30]) if chance.random() < 0.3 else 0.02
        end = tuple(each + chance.uniform(-step, step) for each in place)
        speed = chance.choice([10.0, 60.0, 200.0])
        for time in (one, other):
            time.add(Move(place, end, speed, 0.0))
        place = end
        kind = chance.random()
        for time in (one, other):
            if kind < 0.001:
                time.flush()
            elif kind < 0.003:
                time.mark()
            elif kind < 0.004:
                time.add(Move(place, place, 40.0, 0.1, 0.05))
            elif kind < 0.005:
                time.accelerate({"P": 500.0, "T": 3000.0})
            elif kind < 0.006:
                time.add(Move(place, place, 0.0, seconds=2.0))
    one.flush()
    other.finish()
    assert other.seconds == pytest.approx(one.seconds, rel=1e-9)
    assert other.marks == pytest.approx(one.marks, rel=1e-9)
    assert len(one.marks) > 10
