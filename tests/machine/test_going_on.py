"""Prints cut at a random line and gone on with: the machine is then as if they had not been."""

import contextlib
import dataclasses
import random

import pytest
from streams import PRINTER

from fdjax.errors import StreamError
from fdjax.machine import resume, virtual
from fdjax.machine.program import Program
from fdjax.machine.protocols import protocol
from fdjax.machine.resume import Standing
from fdjax.machine.stream import Stream
from fdjax.machine.survey import survey
from fdjax.machine.virtual.port import VirtualPort

LIFT = 10.0
AHEAD = 16
"""Lines that a machine may have taken beyond the one at which it is cut."""

SETTINGS = {
    "marlin": [
        *("M201 X{a} Y{a}", "M203 X{b}", "M204 P{a} T{a}", "M204 S{a}", "M205 X{c} Y{c}"),
        *("M900 K.0{c}", "M900 T1 K.{c}", "M220 S{d}", "M221 S{d}", "M221 T1 S{d}", "M420 S1 Z{c}"),
        *(
            "M302 S1{c}0",
            "M200 D1.75",
            "M200 D0",
            "M106 S{d}",
            "M106 P2 S{d}",
            "M107 P1",
            "M141 S3{c}",
        ),
        *("M104 T1 S19{c}", "G60 S{c}", "M412 S1", "M211 S0", "M92 E9{c}"),
    ],
    "rrf": [
        *("M201 X{a} E{a}:{a}", "M566 X{b}", "M204 P{a} T{a}", "M572 D0:1 S.0{c}", "M207 P0 S{c}"),
        *("M220 S{d}", "M221 S{d}", "M221 D1 S{d}", "M302 S1{c}0", "M106 S{d}", "M106 P3 S.{c}"),
        *("M141 S3{c}", "G10 P1 S19{c}", "M568 P1 S18{c}", "M376 H{c}", "M593 F4{c}", "M486 S{c}"),
    ],
    "klipper": [
        *("M204 S{a}", "SET_VELOCITY_LIMIT ACCEL={a}", "SET_PRESSURE_ADVANCE ADVANCE=.0{c}"),
        *("SET_PRESSURE_ADVANCE EXTRUDER=extruder1 ADVANCE=.0{c}", "M220 S{d}", "M221 S{d}"),
        *("SET_FAN_SPEED FAN=a SPEED=.{c}", "M106 S{d}", "M104 T1 S19{c}", "M107"),
        *("SET_GCODE_OFFSET Z=.0{c}", "SET_GCODE_OFFSET X_ADJUST=.1", "SAVE_GCODE_STATE NAME=n{c}"),
        *("EXCLUDE_OBJECT_DEFINE NAME=n{c}",),
        *("BED_MESH_PROFILE LOAD=m{c}", "BED_MESH_CLEAR", "SET_RETRACTION RETRACT_LENGTH={c}"),
    ],
}


OBJECT = {
    **dict.fromkeys(("marlin", "rrf"), ("M486 S{}", "M486 S-1")),
    "klipper": ("EXCLUDE_OBJECT_START NAME=n{}", "EXCLUDE_OBJECT_END NAME=n{}"),
}
LEAVE_OUT = {
    **dict.fromkeys(("marlin", "rrf"), "M486 P{}"),
    "klipper": "EXCLUDE_OBJECT NAME=n{}",
}


class Writer:
    """Writes a print of several objects, one after the other, in modes that change."""

    def __init__(self, firmware, seed):
        self.firmware = firmware
        self.chance = random.Random(seed)
        self.relative = self.chance.random() < 0.5
        self.e = 0.0
        self.lines = ["G21", "G90", "M83", "M140 S60", "M104 S200", "M104 T1 S195", "G28"]
        self.lines += ["M109 S200", "M109 T1 S195", "M109 S200", "M83" if self.relative else "M82"]
        self.lines += ["G92 E0"]

    def setting(self):
        text = self.chance.choice(SETTINGS[self.firmware])
        a, b, c, d = (self.chance.randrange(*r) for r in ((300, 900), (50, 99), (2, 9), (90, 110)))
        self.lines.append(text.format(a=a, b=b, c=c, d=d))

    def road(self, x, y, scale=1.0):
        pushed = self.chance.uniform(0.05, 0.2)
        self.e += pushed
        e = pushed if self.relative else self.e
        feed = (
            f" F{self.chance.randrange(600, 3000) / scale:.4f}"
            if self.chance.random() < 0.3
            else ""
        )
        self.lines.append(f"G1 X{x / scale:.5f} Y{y / scale:.5f} E{e:.5f}{feed}")

    def aside(self, x, y):
        """A few roads in another mode."""
        kinds = {"marlin": ["G91", "G20"], "rrf": ["G91", "G20", "words", "saved"]}
        kind = self.chance.choice(kinds.get(self.firmware, ["G91", "saved"]))
        e_mode = "M83" if self.relative else "M82"
        if kind == "G91":
            self.lines += ["G91", "M83", "G1 X3 E.1", "G1 Y3 E.1", "G1 X-3 Y-3", "G90", e_mode]
        elif kind == "G20":
            self.lines += [
                "G20",
                "M83",
                f"G1 X{(x + 4) / 25.4:.5f} E.004 F40",
                "G1 E-.01",
                "G1 E.01",
            ]
            self.lines += ["G21", "G1 F1200", e_mode]
        elif kind == "words":
            self.lines += ["M83", f"G1 X{x + 5} E.1", f"X{x} E.1", f"Y{y + 4} E.1", e_mode]
        elif self.firmware == "rrf":
            self.lines += ["M120", "M83", "G91", "G1 X2 E.1 F900", "M121"]
        elif self.firmware == "klipper":
            self.lines += ["SAVE_GCODE_STATE NAME=s", "M83", "G91", "G1 X2 E.1 F900"]
            self.lines += ["RESTORE_GCODE_STATE NAME=s"]
        if kind in ("G91", "G20", "words") and not self.relative:
            self.lines.append(f"G92 E{self.e:.5f}")

    def write(self, path):
        chance = self.chance
        for number in range(3):
            x, y = 30 + 60 * number, chance.uniform(30, 180)
            height = chance.choice([0.4, 0.3])
            self.lines += ["G1 Z40 F1200"]
            for _ in range(chance.randrange(3)):
                self.setting()
            if chance.random() < 0.5:
                self.lines.append(f"T{chance.randrange(2)}")
                if self.firmware == "klipper" and not self.relative:  # whose tools begin anew
                    self.lines.append(f"G92 E{self.e:.5f}")
            inside, outside = OBJECT[self.firmware]
            if chance.random() < 0.4:
                self.lines.append(LEAVE_OUT[self.firmware].format(chance.randrange(3)))
            self.lines.append(f"G1 X{x} Y{y:.3f} Z39 F6000")
            place = x, y
            if chance.random() < 0.3:  # the object has coordinates of its own
                self.lines.append("G92 X5 Y5")
                x, y = 5, 5.0
            for layer in range(1, chance.randrange(3, 9)):
                self.lines += [
                    f";LAYER:{layer}",
                    f"G1 X{x} Y{y:.3f} F6000",
                    f"G1 Z{layer * height:g}",
                    inside.format(number),
                ]
                for _ in range(chance.randrange(3, 7)):
                    if chance.random() < 0.15:
                        self.setting()
                    if chance.random() < 0.1:
                        self.aside(x, round(y))
                    self.road(x + chance.uniform(0, 20), y + chance.uniform(0, 20))
                self.lines.append(outside.format(number))
            self.lines.append(f"G1 X{x} Y{y:.3f}")
            if place != (x, y):
                self.lines.append(f"G92 X{place[0]} Y{place[1]:.3f}")
        path.write_text("\n".join([*self.lines, "G1 Z50", "M104 S0"]) + "\n")


class Cutter:
    """Writes a job for grbl: a dispenser that is turned on and off, in modes that change."""

    def __init__(self, firmware, seed):
        self.chance = random.Random(seed)

    def write(self, path):
        chance = self.chance
        lines = ["G21", "G90", "G92 X0 Y0 Z0", "G1 Z5 F600", "G1 X10 Y10 F3000"]
        for layer in range(1, 6):
            lines += [
                f"(layer {layer})",
                f"G1 Z{layer * 0.5} F600",
                f"M{chance.choice([3, 4])} S500",
            ]
            for _ in range(chance.randrange(4, 9)):
                x, y = chance.uniform(10, 90), chance.uniform(10, 90)
                lines.append(f"G1 X{x:.3f} Y{y:.3f} F{chance.randrange(600, 3000)}")
                lines += chance.choice(
                    [
                        [f"X{y:.3f}", f"Y{x:.3f}"],
                        ["G91 G1 X2", "Y2", "G90"],
                        ["G20", "G1 X1.5 F40", "G21", "G1 F900"],
                        ["M5", "G0 X50 Y50", f"M3 S{chance.randrange(100, 900)}"],
                        [],
                    ]
                )
            lines.append("M5")
        path.write_text("\n".join([*lines, "G0 Z20", "M30"]) + "\n")


def machine_of(firmware):
    gcode = dataclasses.replace(PRINTER.gcode, tools=2)
    stream = dataclasses.replace(PRINTER.stream, firmware=firmware, largest_section=50.0)
    return dataclasses.replace(PRINTER, gcode=gcode, stream=stream)


FIELDS = (
    *("absolute", "relative_e", "scale", "speed", "speed_factor", "flow_factor", "volumetric"),
    *("accelerations", "settings", "nozzles", "bed", "chamber", "tool", "coldest", "retracted"),
    *("power", "plane"),
)


def like(state):
    """All of a state that a print hangs on."""
    found = {name: getattr(state, name) for name in FIELDS}
    found["accelerations"] = dict(state.accelerations)
    found["settings"] = {
        key: dict(words)
        for key, words in state.settings.items()
        # Factors are compared as such; soft end stops are off where the height was told.
        if key[0] not in ("M220", "M221", "M211")
    }
    found["nozzles"] = dict(state.nozzles)
    found["fans"] = {0: 0.0} | state.fans
    for name, saved in state.saved.items() if not state.firmware.saves_place else ():
        found[f"saved {name}"] = [float(saved.absolute), float(saved.relative_e), saved.scale]
        found[f"saved {name}"] += [saved.speed]
        if not state.firmware.stacks:
            found[f"saved {name}"] += [saved.speed_factor, saved.e, *saved.shift, *saved.offset]
    found["objects"] = (state.objects.current, state.objects.left_out, state.objects.skips)
    found["place"] = (state.x, state.y, state.z, state.e, *state.on_bed[:2])
    return found


class Bench:
    """A virtual machine that notes its state after each line of the file, and all its moves."""

    def __init__(self, firmware, program):
        self.program = program
        self.machine = virtual.MACHINES[firmware](program.machine, keep=True, record=True)
        self.port = VirtualPort(self.machine)
        self.firmware = firmware
        self.states, self.moves = [], []
        self.made = []  # moves made before each state
        ran, make = self.machine.ran, self.machine._make

        def note(text):
            ran(text)
            self.states.append((text, like(self.machine.state)))
            self.made.append(len(self.moves))

        def keep(moves):
            self.moves += [(move, self.machine.state.top) for move in moves]
            return make(moves)

        self.machine.ran, self.machine._make = note, keep

    def end_with(self, program):
        """Drop what the sender said behind the last line of the file."""
        *_, (last, _) = program.commands()
        while not self.states[-1][0].endswith(last):
            self.states.pop()
            self.made.pop()

    def stream(self, **more):
        return Stream(
            self.program, self.port, protocol(self.firmware, self.program.machine.stream), **more
        )

    def roads(self):
        """Ends and volumes of all that was laid along a way."""
        return [(m.end, m.volume) for m, _ in self.moves if m.start != m.end and m.volume > 0]


def cut(bench, accident, line):
    """Send the file up to a line, and bring about an accident."""
    stream = bench.stream()
    if accident in ("kill", "power"):
        stream.connect()
        while stream.line < line:
            stream._fill()
            stream._exchange()
        if accident == "power" and isinstance(bench, Bench):
            bench.machine.reset(bench.port.now())
            bench.port.wait(2.0)
        return stream.line
    orders = {"abort": ["abort"], "pause": ["pause", "resume"]}[accident]
    sent = []

    def on_event(event):
        if event.kind == "line" and event.line >= line and not sent:
            sent.append(stream._sent)
            for order in orders:
                getattr(stream, order)()

    stream._on_event = on_event
    with pytest.raises(StreamError) if accident == "abort" else contextlib.nullcontext():
        stream.run()
    return sent[0] if accident == "pause" else stream.line


def go_on(bench, reached):
    """Begin again as `fdjax send --resume` does; the line after which it goes on."""
    program = bench.program
    stream = bench.stream()
    stream.connect()
    place = stream.ask_position()
    points = resume.Points(program, [], reached)
    here = points.at(place)
    grbl = bench.firmware == "grbl"  # it does not say, but --kept-power does
    stands = Standing.HERE if grbl else resume.standing(place, here)
    point = here or (points.lost if stands is Standing.LOST else points.kept)
    height = points.lowest if place is None or stands is Standing.LOST else place[2]
    if stands is Standing.LOST:
        resume.must_be_saved(program, point)
    back = resume.way_back(
        point,
        program.machine,
        stands,
        height=height,
        top=points.top,
        waits=points.waits,
        extruder=not grbl,
    )
    stream.go_on(point, back)
    bench.moves.clear()
    stream.run()
    told = stands is Standing.LOST and bench.firmware != "klipper"  # by G92, which moves nothing
    return point.line, stands, height if told else 0.0


def check_travel(moves, low, zero):
    """No way in X or Y but above all that stands, plus the lift.

    `low`: what stood before; `zero`: where the machine, switched on anew, takes its zero to be.
    """
    for move, top in moves:
        if move.start[:2] != move.end[:2] and not move.volume:
            assert min(move.start[2], move.end[2]) + zero >= min(max(top, low) + LIFT, 250) - 1e-3


def same(state, wanted, text):
    for name, value in wanted.items():
        rounds = name == "place" or name.startswith("saved")
        near = pytest.approx(value, abs=2e-3) if rounds else value
        if name in ("speed", "speed_factor", "flow_factor"):
            near = pytest.approx(value, rel=1e-7)
        assert state[name] == near, (name, text)


def _is_road(move):
    return move.start[:2] != move.end[:2]


def likely(program):
    """Lines behind the first road; not where Klipper counts pushes until it leaves an object out.

    Those of a pause, or of a way back, count too.
    """
    state, laid, found = program.state(), False, []
    for text, line in program.commands():
        moves = state.run(text)
        laid = laid or any(_is_road(m) and (m.volume > 0 or state.pours) for m in moves)
        transform = state.objects.transform
        if laid and (transform is None or not transform.still_made):
            found.append(line)
    return found


def height_of(moves):
    """Of all that has been laid, mm."""
    return max((m.end[2] for m, _ in moves if m.volume > 0 and _is_road(m)), default=0.0)


def cut_and_compared(folder, firmware, accident, seed):
    """One print that is cut at a random line and gone on with, beside one that is not."""
    path = folder / f"{seed}.gcode"
    (Cutter if firmware == "grbl" else Writer)(firmware, seed).write(path)
    program = Program(path, machine_of(firmware))
    assert survey(program).errors == ()
    line = random.Random(1000 + seed).choice(likely(program)[3:-AHEAD])
    print(firmware, accident, seed, line)
    compared(program, firmware, accident, line)


def compared(program, firmware, accident, line):
    """One print that is cut at a line and gone on with, beside one that is not."""
    whole, bench = Bench(firmware, program), Bench(firmware, program)
    whole.stream().run()
    lines = [command.line for command in program.commands()]
    begun = cut(bench, accident, line)
    if accident != "pause":
        stood = height_of(bench.moves)
        begun, stands, zero = go_on(bench, begun)
        assert (stands is Standing.LOST) == (accident == "power")
    rest = sum(number > begun for number in lines)
    for each in (bench, whole):
        each.end_with(program)
    if accident != "pause" and firmware != "grbl":
        check_travel(bench.moves[: bench.made[-rest - 1]], stood, zero)
    pairs = zip(bench.states[-rest:], whole.states[-rest:], strict=True)
    for (text, state), (right_text, right) in pairs:
        assert text.endswith(right_text)
        same(state, right, text)
    roads, right = bench.roads(), whole.roads()
    assert accident != "pause" or len(roads) == len(right)
    for (end, volume), (right_end, right_volume) in zip(
        roads, right[len(right) - len(roads) :], strict=True
    ):
        assert end[:2] == pytest.approx(right_end[:2], abs=2e-3)
        assert volume == pytest.approx(right_volume, abs=1e-6)


ACCIDENTS = pytest.mark.parametrize("accident", ["pause", "abort", "kill", "power"])
FIRMWARES = pytest.mark.parametrize("firmware", ["marlin", "klipper", "rrf"])


@ACCIDENTS
@FIRMWARES
def test_what_is_gone_on_with_is_as_if_it_had_not_been_cut(tmp_path, firmware, accident):
    for seed in range(5):
        cut_and_compared(tmp_path, firmware, accident, seed)


@pytest.mark.parametrize("accident", ["pause", "kill"])
def test_a_job_of_grbl_that_was_cut(tmp_path, accident):
    for seed in range(10):
        cut_and_compared(tmp_path, "grbl", accident, seed)


@pytest.mark.slow
@ACCIDENTS
@FIRMWARES
def test_two_hundred_prints_that_are_cut(tmp_path, firmware, accident):
    for seed in range(100, 150):
        cut_and_compared(tmp_path, firmware, accident, seed)


@pytest.mark.slow
@pytest.mark.parametrize("accident", ["pause", "kill"])
def test_two_hundred_jobs_of_grbl_that_are_cut(tmp_path, accident):
    for seed in range(100, 200):
        cut_and_compared(tmp_path, "grbl", accident, seed)
