"""Other people's senders print with the virtual machines.

FDJAX_CLIENTS names a Python that has them, in an environment of their own:
`pip install OctoPrint==1.11.8 grbl-streamer==2.0.2` and `pip install --no-deps printrun==2.2.0`.
"""

import contextlib
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from streams import PRINTER

from fdjax.formats import write_file
from fdjax.machine import virtual
from fdjax.machine.program import Program
from fdjax.machine.virtual.serve import PseudoTerminal

sys.path.append(str(Path(__file__).parents[1] / "formats"))
from format_samples import small_build

PYTHON = os.environ.get("FDJAX_CLIENTS")
SCRIPTS = Path(__file__).with_name("clients")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PYTHON is None, reason="no clients: FDJAX_CLIENTS names no Python"),
]


@contextlib.contextmanager
def served(name):
    """A virtual machine at a pseudo-terminal: machine and name of the port."""
    machine = virtual.MACHINES[name](PRINTER, keep=True, record=True)
    terminal, over = PseudoTerminal(), threading.Event()
    thread = threading.Thread(target=terminal.serve, args=(machine,), kwargs={"until": over.is_set})
    thread.start()
    try:
        yield machine, terminal.name
    finally:
        over.set()
        thread.join()
        terminal.close()


def run(script, *arguments):
    """Run a client to its end, which has to be a good one."""
    done = subprocess.run(
        [PYTHON, str(SCRIPTS / f"{script}.py"), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        env={key: text for key, text in os.environ.items() if key != "PYTHONPATH"},
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


@pytest.mark.parametrize("name", ["marlin", "klipper", "rrf"])
@pytest.mark.parametrize("client", ["octoprint_prints", "printcore_prints"])
def test_what_fdjax_writes_is_printed(tmp_path, client, name):
    path = tmp_path / "part.gcode"
    write_file(small_build(), path, PRINTER)
    more = [tmp_path / "octoprint"] if client == "octoprint_prints" else []
    with served(name) as (machine, port):
        run(client, port, path, *more)
    wanted = [command.text for command in Program(path, PRINTER).commands()]
    own = ("M21", "M105", "M110", "M115", "M400")  # what clients say of themselves
    assert [text for text in machine.executed if not text.startswith(own)] == wanted


def test_grbl_streamer_runs_a_job(tmp_path):
    path = tmp_path / "job.nc"
    path.write_text(
        "G21\nG90\n(hello)\nM3 S500\nN5 G1 X10 Y5 F600\n\nG4 P0.1\nG1 X20\nM5\nG0 X0 Y0\n"
    )
    with served("grbl") as (machine, port):
        run("grbl_streamer_runs", port, path)
    assert machine.print.volume == pytest.approx(500 * 1e-4 * (125**0.5 + 10))
