"""How long the demonstration takes, and the paper's experiments with few benches, from the command to its end.

    python -m benchmarks reproduction

Needs the data sets of the experiments, and torch. The demonstration is the median of several; the experiments are
carried out once, which takes minutes. By the clock alone: their workers are no children of the command, which knows no
time of theirs.
"""

import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.commands import labctl
from benchmarks.rows import Goal, Row

REPETITIONS = 3
DEMO = Goal(most=20.0, of="figure")
QUICK = Goal(most=90.0, of="figure")


def rows() -> Iterator[Row]:
    """A row for each command."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        demos = [labctl("demo", "--out", str(folder / str(number))).wall_s for number in range(REPETITIONS)]
        quick_s = labctl("reproduce", "all", "--quick", "--out", str(folder / "quick")).wall_s
    yield Row("labctl demo", statistics.median(demos), "s", goal=DEMO)
    yield Row("labctl reproduce all --quick", quick_s, "s", goal=QUICK)
