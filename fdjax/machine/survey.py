"""One look through a whole machine file before anything of it is sent."""

import os
from collections.abc import Callable

from fdjax.machine.program import Program
from fdjax.machine.surveyed import Survey
from fdjax.machine.surveyor import Surveyor

_STEP = 20_000
_LARGE = 1 << 20
"""Bytes of a G-code file from which on its lines are looked at many at a time, with NumPy."""


def survey(
    program: Program,
    *,
    longest: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Survey:
    """Run a program through its interpreter, line by line, and tell what it would do.

    `longest` replaces the firmware's longest line, bytes; `progress` is called now and then with
    the share of the file that has been read. Faults of the file are findings, not exceptions.
    """
    size, done, number = max(os.path.getsize(program.path), 1), 0, 0
    if program.language == "gcode" and size >= _LARGE:
        from fdjax.machine.survey_many import ManySurveyor

        many = ManySurveyor(program, longest)
        for chunk in program.chunks():
            done += len(chunk)
            before, number = number, many.take_chunk(chunk)
            if progress is not None and number // _STEP > before // _STEP:
                progress(min(done / size, 1.0))
        return many.result(number)
    surveyor = Surveyor(program, longest)
    take = surveyor.take
    for number, line in program.lines():
        done += len(line)
        take(number, line)
        if progress is not None and number % _STEP == 0:
            progress(min(done / size, 1.0))
    return surveyor.result(number)
