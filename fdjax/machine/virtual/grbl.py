"""A virtual grbl 1.1h: a receive buffer of 128 bytes, real-time commands, `ok` for each line.

It has no extruder: what it lays down is its spindle's or its dispenser's power along G1. Sources of
its answers: report.c, protocol.c and system.c, and grbl's own simulator.
"""

import re

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.gcode.firmware import firmware_of
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import NoCommand, Refused, code_of, command_of
from fdjax.machine.virtual.gcode import AbstractGcodeMachine

BUFFER = 128
AREA_PER_POWER = 1e-4
"""mm^2 of section for each unit of S: of the virtual dispenser, nobody else's."""
_REPORT = 10
"""The setting that says what status reports hold: 1 the machine's place, 2 the buffer."""
_SETTINGS = {
    **{0: 10, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, _REPORT: 1, 11: 0.01, 12: 0.002, 13: 0, 20: 0},
    **{21: 0, 22: 1, 23: 0, 24: 25, 25: 500, 26: 250, 27: 1, 30: 1000, 31: 0, 32: 0},
    **{100: 250, 101: 250, 102: 250, 110: 6000, 111: 6000, 112: 600, 120: 50, 121: 50, 122: 50},
}
_PLACES = ("G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30", "G92")
_SET = re.compile(r"\$(\d+)=(-?[\d.]+)$")


class VirtualGrbl(AbstractGcodeMachine):
    """See the module. `buffer_report`: whether status reports tell the buffer ($10=3)."""

    firmware = "grbl"
    dialect = "grbl"
    banner = "Grbl 1.1h ['$' for help]"
    queue_length = 1

    def __init__(self, machine: Machine, *, buffer_report: bool = False, **options) -> None:
        self.settings = dict(_SETTINGS)
        self.settings[_REPORT] = 3 if buffer_report else 1
        super().__init__(machine, **options)
        self._buffer = bytearray()
        self._held = False
        self._verdict = "ok"
        self._reports = 0
        self._told = (0.0, 0.0, 0.0)

    def _fresh(self) -> GcodeState:
        return GcodeState(firmware_of(self.dialect), area_per_power=AREA_PER_POWER)

    def _forget(self) -> None:
        super()._forget()
        self._buffer.clear()
        self._held = False
        self._reports = 0

    def _take(self, data: bytes) -> None:
        for byte in data:
            if byte == ord("?"):
                self.advance(self.now)
                self._report()
            elif byte == ord("!"):
                self._held = True
            elif byte == ord("~"):
                self._held = False
            elif byte == 0x18:
                self.reset(self.now)
            elif len(self._buffer) < BUFFER:
                self._buffer.append(byte)

    def _report(self) -> None:
        busy = self._current is not None or self.rest_at > self.now
        state = "Hold:0" if self._held else "Run" if busy else "Idle"
        place, what = self.state, int(self.settings[_REPORT])
        fields = [f"MPos:{_text(place.on_bed)}" if what & 1 else f"WPos:{_text(_work(place))}"]
        if what & 2:
            free = max(0, 15 - len(self._planned))
            fields.append(f"Bf:{free},{BUFFER - len(self._buffer)}")
        fields.append("FS:0,0")
        if self._reports % 10 == 0 or self._told != place.shift:
            fields.append(f"WCO:{_text(place.shift)}")  # what lies between the two
        self._reports += 1
        self._told = place.shift
        self.say(f"<{'|'.join([state, *fields])}>")

    def _work(self) -> None:
        if not self._held:
            super()._work()

    def _accept(self) -> None:
        while not self._queue:
            end = self._buffer.find(b"\n")
            if end < 0:
                return
            self._queue.append(self._buffer[:end].decode("ascii", "replace").strip())
            del self._buffer[: end + 1]

    def _acknowledge(self, line: str) -> None:
        self.say(self._verdict)

    def _clamp(self) -> None:
        """Its soft limits are off as it comes ($20=0)."""

    def _begin(self, line: str) -> float:
        self._verdict = "ok"
        code = line if line.startswith("$") else code_of(line)
        try:
            if not code or self._is_of_system(code):
                return self.now
            until = self._run(command_of(code)[0], {}, code)
        except InputError as error:
            self._verdict = f"error:{_number(error)}"
            return self.now
        self.ran(code)
        return until

    def _is_of_system(self, code: str) -> bool:
        """Whether a line is a command of the system, which is done."""
        said = _SET.match(code)
        if said is not None:
            if int(said[1]) not in self.settings:
                raise NoCommand(code)
            self.settings[int(said[1])] = float(said[2])
        elif code == "$":
            self.say("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]")
        elif code == "$I":
            self.say("[VER:1.1h.20190830:]")
            self.say(f"[OPT:V,15,{BUFFER}]")
        elif code == "$G":
            self.say(f"[GC:{self._modes()}]")
        elif code == "$$":
            for number, value in self.settings.items():
                text = f"{value:.3f}" if number >= 100 or number in (11, 12) else f"{value:g}"
                self.say(f"${number}={text}")
        elif code == "$#":
            for name in _PLACES:
                shift = self.state.shift if name == "G92" else (0.0, 0.0, 0.0)
                self.say(f"[{name}:{_text(shift)}]")
            self.say("[TLO:0.000]")
            self.say("[PRB:0.000,0.000,0.000:0]")
        elif code == "$N":
            self.say("$N0=")
            self.say("$N1=")
        elif code == "$X":
            self.say("[MSG:Caution: Unlocked]")
        elif code == "$H":
            return False
        elif code.startswith("$"):
            raise NoCommand(code)
        else:
            return False
        return True

    def _modes(self) -> str:
        state = self.state
        spindle = state.spindle if state.power else "M5"
        units = "G20" if state.scale != 1 else "G21"
        distance = "G90" if state.absolute else "G91"
        modes = f"{state.motion} G54 {state.plane} {units} {distance} G94 {spindle} M9 T0"
        return f"{modes} F{60 * state.speed:g} S{state.power:g}"


def _text(point: tuple[float, ...]) -> str:
    return ",".join(f"{value:.3f}" for value in point)


def _work(state: GcodeState) -> tuple[float, ...]:
    return state.x, state.y, state.z


def _number(error: InputError) -> int:
    """The number that grbl gives a fault (report.h, `STATUS_`)."""
    text = str(error)
    if isinstance(error, NoCommand):
        return 3 if text.startswith("$") else 1
    if isinstance(error, Refused):
        return 22 if "speed" in text else 28 if "waits" in text else 20
    if "twice" in text:
        return 25
    return 33 if "arc" in text else 2
