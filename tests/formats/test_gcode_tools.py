"""G-code of several tools: heat, parked filament and the tower that primes, and what it lays."""

import dataclasses

import numpy as np
import pytest
import shapely

from fdjax.errors import InputError
from fdjax.formats import gcode, profile
from fdjax.formats.gcode_tower import towers
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
    first, second, again = ([step for step in steps if step] for _, steps in turns)
    assert first[-1] == pytest.approx(-4)
    assert again[0] == pytest.approx(4)
    # The second was not parked before, and primes at once.
    assert 0 < second[0] < 1
    assert second[-1] == pytest.approx(-4)


@MODES
def test_each_tool_lays_as_much_as_it_pulls_back_and_gives_back(made_for):
    made = build((0, 1, 0, 1))
    turns = pushes(gcode.write(made, made_for))
    for tool in (0, 1):
        total = sum(sum(steps) for number, steps in turns if number == tool)
        own = [road for layer in made.layers for road in layer.roads if road.material == tool]
        least = sum(float(road.areas(0.2).sum() * 20) for road in own) / (np.pi / 4 * 1.75**2)
        # What is laid, on the tower too, less what stays parked.
        assert total > least - 4
    parked = [steps[-1] for _, steps in turns[:-1]]
    assert parked == pytest.approx([-4] * len(parked))


def with_tools(machine, **more):
    """The machine with something else of each of its tools."""
    tools = tuple(dataclasses.replace(tool, **more) for tool in machine.gcode.tool)
    return dataclasses.replace(machine, gcode=dataclasses.replace(machine.gcode, tool=tools))


def test_a_tool_waits_for_heat_at_the_tower_and_stands_by_after(tmp_path):
    lines = gcode.write(build(), with_tools(DUAL, ahead=0.0)).splitlines()
    first = lines.index("T1")
    assert lines[first - 1] == "M104 T0 S170"
    assert lines[first - 2] == "G1 E-4.00000 F2400"
    assert lines[first - 4].startswith("G0 X10.240 Y180.240")
    assert lines[first - 6] == "; fdjax prime begin"
    assert lines[first + 1 : first + 3] == ["G92 E0", "M109 S210"]
    # A change of tool may have moved the head.
    assert lines[first + 3].startswith("G1 Z0.200")
    assert lines[first + 4].startswith("G0 X10.240 Y180.240")
    assert "M104 T1 S0" in lines[-20:]
    path = tmp_path / "two.gcode"
    path.write_text("\n".join(lines))
    assert survey(Program(path, DUAL)).errors == ()


def test_a_tool_is_told_to_heat_before_its_turn_or_stays_hot():
    def heats(ahead):
        lines = gcode.write(build((0, 1, 1, 0)), with_tools(DUAL, ahead=ahead)).splitlines()
        return [line for line in lines if line[:3] in ("M10", "T0", "T1") or "stays" in line][2:-3]

    # Roads of 20 mm take a second on the first layer, half a one above.
    plain = ["T0", "M109 S210", "M104 T0 S170", "T1", "M109 S210", "M106 S255"]
    assert heats(0.0) == [*plain, "M104 T1 S170", "T0", "M109 S210"]
    soon = ["T0", "M109 S210", "M104 T1 S210", "M104 T0 S170", "T1", "M109 S210", "M106 S255"]
    assert heats(0.6) == [*soon, "M104 T0 S210", "M104 T1 S170", "T0", "M109 S210"]
    stays = [line.replace("M104 T0 S170", "; tool 0 stays hot") for line in soon]
    assert heats(100.0) == [*stays, "M104 T1 S170", "T0", "M109 S210"]


def test_the_tool_that_lays_first_is_heated_and_primes():
    lines = gcode.write(build((1, 0, 1, 1)), hotter_second(DUAL)).splitlines()
    assert next(line for line in lines if line.startswith("M104 T1")) == "M104 T1 S225"
    assert [line for line in lines if line.startswith("T")][:2] == ["T1", "T0"]
    assert lines.index("T1") < lines.index("; fdjax prime begin")
    assert gcode.write(build((1, 1, 1, 1)), DUAL).count("T0") == 1  # turned off at the end


def hotter_second(machine):
    first, second = machine.gcode.tool
    tools = (first, dataclasses.replace(second, nozzle=225))
    return dataclasses.replace(machine, gcode=dataclasses.replace(machine.gcode, tool=tools))


def test_tools_of_one_nozzle_are_as_hot_as_each_wants(tmp_path):
    shared = with_tools(hotter_second(DUAL), standby=0, park=20.0)
    tables = dataclasses.replace(shared.gcode, one_nozzle=True)
    shared = dataclasses.replace(shared, gcode=tables)
    lines = gcode.write(build((0, 1, 1, 0)), shared).splitlines()
    changes = [k for k, line in enumerate(lines) if line in ("T0", "T1")]
    assert [lines[k + 2] for k in changes[1:]] == ["M109 S225", "M109 S210"]
    path = tmp_path / "shared.gcode"
    path.write_text("\n".join(lines))
    found = survey(Program(path, shared))
    assert found.errors == ()
    assert found.nozzle == 225
    assert "left on" not in [each.kind for each in found.findings]
    # As hot as each other: nothing is waited for.
    alike = dataclasses.replace(shared, gcode=dataclasses.replace(tables, tool=tables.tool[:1] * 2))
    assert gcode.write(build((0, 1, 1, 0)), alike).count("M109") == 1


def test_each_change_of_tool_purges_at_least_what_is_asked():
    tower = dataclasses.replace(DUAL.gcode.tower, purge=60.0)
    machine = dataclasses.replace(DUAL, gcode=dataclasses.replace(DUAL.gcode, tower=tower))
    made = build((0, 1, 0, 1))
    laid = [each for each in towers(made, machine) if each]
    assert [len(each) for each in laid] == [1, 1, 2]
    for roads in laid:
        assert min(float((r.areas(0.2) * r.segment_lengths).sum()) for r in roads) >= 60
        xy = np.concatenate([r.xy for r in roads])
        # As wide on each layer, so that it stands on itself.
        assert np.ptp(xy, axis=0) == pytest.approx(np.ptp(laid[0][0].xy, axis=0))
        assert xy.min(0) == pytest.approx(laid[0][0].xy.min(0))


def test_the_tower_has_no_gap_where_the_part_has_an_empty_layer():
    made = build((0, 1, 1, 0))
    empty = dataclasses.replace(made.layers[1], roads=())
    made = dataclasses.replace(made, layers=(made.layers[0], empty, made.layers[2]))
    text = gcode.write(made, DUAL)
    assert text.count("prime begin") == 1 + 3
    assert [line for line in text.splitlines() if line.startswith("G1 Z0.4")]


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


@pytest.mark.parametrize(
    ("was", "new", "words"),
    [
        ("tools = 2", "tools = 2\none_nozzle = true", r"gcode\.tool\[0\]\.standby: 170 C, but all"),
        ("purge = 15", "purge = -1", r"gcode\.tower\.purge: -1 is absurd"),
    ],
)
def test_what_tools_cannot_be_is_refused(tmp_path, was, new, words):
    text = (profile._FOLDER / "marlin-0.4-dual.toml").read_text()
    assert was in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(was, new))
    with pytest.raises(InputError, match=words):
        profile.load(path)


def test_a_start_that_selects_no_tool_is_preceded_by_the_first(tmp_path):
    text = (profile._FOLDER / "marlin-0.4-dual.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(text.replace('"T{first_tool}",', ""))
    road = Road([(0, 0), (20, 0)], 0.4, material=1)
    lines = gcode.write(Build((Layer(0.2, 0.2, (road,)),)), profile.load(path)).splitlines()
    code = [line for line in lines if not line.startswith(";")]
    assert code[0] == "T1"
    assert code.count("T1") == 1
    [again] = gcode.read("\n".join(lines)).layers[0].roads
    assert again.material == 1
