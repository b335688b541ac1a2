"""Print a file with OctoPrint's communication layer, without its server: PORT FILE FOLDER."""

import sys
import time

from octoprint import plugin
from octoprint.settings import settings

port, path, folder = sys.argv[1:]
settings(init=True, basedir=folder)
plugin.plugin_manager(
    init=True, plugin_folders=[], plugin_bases=[plugin.OctoPrintPlugin], plugin_entry_points=[]
).reload_plugins(startup=True, initialize_implementations=False)

from octoprint.printer.profile import PrinterProfileManager  # noqa: E402 - wants the settings
from octoprint.util.comm import MachineCom, MachineComPrintCallback  # noqa: E402


class Listener(MachineComPrintCallback):
    """Tells what goes over the line, and how the print ended."""

    how = ""

    def on_comm_log(self, message):
        print(message)

    def on_comm_print_job_done(self, suppress_script=False):
        self.how = "done"

    def on_comm_print_job_failed(self, reason=None):
        self.how = f"failed: {reason}"


def wait_for(what, seconds):
    until = time.monotonic() + seconds
    while not what() and time.monotonic() < until:
        time.sleep(0.05)
    if not what():
        sys.exit(f"{com.getStateString()}: {com.getErrorString()}")


listener = Listener()
com = MachineCom(port, 115200, listener, PrinterProfileManager())
com.start()
wait_for(com.isOperational, 60)
com.selectFile(path, False)
com.startPrint()
wait_for(lambda: listener.how, 120)
com.close()
sys.exit(listener.how != "done")
