"""G-code of several tools: heat, parked filament and the tower that primes, and what it lays."""

import dataclasses

import numpy as np
import pytest
import shapely

from fdjax.errors import InputError
from fdjax.formats import gcode, profile
from fdjax.gcode.firmware import firmware_of
from fdjax.gcode.state import GcodeState
from fdjax.machine.program import Program
from fdjax.machine.survey import survey
from fdjax.plan.toolpath import Build, Layer, Road

DUAL = profile.load("marlin-0.4-dual")
ABSOLUTE = dataclasses.replace(DUAL, gcode=dataclasses.replace(DUAL.gcode, relative_e=False))
MODES = pytest.mark.parametrize("made_for", [DUAL, ABSOLUTE], ids=["M83", "M82"])


def road(x, y, material):
    return Road(np.array([(x, y), (x + 20.0, y)]), 0.4, material=material)


def build(tools=(0, 1, 1, 0), origin=(100.0, 100.0)):
    """Two roads on each layer, of these tools; the layer in the middle has one of the first."""
    a, b, c, d = tools
    layers = [[road(0, 1, a), road(0, 3, b)], [road(0, 2, b)], [road(0, 1, c), road(0, 3, d)]]
    return Build(
        tuple(
            Layer(0.2 * (k + 1), 0.2, tuple(roads), shapely.box(-1, -1, 22, 5))
            for k, roads in enumerate(layers)
        ),
        origin=origin,
    )


def pushes(text):
    """Filament of all moves of each tool in turn: its number and the steps, mm."""
    state = GcodeState(firmware_of("marlin"), filament_area=1.0)
    turns = [(0, [])]
    for line in text.splitlines():
        code = line.partition(";")[0].strip()
        if not code or code.startswith("G28"):
            continue
        moves = list(state.run(code))
        if state.tool != turns[-1][0]:
            turns.append((state.tool, []))
        turns[-1][1].extend(move.volume for move in moves)
    return turns


@MODES
def test_roads_and_their_tools_are_read_back_without_the_tower(made_for):
    made = build()
    again = gcode.read(gcode.write(made, made_for))
    assert again.volume == pytest.approx(made.volume, rel=1e-5)
    assert [[r.material for r in layer.roads] for layer in again.layers] == [[0, 1], [1], [1, 0]]


@MODES
def test_what_is_parked_is_given_back_when_a_tool_goes_on(made_for):
    turns = pushes(gcode.write(build(), made_for))
    assert [tool for tool, _ in turns] == [0, 1, 0]
    assert turns[0][1][-1] == pytest.approx(-4)
    assert turns[2][1][0] == pytest.approx(4)
    # The second was not parked before.
    assert turns[1][1][0] == pytest.approx(-0.8)
    assert turns[1][1][-1] == pytest.approx(-4)


def test_a_tool_is_hot_before_it_lays_and_stands_by_after(tmp_path):
    lines = gcode.write(build(), DUAL).splitlines()
    first = lines.index("T1")
    assert lines[first - 1] == "M104 T0 S170"
    assert lines[first + 1 : first + 3] == ["G92 E0", "M109 T1 S210"]
    assert "M104 T1 S0" in lines[-20:]
    path = tmp_path / "two.gcode"
    path.write_text("\n".join(lines))
    assert survey(Program(path, DUAL)).errors == ()


def test_the_tower_is_laid_on_every_layer_up_to_the_last_change():
    text = gcode.write(build(), DUAL)
    _, *towers = text.split("; fdjax prime begin")[1:]
    towers = [each.split("; fdjax prime end")[0] for each in towers]
    assert len(towers) == 3
    for each in towers:
        moves = [line.split() for line in each.splitlines() if " X" in line]
        x, y = np.array([[float(word[1:]) for word in move[1:3]] for move in moves]).T
        assert (x.min(), y.min()) == pytest.approx((10.24, 180.24))
        assert max(x.max(), y.max() - 170) == pytest.approx(23.76, abs=0.3)
    assert gcode.write(build((0, 0, 0, 0)), DUAL).count("prime begin") == 1


def test_two_changes_on_a_layer_share_the_tower():
    made = build((0, 1, 0, 1))  # back to the first at the layer's start
    text = gcode.write(made, DUAL)
    assert text.count("prime begin") == 1 + 1 + 1 + 2
    assert gcode.read(text).volume == pytest.approx(made.volume, rel=1e-5)


def test_a_tower_on_the_part_or_off_the_bed_is_refused():
    with pytest.raises(InputError, match="stands on the part"):
        gcode.write(build(origin=(0.0, 184.0)), DUAL)
    tower = dataclasses.replace(DUAL.gcode.tower, at=(215.0, 10.0))
    beyond = dataclasses.replace(DUAL, gcode=dataclasses.replace(DUAL.gcode, tower=tower))
    with pytest.raises(InputError, match="leaves the bed"):
        gcode.write(build(), beyond)
    # Where no tool changes there is none.
    assert gcode.write(build((0, 0, 0, 0)), beyond)


def test_tables_of_tools_are_as_many_as_these(tmp_path):
    text = (profile._FOLDER / "marlin-0.4-dual.toml").read_text()
    path = tmp_path / "three.toml"
    path.write_text(text.replace("tools = 2", "tools = 3"))
    with pytest.raises(InputError, match=r"gcode\.tool: 2 tables for 3 tools"):
        profile.load(path)
