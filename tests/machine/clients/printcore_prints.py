"""Print a file with printrun's printcore: PORT FILE."""

import sys
import time

from printrun.gcoder import LightGCode
from printrun.printcore import printcore

port, path = sys.argv[1:]


def wait_for(what):
    until = time.monotonic() + 60
    while not what() and time.monotonic() < until:
        time.sleep(0.05)
    if not what():
        sys.exit("printcore waits in vain")


client = printcore()
client.connect(port, 115200)
wait_for(lambda: client.online)
with open(path, encoding="utf-8") as file:
    client.startprint(LightGCode(file.read().splitlines()))
wait_for(lambda: not client.printing)
time.sleep(0.5)
client.disconnect()
