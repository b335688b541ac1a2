"""Run a job with grbl-streamer: PORT FILE. Prints its events."""

import logging
import sys
import time

from grbl_streamer import GrblStreamer

port, path = sys.argv[1:]
logging.getLogger().setLevel(logging.ERROR)
events = []
client = GrblStreamer(lambda event, *data: events.append(event))
client.setup_logging()
client.cnect(port, 115200)
time.sleep(2)
client.load_file(path)
client.job_run()
until = time.monotonic() + 60
while "on_job_completed" not in events and time.monotonic() < until:
    time.sleep(0.05)
client.disconnect()
bad = [event for event in events if "error" in event or "alarm" in event]
sys.exit(f"{bad or events}" if bad or "on_job_completed" not in events else 0)
