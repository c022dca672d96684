"""Begin a run, say so, and hold it until standard input ends. Usage: `running_writer.py DIRECTORY`."""

import os
import platform
import sys
from pathlib import Path

from labctl.runs.live.logs import EventLog
from tests.labctl.runs.conftest import begin, measure_until

if __name__ == "__main__":
    with EventLog() as events, begin(Path(sys.argv[1])) as writer:
        events.event("run started", process=os.getpid(), host=platform.node(), heeds_signals=True)
        events.keep_in(writer.paths.events)
        measure_until(writer, 3)
        print("writing", flush=True)  # noqa: T201
        sys.stdin.read()
        os._exit(1)  # as if killed
