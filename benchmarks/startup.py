"""How long `labctl --help` takes, beside a Python that does nothing.

    python benchmarks/startup.py

Each figure is the median over processes of their own, the two in turns; `cpu` is what the processor worked on it.
"""

import json
import os
import statistics
import sys
import time
from collections.abc import Sequence
from subprocess import DEVNULL, Popen

TIMES = 10
COMMANDS = {"python -c pass": ("-c", "pass"), "labctl --help": ("-m", "labctl", "--help")}


def taken(words: Sequence[str]) -> tuple[float, float]:
    """Seconds by the clock and of the processor for one process."""
    began = time.perf_counter()
    process = Popen([sys.executable, *words], stdout=DEVNULL)  # noqa: S603
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{' '.join(words)} ended with {process.returncode}")
    return wall, used.ru_utime + used.ru_stime


def main() -> None:
    """Measure and print one JSON object."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in COMMANDS}
    for _ in range(TIMES):
        for name, words in COMMANDS.items():
            found[name].append(taken(words))
    result = {
        name: {
            "median_s": round(statistics.median(wall for wall, _ in times), 3),
            "median_cpu_s": round(statistics.median(cpu for _, cpu in times), 3),
        }
        for name, times in found.items()
    }
    sys.stdout.write(json.dumps(result | {"processes": TIMES}) + "\n")


if __name__ == "__main__":
    main()
