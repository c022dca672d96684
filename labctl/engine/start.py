"""What is told when a run, a sweep or a live view begins: on which bench, and which process carries it out."""

import os
import platform
from typing import Any

from labctl.bench.signals import heeds_signals
from labctl.bench.station import Station


def carried_out(station: Station) -> dict[str, Any]:
    """Fields of one of the events `labctl.runs.live.owner.STARTS`, told by the process that it names."""
    return {
        "station": station.source,
        "simulated": station.simulated,
        "mixed": station.partly_simulated,
    } | this_process()


def this_process() -> dict[str, Any]:
    """Those of the fields that name the process."""
    return {"process": os.getpid(), "heeds_signals": heeds_signals(), "host": platform.node()}
