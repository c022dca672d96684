"""How long commands take that only look, beside a Python that does nothing.

    python -m benchmarks startup

Each figure is the median over processes of their own, in turns. `labctl show` prints numbers before it draws: they have
a row of their own.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from subprocess import PIPE, Popen
from typing import IO, cast

from benchmarks.commands import Taken, labctl, python
from benchmarks.rows import Goal, Row

TIMES = 10
SETTINGS = ("images=40", "window=0.4 ns")


def until_it_prints(words: Sequence[str]) -> float:
    """Seconds until a process has printed its first line; it goes on to its end."""
    began = time.perf_counter()
    with Popen([sys.executable, *words], stdout=PIPE) as process:  # noqa: S603
        lines = cast("IO[bytes]", process.stdout)
        lines.readline()
        found = time.perf_counter() - began
        lines.read()
    return found


def rows() -> Iterator[Row]:
    """Help, the list of a folder with one run, and that run in numbers and pictures."""
    with tempfile.TemporaryDirectory() as folder:
        run = str(Path(folder) / "run")
        settings = (word for one in SETTINGS for word in ("--set", one))
        labctl("run", "image-readout", *settings, "--out", run)
        commands = {
            "--help": (("--help",), Goal(most=0.1, of="figure")),
            "runs": (("runs", folder), Goal(most=1.0, of="figure")),
            "show": (("show", run), Goal(most=1.0, of="figure")),
        }
        everything = {"": ("-c", "pass")} | {name: ("-m", "labctl", *words) for name, (words, _) in commands.items()}
        times: dict[str, list[Taken]] = {name: [] for name in everything}
        printed: list[float] = []
        for _ in range(TIMES):
            for name, words in everything.items():
                times[name].append(python(*words))
            printed.append(until_it_prints(everything["show"]))
    walls = {name: statistics.median(one.wall_s for one in taken) for name, taken in times.items()}
    for name, (_, goal) in commands.items():
        processor = statistics.median(one.processor_s for one in times[name])
        yield Row(f"labctl {name}", walls[name], "s", processor, "python -c pass", walls[""], goal)
    goal = Goal(most=1.0, of="figure")
    yield Row("labctl show: numbers", statistics.median(printed), "s", None, "python -c pass", walls[""], goal)
