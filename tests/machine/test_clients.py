"""Other people's senders print with the virtual machines; skipped without their packages.

`pip install --no-deps printrun` and `pip install grbl-streamer`; seen with 2.2.0 and 2.0.2.
"""

import contextlib
import logging
import sys
import threading
import time
from pathlib import Path

import pytest
from streams import PRINTER

from fdjax.formats import write_file
from fdjax.machine import virtual
from fdjax.machine.program import Program
from fdjax.machine.virtual.serve import PseudoTerminal

sys.path.append(str(Path(__file__).parents[1] / "formats"))
from format_samples import small_build

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # what they do is theirs


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


def wait_for(what, seconds=60):
    until = time.monotonic() + seconds
    while not what() and time.monotonic() < until:
        time.sleep(0.05)
    assert what()


@pytest.mark.parametrize("name", ["marlin", "klipper", "rrf"])
def test_printcore_prints(tmp_path, name):
    printcore = pytest.importorskip("printrun.printcore")
    gcoder = pytest.importorskip("printrun.gcoder")
    path = tmp_path / "part.gcode"
    write_file(small_build(), path, PRINTER)
    with served(name) as (machine, port):
        client = printcore.printcore()
        client.connect(port, 115200)
        wait_for(lambda: client.online)
        client.startprint(gcoder.LightGCode(path.read_text().splitlines()))
        wait_for(lambda: not client.printing)
        time.sleep(0.5)
        client.disconnect()
    wanted = [command.text for command in Program(path, PRINTER).commands()]
    assert [text for text in machine.executed if text[0] in "G" or text in wanted] == wanted


def test_grbl_streamer_runs_a_job(tmp_path):
    streamer = pytest.importorskip("grbl_streamer")
    path = tmp_path / "job.nc"
    path.write_text(
        "G21\nG90\n(hello)\nM3 S500\nN5 G1 X10 Y5 F600\n\nG4 P0.1\nG1 X20\nM5\nG0 X0 Y0\n"
    )
    events = []
    logging.getLogger().setLevel(logging.ERROR)
    with served("grbl") as (machine, port):
        client = streamer.GrblStreamer(lambda event, *data: events.append((event, data)))
        client.setup_logging()
        client.cnect(port, 115200)
        time.sleep(2)
        client.load_file(str(path))
        client.job_run()
        wait_for(lambda: any(event == "on_job_completed" for event, _ in events))
        client.disconnect()
    assert not [event for event in events if "error" in event[0] or "alarm" in event[0]]
    assert machine.print.volume == pytest.approx(500 * 1e-4 * (125**0.5 + 10))
