"""What a command takes, as whoever types it would measure it."""

import os
import sys
import time
from dataclasses import dataclass
from subprocess import DEVNULL, Popen


@dataclass(frozen=True)
class Taken:
    """Seconds by the clock and of the processor, children included, and the peak of its memory, MB.

    The peak is at least that of the process that measures: Linux keeps it for what a process becomes.
    """

    wall_s: float
    processor_s: float
    peak_mb: float


def labctl(*words: str) -> Taken:
    """One command of labctl.

    Raises:
        RuntimeError: it did not end with 0.
    """
    return python("-m", "labctl", *words)


def python(*words: str) -> Taken:
    """One process of Python.

    Raises:
        RuntimeError: it did not end with 0.
    """
    began = time.perf_counter()
    process = Popen([sys.executable, *words], stdout=DEVNULL, stderr=DEVNULL)  # noqa: S603
    _, status, used = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"python {' '.join(words)} ended with {process.returncode}")
    return Taken(wall_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
